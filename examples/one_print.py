"""Play the paper's problem with three agents: a test print, its noisy scan, then a print that nothing watches.

pip install 'printmend-lab[rl]' && python examples/one_print.py --family pulley-loose

A score of 0 is the path commanded as it is, 1 the best plan on the true machine. The scenes are kept ones: agents that
are trained must be trained on others (`examples/train_one_print.py`).
"""

import argparse

import numpy as np

from printmend.printer import read_printer
from printmend_lab.env import SCENES, learning_agent, one_naive_agent, score_agent


def scores(family: str, severity: str, *, scenes: int = 32) -> dict[str, np.ndarray]:
    """Return each agent's score on each scene."""
    printer = read_printer("ender5")
    learners = ("printmend", "greybox", "meta")
    agents = {"Naive": one_naive_agent} | {name: learning_agent(name, printer) for name in learners}
    return {name: score_agent(agent, family, severity, scenes=scenes) for name, agent in agents.items()}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--family", default="pulley-loose", choices=sorted(SCENES["damaged"]))
    parser.add_argument("--severity", default="damaged", choices=["damaged", "realistic"])
    parser.add_argument("--scenes", type=int, default=32)
    options = parser.parse_args()
    for name, found in scores(options.family, options.severity, scenes=options.scenes).items():
        print(f"{name:10} mean {found.mean():6.3f}  median {np.median(found):6.3f}  worst {found.min():7.3f}")
