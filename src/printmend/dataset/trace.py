"""Lattice prints as the traces that learners read."""

import numpy as np

from printmend.path import Trace
from printmend.printer import Printer


def lattice_trace(printer: Printer, nominal_steps: np.ndarray, printed_steps: np.ndarray) -> Trace:
    """Return the trace [T + 1] of a lattice print, every point of it measured exactly.

    ``nominal_steps`` [T + 1, 2] is where the controls led a healthy printer, ``printed_steps`` [T + 1, 2] where the
    print ended up; both count from the bed's lower corner. The sigma is zero: the paper's set-up has no noise.
    """
    corner_mm = np.array([printer.x.min_mm, printer.y.min_mm])
    pitch_mm = np.array(printer.mm_per_step)
    return Trace(
        commanded_mm=corner_mm + np.asarray(nominal_steps) * pitch_mm,
        measured_mm=corner_mm + np.asarray(printed_steps) * pitch_mm,
        sigma_mm=np.zeros(len(nominal_steps)),
    )
