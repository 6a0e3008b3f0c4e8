"""All jumps of a trace at once: the cheapest history of skipped teeth and missed steps under a model.

With a model at hand, the offset of the belt can only be a whole number of teeth and that of the motor a whole number of
electrical turns: a ladder of two dimensions. Every measured point costs what its residual at a level says, every rung
that is climbed costs a price; the cheapest history follows by dynamic programming. Where a model is wrong in a smooth
way the ladder would imitate it, so each jump must also show as a sudden change of the residual. Where a model lacks a
sudden step of the table, as of a spliced belt, the ladder would climb and descend whenever the step is passed: what
comes back at its place, and is undone on passing it back, is part of the machine.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from printmend.learn.drive.design import Rows, contacts
from printmend.learn.drive.kernels import jumps as kernels
from printmend.learn.drive.select import Choice
from printmend.path import last_way
from printmend.printer import Axis

TOOTH_STEPS, MISSED_STEPS = 10, 4
TEETH, MISSED = 5, 8  # rungs either way
PRICE = 14.0  # nats a rung
OUTLIER = 12.0  # the most that a point may cost: fewer than two rungs, so that a stray point is no pair of jumps
SIGMA_MM = 0.03  # the least that is taken for noise: models are not exact while there are jumps in them
LOCAL = 4  # points on each side of a jump that must show it
SUDDEN = 0.4  # how far from its size a jump may look, of its size
PLACE_MM = 1.5  # jumps so near to each other may be one step of the table: noise and play move where it shows
ALIKE = 0.4  # and differ by at most this share of their size
OFTEN = 0.2  # jumps at a larger share of the passes of a place belong to the place; one of them may be by chance
CANCELLED_MM = 0.1  # by so much less than the smaller of them two jumps at one row cancel each other


@dataclass(frozen=True)
class Jump:
    """From ``row`` on, the ``belt`` (a skipped tooth) or the motor (missed steps) is off by ``size_mm``."""

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
        for b in range(-MISSED, MISSED + 1)
    ], axis=1)  # fmt: skip
    sigma = max(1.4826 * float(np.median(np.abs(np.diff(residual[:, MISSED])))) / np.sqrt(2), SIGMA_MM)
    sigma_mm = sigma / np.sqrt(rows.weight[measured])
    levels_mm = residual[:, None, :] - tooth_mm * np.arange(-TEETH, TEETH + 1)[:, None]
    cost = np.minimum(np.square(levels_mm / sigma_mm[:, None, None]) / 2, OUTLIER)
    path = np.empty((len(measured), 2), np.int64)
    kernels.cheapest_levels(cost, PRICE, path)
    at = np.flatnonzero((np.diff(path, axis=0) != 0).any(axis=1))
    jumps: list[Jump] = []
    left = levels_mm[np.arange(len(path)), path[:, 0], path[:, 1]]
    for i, before, after in zip(at, np.append(-1, at), np.append(at[1:], len(path) - 1), strict=False):
        teeth, missed = (int(n) for n in path[i + 1] - path[i])
        first, last = slice(max(i + 1 - LOCAL, before + 1), i + 1), slice(i + 1, min(i + 1 + LOCAL, after + 1))
        # what the points after the jump would look like without it
        still = levels_mm[last, path[i, 0], path[i, 1]]
        seen = float(np.median(still) - np.median(left[first]))
        size = float(np.median(still) - np.median(left[last]))
        if abs(seen - size) > SUDDEN * abs(size):
            continue
        row = int(measured[i]) + 1
        jumps += [Jump(row, True, teeth * tooth_mm)] * (teeth != 0)
        jumps += [Jump(row, False, missed * step_mm)] * (missed != 0)
    return lasting(rows, jumps)


def lasting(rows: Rows, jumps: Sequence[Jump]) -> tuple[Jump, ...]:
    """Return the jumps without those that all but cancel each other at one row, and those that belong to a place: there
    they come at many passes, one way up and the other way down."""
    at = np.unique([jump.row for jump in jumps]).astype(np.int64)
    sizes_mm = [[jump.size_mm for jump in jumps if jump.row == row] for row in at]
    size_mm, least_mm = np.array([sum(each) for each in sizes_mm]), [min(map(abs, each)) for each in sizes_mm]
    place_mm, rise_mm = rows.motor_mm[at], size_mm * last_way(rows.motor_mm)[at]
    kept = set()
    for i in range(len(at)):
        alike = (np.abs(place_mm - place_mm[i]) <= PLACE_MM) & (np.abs(rise_mm - rise_mm[i]) <= ALIKE * abs(rise_mm[i]))
        count = int(alike.sum())
        undone = abs(np.sign(size_mm[alike]).sum()) <= count / 2
        often = count - 1 > OFTEN * _passes(rows.motor_mm, place_mm[i])
        if abs(size_mm[i]) > least_mm[i] - CANCELLED_MM and not (undone and often):
            kept.add(int(at[i]))
    return tuple(jump for jump in jumps if jump.row in kept)


def _passes(motor_mm: np.ndarray, place_mm: float) -> int:
    """Return how often a motor went past a place, from one side of its surroundings to the other."""
    away = motor_mm - place_mm
    sides = np.sign(away[np.abs(away) > PLACE_MM])
    return int((np.diff(sides) != 0).sum())
