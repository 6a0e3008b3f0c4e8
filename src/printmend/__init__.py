"""printmend: print straight on a broken 3-D printer.

The commands do the work (`printmend --help`). From Python, a test print [mm] becomes a model, the model a plan [steps]:

    import numpy as np
    from printmend.control.registry import controller
    from printmend.path import Trace
    from printmend.printer import read_printer
    from printmend.learn.registry import learner

    trace = Trace(commanded_mm, measured_mm)
    model = learner("greybox").fit(trace, read_printer("ender5"), rng=np.random.default_rng(0))
    plan = controller("optimal").plan(model, targets_steps, start_steps)

`protocols` says what learners, models and controllers take and return; `learn.space` and `control.space` are
those of three axes, `corruption` and `twin` break and run printers, `env` is the decision problem for reinforcement
learning.
"""

import os
import tempfile
from pathlib import Path

from printmend.cache import kernel_folder, user_cache

__version__ = "0.1.0"

if os.name == "posix" and "NUMBA_CACHE_DIR" not in os.environ:  # numba reads it once, when it is imported
    _kernels = kernel_folder(Path(__file__).parent, user_cache(), Path(tempfile.gettempdir()))
    if _kernels is not None:
        os.environ["NUMBA_CACHE_DIR"] = str(_kernels)
