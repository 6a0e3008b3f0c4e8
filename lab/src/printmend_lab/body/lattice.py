"""From millimetres to the lattice of full steps: polylines become controls in {−1, 0, 1}² a tick."""

import numpy as np

from printmend.errors import GcodeError
from printmend.printer import Printer
from printmend_lab.body.kernels import UNITS, count_bound, follow

MAX_TICKS = 200_000_000  # of one body: 400 MB of controls
_MAX_STEPS = 1 << 16  # from the corner of the bed: products of two places in `UNITS` still fit into 64 bits


def to_steps(xy_mm: np.ndarray, printer: Printer) -> np.ndarray:
    """Map bed coordinates [..., 2] in mm to full steps from the bed's lower corner, unrounded."""
    corner = np.array([printer.x.min_mm, printer.y.min_mm])
    return (np.asarray(xy_mm, float) - corner) / np.array(printer.mm_per_step)


def follow_polyline(
    points_steps: np.ndarray, drawing: np.ndarray, *, subject: object = "path", room: int = MAX_TICKS
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (start [2], controls [T, 2] int8, extruding [T]) along way-points [M + 1, 2] in steps.

    ``drawing`` [M] says which segments extrude; each tick carries the flag of the segment that it follows. Every
    visited node is within half a step (Euclidean) of that segment, consecutive nodes are 8-neighbours, and no error
    is carried from one segment to the next: see `body.kernels.follow`. Raises GcodeError for places that no
    printer has and where more than ``room`` ticks may be needed.
    """
    points_steps = np.asarray(points_steps, float)
    if not (np.abs(points_steps) < _MAX_STEPS).all():
        raise GcodeError(
            subject, wanted=f"coordinates within {_MAX_STEPS} steps of the bed", came="NaN or places beyond",
            todo="check the file's units and offsets",
        )  # fmt: skip
    points = np.rint(points_steps * UNITS).astype(np.int64)
    bound = int(count_bound(points))
    if bound > room:
        raise GcodeError(
            subject, wanted=f"at most {MAX_TICKS} steps of motion", came="more",
            todo="check the file's units, or split it",
        )  # fmt: skip
    controls, extruding = np.empty((bound, 2), np.int8), np.empty(bound, bool)
    ticks, x, y = follow(points, np.ascontiguousarray(drawing, bool), controls, extruding)
    if ticks < 0:  # too small for the lattice: it stays where its first point rounds to
        return (points[0] + UNITS // 2) // UNITS, controls[:0], extruding[:0]
    return np.array([x, y], np.int64), controls[:ticks].copy(), extruding[:ticks].copy()
