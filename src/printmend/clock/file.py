"""How long a whole file takes, as it is."""

from functools import partial
from pathlib import Path

import numpy as np

from printmend.clock.clock import start_clock
from printmend.clock.limits import Limits
from printmend.gcode.container import open_gcode
from printmend.gcode.kernels import PIECE
from printmend.gcode.read import starting_state
from printmend.gcode.write import follow
from printmend.printer import Printer

_NO_PIECES = np.empty(0, PIECE)


def file_seconds(path: Path | str, limits: Limits, printer: Printer) -> float:
    """Return how long ``printer`` takes for the programs of a file within ``limits`` [s]. Raises as `open_gcode`."""
    seconds = 0.0
    with open_gcode(path) as file:
        for part in file.parts:
            clock = start_clock(limits)
            state = starting_state(part, printer=printer)
            follow(part.chunks(), state, _as_it_is, look=partial(clock.advance, mended=False))
            clock.finish()
            seconds += clock.seconds
    return seconds


def _as_it_is(records: np.ndarray, _begin: int) -> tuple[int, np.ndarray, np.ndarray]:
    return len(records), np.zeros(len(records) + 1, np.int64), _NO_PIECES
