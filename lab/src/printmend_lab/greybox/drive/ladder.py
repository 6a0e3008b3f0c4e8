"""Find all jumps of a trace at once: the cheapest history of skipped teeth and missed steps under a model.

With a model at hand, the offset of the belt can only be a whole number of teeth, and that of the motor a whole number
of electrical turns: a ladder in two dimensions. Every measured point costs the square of its residual at the level
where it is thought to be, and every rung that is climbed costs a price; dynamic programming gives the cheapest history.
Two errors of the model would look like jumps. A smooth one would be imitated by small ones, so each jump must also show
as a sudden change of the residual. A step of the table, as of a spliced belt, would be climbed and descended whenever
it is passed; so what comes again at the same place, and is undone on the way back, counts as part of the machine.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from printmend.path import last_way
from printmend.printer import Axis
from printmend.units import SIGMA_PER_MEDIAN
from printmend_lab.greybox.drive.design import Rows, contacts
from printmend_lab.greybox.drive.kernels import jumps as kernels
from printmend_lab.greybox.drive.select import Choice

TOOTH_STEPS, MISSED_STEPS = 10, 4  # sizes of a skipped tooth and of a missed electrical turn (physics.md eq. 11)
MOST_TEETH, MOST_MISSED = 5, 8  # rungs of the ladder either way
RUNG_NATS = 14.0  # price of a rung
MOST_POINT_NATS = 12.0  # most that one point may cost: less than two rungs, so that a stray point is no pair of jumps
LEAST_SIGMA_MM = 0.03  # smallest noise that is assumed: while there are jumps in the rows no model is exact
NEIGHBOURS = 4  # points on each side of a jump that must show it
SIZE_TOLERANCE = 0.4  # how far from its true size a jump may look, as a share of it
SAME_PLACE_MM = 1.5  # jumps this near to each other may be one step of the table: noise and play move where it shows
SAME_RISE_SHARE = 0.4  # such jumps differ by at most this share of their size
MACHINE_PASSES_SHARE = 0.2  # what jumps at more of the passes of a place is the machine's (one may be chance)
CANCELLED_MM = 0.1  # two jumps at one row cancel if their sum is smaller than the smaller of them by this much


@dataclass(frozen=True)
class Jump:
    """From ``row`` on the belt (``belt``: a skipped tooth), or else the motor (missed steps), is off by ``size_mm``."""

    row: int
    belt: bool
    size_mm: float


def jumped(rows: Rows, jumps: tuple[Jump, ...]) -> Rows:
    """Return the rows as they would be without the jumps."""
    motor, measured = rows.motor_mm.copy(), rows.measured_mm.copy()
    for jump in jumps:
        if jump.belt:
            measured[jump.row :] -= jump.size_mm
        else:
            motor[jump.row :] += jump.size_mm
    return replace(rows, motor_mm=motor, measured_mm=measured) if jumps else rows


def climbed(rows: Rows, choice: Choice, axis: Axis) -> tuple[Jump, ...]:
    """Return the cheapest jumps of one motor's rows under a model."""
    measured = np.flatnonzero(rows.weight > 0)
    tooth_mm, step_mm = TOOTH_STEPS * axis.mm_per_step, MISSED_STEPS * axis.mm_per_step
    values = choice.fit.posterior.values
    residual = np.stack([
        contacts(choice.design, values, replace(rows, motor_mm=rows.motor_mm + b * step_mm)).residual_mm[measured]
        for b in range(-MOST_MISSED, MOST_MISSED + 1)
    ], axis=1)  # fmt: skip
    sigma = max(
        SIGMA_PER_MEDIAN * float(np.median(np.abs(np.diff(residual[:, MOST_MISSED])))) / np.sqrt(2), LEAST_SIGMA_MM
    )
    sigma_mm = sigma / np.sqrt(rows.weight[measured])
    levels_mm = residual[:, None, :] - tooth_mm * np.arange(-MOST_TEETH, MOST_TEETH + 1)[:, None]
    cost = np.minimum(np.square(levels_mm / sigma_mm[:, None, None]) / 2, MOST_POINT_NATS)
    path = np.empty((len(measured), 2), np.int64)
    kernels.cheapest_levels(cost, RUNG_NATS, path)
    at = np.flatnonzero((np.diff(path, axis=0) != 0).any(axis=1))
    jumps: list[Jump] = []
    left = levels_mm[np.arange(len(path)), path[:, 0], path[:, 1]]
    for i, before, after in zip(at, np.append(-1, at), np.append(at[1:], len(path) - 1), strict=False):
        teeth, missed = (int(n) for n in path[i + 1] - path[i])
        first = slice(max(i + 1 - NEIGHBOURS, before + 1), i + 1)
        last = slice(i + 1, min(i + 1 + NEIGHBOURS, after + 1))
        # where the points after the jump would be without it
        still = levels_mm[last, path[i, 0], path[i, 1]]
        seen = float(np.median(still) - np.median(left[first]))
        size = float(np.median(still) - np.median(left[last]))
        if abs(seen - size) > SIZE_TOLERANCE * abs(size):
            continue
        row = int(measured[i]) + 1
        jumps += [Jump(row, True, teeth * tooth_mm)] * (teeth != 0)
        jumps += [Jump(row, False, missed * step_mm)] * (missed != 0)
    return lasting(rows, jumps)


def lasting(rows: Rows, jumps: Sequence[Jump]) -> tuple[Jump, ...]:
    """Return the jumps without two kinds: those that cancel each other at one row, and those that belong to a place.

    At a place of the machine they come at many passes, up one way and down the other way.
    """
    at = np.unique([jump.row for jump in jumps]).astype(np.int64)
    sizes_mm = [[jump.size_mm for jump in jumps if jump.row == row] for row in at]
    size_mm, least_mm = np.array([sum(each) for each in sizes_mm]), [min(map(abs, each)) for each in sizes_mm]
    place_mm, rise_mm = rows.motor_mm[at], size_mm * last_way(rows.motor_mm)[at]
    kept = set()
    for i in range(len(at)):
        alike = np.abs(rise_mm - rise_mm[i]) <= SAME_RISE_SHARE * abs(rise_mm[i])
        alike &= np.abs(place_mm - place_mm[i]) <= SAME_PLACE_MM
        count = int(alike.sum())
        undone = abs(np.sign(size_mm[alike]).sum()) <= count / 2
        often = count - 1 > MACHINE_PASSES_SHARE * _passes(rows.motor_mm, place_mm[i])
        if abs(size_mm[i]) > least_mm[i] - CANCELLED_MM and not (undone and often):
            kept.add(int(at[i]))
    return tuple(jump for jump in jumps if jump.row in kept)


def _passes(motor_mm: np.ndarray, place_mm: float) -> int:
    """Return how often a motor passed a place, from `SAME_PLACE_MM` on one side of it to as far on the other."""
    away = motor_mm - place_mm
    sides = np.sign(away[np.abs(away) > SAME_PLACE_MM])
    return int((np.diff(sides) != 0).sum())
