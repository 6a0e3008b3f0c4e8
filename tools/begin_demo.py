"""Compile beforehand the three largest kernels of `make demo`, while pip installs what else the demonstrations need.

    .venv/bin/python tools/begin_demo.py read|plan

Each is a process of its own: `read` compiles the reader and the writer of G-code, `plan` the planner between them.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from printmend.gcode.container import open_gcode
from printmend.gcode.kernels import PIECE, RECORD
from printmend.gcode.read import starting_state
from printmend.gcode.write import rewrite
from printmend.plan import start
from printmend.printer import read_printer
from printmend_lab.sampling import sample


def read() -> None:
    """Read a file and write it as it is."""
    with tempfile.TemporaryDirectory(prefix="printmend-") as folder:
        path = Path(folder) / "part.gcode"
        path.write_text("G28\nG1 X9 Y9\n")
        with open_gcode(path) as file:
            (part,) = file.parts
            for _ in rewrite(part.chunks(), starting_state(part), keep):
                pass


def keep(records: np.ndarray, begin: int) -> tuple[int, np.ndarray, np.ndarray]:
    """Plan nothing: every record stays as it is."""
    return len(records), np.zeros(len(records) - begin + 1, np.int64), np.empty(0, PIECE)


def plan() -> None:
    """Plan no moves on a machine with bad pulleys and slack belts."""
    fault = sample("pulley-play", np.random.default_rng(1), "realistic")
    start(fault.lower(read_printer("ender5"))).plan(np.empty(0, RECORD))


if __name__ == "__main__":
    {"read": read, "plan": plan}[sys.argv[1]]()
