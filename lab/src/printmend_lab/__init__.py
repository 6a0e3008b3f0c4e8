"""printmend-lab: the laboratory of printmend, where learners and planners are judged.

The paper's learners and planners, bodies on the lattice of full steps, data sets, tables, and the decision problem for
reinforcement learning. `printmend bench --help` is where to begin; from Python, anything with a name and a `fit`
(`printmend.protocols`) is judged on bodies beside the others:

    import printmend_lab

    print(printmend_lab.evaluate(["naive", "greybox", MINE], bodies, families=["pulley-play"]))
"""

import lazy_loader

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
