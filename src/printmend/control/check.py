"""The one check of what a controller is given."""

import numpy as np

from printmend.errors import InputError
from printmend.printer import Printer


def check_plan(
    printer: Printer, targets_steps: np.ndarray, start_steps: np.ndarray, c_max: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return targets [T, 2] float64 and start [2] int64. Raise `InputError` where they are not that."""
    targets = np.ascontiguousarray(targets_steps, float)
    start = np.asarray(start_steps)
    if targets.ndim != 2 or targets.shape[1] != 2 or start.shape != (2,):
        raise InputError(
            "plan",
            wanted="targets [T, 2] and start [2]",
            came=f"{targets.shape} and {start.shape}",
            todo="reshape them",
        )
    lattice = np.rint(start).astype(np.int64)
    if (lattice != start).any() or (lattice < 0).any() or (lattice > printer.bed_steps).any():
        raise InputError(
            "start", wanted=f"a lattice point in 0…{printer.bed_steps}", came=f"{start}", todo="move it onto the bed"
        )
    if not np.isfinite(targets).all():
        row = int(np.flatnonzero(~np.isfinite(targets).all(axis=1))[0])
        raise InputError("targets", wanted="finite positions", came=f"{targets[row]} in row {row}", todo="remove it")
    if not 1 <= c_max <= 63:
        raise InputError("c_max", wanted="1 to 63 steps a tick", came=f"{c_max}", todo="correct it")
    return targets, lattice
