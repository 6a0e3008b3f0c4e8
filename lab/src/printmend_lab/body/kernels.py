"""Follow a polyline on the lattice of full steps, in exact integer arithmetic.

Coordinates are integers of 1/2^14 step, so that ties always round the same way and neighbours never part.
"""

import numpy as np

from printmend.jit import entry

UNITS = 1 << 14  # of one step
_HALF = UNITS >> 1  # of a step, to round by


@entry
def count_bound(points: np.ndarray) -> int:
    """Return an upper bound of the ticks that `follow` needs for a polyline [M + 1, 2]."""
    total = 0
    for k in range(len(points) - 1):
        span = max(abs(points[k + 1, 0] - points[k, 0]), abs(points[k + 1, 1] - points[k, 1]))
        total += span // UNITS + 2
    return total


@entry
def follow(
    points: np.ndarray, drawing: np.ndarray, controls: np.ndarray, extruding: np.ndarray
) -> tuple[int, int, int]:
    """Write the lattice path of a polyline [M + 1, 2] whose segment k carries the flag ``drawing[k]``.

    The path visits the roundings of (1) the points at which a segment's longer coordinate is whole, and (2) the
    way-points that lie within half a step of their rounding. So no node is further than half a step from the
    segment that owns it. Two consecutive candidates differ by at most one step on each axis, hence so do their
    roundings; and a way-point that (2) leaves out lies between four nodes, of which its neighbours in the
    path are two: the path is 8-connected.

    Fills ``controls`` [T, 2] and ``extruding`` [T]; returns (T, start x, start y), T = −1 where no point of the
    polyline comes within half a step of the lattice.
    """
    ticks, start_x, start_y, x, y = -1, 0, 0, 0, 0
    for k in range(-1, len(points) - 1):
        # The first way-point is a segment of length zero.
        x0, y0 = points[max(k, 0), 0], points[max(k, 0), 1]
        x1, y1 = points[k + 1, 0], points[k + 1, 1]
        draws = drawing[k] if k >= 0 else False
        along_x = abs(x1 - x0) >= abs(y1 - y0)
        if along_x:
            major0, major1, minor0, rise = x0, x1, y0, y1 - y0
        else:
            major0, major1, minor0, rise = y0, y1, x0, x1 - x0
        run = abs(major1 - major0)
        step = 1 if major1 > major0 else -1
        # The whole numbers strictly beyond the start, up to the end.
        first = major0 // UNITS + 1 if step > 0 else -((-major0) // UNITS) - 1
        last = major1 // UNITS if step > 0 else -((-major1) // UNITS)
        crossings = max(0, (last - first) * step + 1) if run > 0 else 0
        for n in range(crossings + 1):
            if n < crossings:
                major = first + n * step
                # Exact: floor of the true coordinate, then round half up.
                minor = minor0 + abs(major * UNITS - major0) * rise // run
                rounded = (minor + _HALF) // UNITS
                node_x, node_y = (major, rounded) if along_x else (rounded, major)
            else:
                node_x, node_y = (x1 + _HALF) // UNITS, (y1 + _HALF) // UNITS
                off_x, off_y = x1 - node_x * UNITS, y1 - node_y * UNITS
                if off_x * off_x + off_y * off_y > _HALF * _HALF:
                    continue
            if ticks < 0:
                ticks, start_x, start_y = 0, node_x, node_y
            elif node_x != x or node_y != y:
                controls[ticks, 0] = node_x - x
                controls[ticks, 1] = node_y - y
                extruding[ticks] = draws
                ticks += 1
            x, y = node_x, node_y
    return ticks, start_x, start_y
