"""Local search over small edits of a plan, for costs that no table of steps can hold. Checks happen in area.py.

An edit makes one step earlier or later: a control grows by δ at tick t and shrinks by δ at a tick some later. The
machine is run again from there until its belts stand where they stood; the edit stays where the ticks in between cost
less. Ticks are counted 1…T, 0 is the start: ``wanted`` [T + 1, 2] holds the start and the targets.
"""

from typing import NamedTuple

import numpy as np

from printmend.jit import entry, inner
from printmend.machine.kernels.bed import printed, to_motors
from printmend.machine.kernels.play import clip

# What a tick costs: so much of the area that the moves of nozzle and target sweep between them, and of the squared
# distance from the target. Some of the latter beside the area: most of the area that can be saved is, the points stay
# where they were wanted, and where the area is flat it decides.
SQUARES, AREA = (0.0, 1.0), (1.0, 0.3)
# After an edit the belts must be where they were within so many ticks.
_REJOIN_TICKS = 60
# An edit must save more than rounding could, in squared steps.
_LEAST_SAVING = 1e-9


class Print(NamedTuple):
    """A plan and what it prints, a row [T + 1, 2] a tick, the start first, whose control is none.

    ``controls`` along x and y, ``motors`` the entries of the motors' tables, ``belts`` where the motors hold their
    belts, ``bed`` where the nozzle is.
    """

    controls: np.ndarray
    motors: np.ndarray
    belts: np.ndarray
    bed: np.ndarray


@inner
def tick_cost(shares, wanted, t, x0, y0, x, y):
    """Return what tick t costs, which leads the nozzle from (x0, y0) to (x, y); ``shares`` of area and of squares.

    The area is that of two triangles: target before, target, nozzle; and target before, nozzle, nozzle before.
    """
    dx, dy = x - wanted[t, 0], y - wanted[t, 1]
    squared = dx * dx + dy * dy
    if shares[0] == 0.0:
        return shares[1] * squared
    ax, ay = wanted[t, 0] - wanted[t - 1, 0], wanted[t, 1] - wanted[t - 1, 1]
    bx, by = x - wanted[t - 1, 0], y - wanted[t - 1, 1]
    cx, cy = x0 - wanted[t - 1, 0], y0 - wanted[t - 1, 1]
    area = (abs(ax * by - ay * bx) + abs(bx * cy - by * cx)) / 2
    return shares[0] * area + shares[1] * squared


@inner
def edited(shares, wanted, machine, plan, new, t, later, axis, step):
    """Run the machine from tick t with controls[t, axis] + step and controls[later, axis] − step.

    Return (what that saves, the first tick that is as before); 0 saved where it does not rejoin the plan. The new ticks
    are in ``new`` from row 0 on: row s − t is tick s.
    """
    motors, belts, bed = plan.motors, plan.belts, plan.bed
    lower_a, upper_a, lower_b, upper_b = machine.lower_a, machine.upper_a, machine.lower_b, machine.upper_b
    ticks = plan.controls.shape[0] - 1
    saved = 0.0
    m, n, p, q = motors[t - 1, 0], motors[t - 1, 1], belts[t - 1, 0], belts[t - 1, 1]
    x0, y0 = bed[t - 1, 0], bed[t - 1, 1]
    for s in range(t, min(later + _REJOIN_TICKS, ticks + 1)):
        cx, cy = plan.controls[s, 0], plan.controls[s, 1]
        change = step if s == t else -step if s == later else 0
        if axis == 0:
            cx += change
        else:
            cy += change
        ca, cb = to_motors(machine.bed, cx, cy)
        m += ca
        n += cb
        if m < 0 or n < 0 or m >= lower_a.shape[0] or n >= lower_b.shape[0]:
            return 0.0, t
        p, q = clip(p, lower_a[m], upper_a[m]), clip(q, lower_b[n], upper_b[n])
        rejoined = s >= later and p == belts[s, 0] and q == belts[s, 1]
        x, y = printed(machine.bed, p, q)
        # Where the nozzle is back, it still arrives by another way.
        saved += tick_cost(shares, wanted, s, bed[s - 1, 0], bed[s - 1, 1], bed[s, 0], bed[s, 1])
        saved -= tick_cost(shares, wanted, s, x0, y0, x, y)
        new.motors[s - t, 0], new.motors[s - t, 1] = m, n
        new.belts[s - t, 0], new.belts[s - t, 1] = p, q
        new.bed[s - t, 0], new.bed[s - t, 1] = x, y
        if rejoined:
            return saved, s + 1
        x0, y0 = x, y
    if later + _REJOIN_TICKS > ticks:  # the plan ends before they rejoin: nothing comes after
        return saved, ticks + 1
    return 0.0, t


@entry
def refine(shares, wanted, machine, plan, c_max, apart):
    """Go once over a plan and keep every edit that saves; return how many did.

    ``shares`` are `SQUARES` or `AREA`, ``machine`` a `Lattice`; the arrays of ``plan``, a `Print`, are changed in
    place. ``apart`` [D] are the ticks between the two ends of an edit.
    """
    controls = plan.controls
    ticks = controls.shape[0] - 1
    room = int(apart.max()) + _REJOIN_TICKS + 1
    new = Print(controls, np.empty((room, 2), np.int64), np.empty((room, 2)), np.empty((room, 2)))
    kept = 0
    for t in range(1, ticks + 1):
        for distance in apart:
            later = t + distance
            if later > ticks:
                continue
            for axis in range(2):
                for step in (1, -1, 2, -2):
                    if abs(controls[t, axis] + step) > c_max or abs(controls[later, axis] - step) > c_max:
                        continue
                    saved, end = edited(shares, wanted, machine, plan, new, t, later, axis, step)
                    if saved > _LEAST_SAVING:
                        controls[t, axis] += step
                        controls[later, axis] -= step
                        for s in range(t, end):
                            for k in range(2):
                                plan.motors[s, k] = new.motors[s - t, k]
                                plan.belts[s, k] = new.belts[s - t, k]
                                plan.bed[s, k] = new.bed[s - t, k]
                        kept += 1
    return kept


@entry
def total(shares, wanted, bed):
    """Return the sum of the costs of all ticks of a print ``bed`` [T + 1, 2]."""
    value = 0.0
    for t in range(1, bed.shape[0]):
        value += tick_cost(shares, wanted, t, bed[t - 1, 0], bed[t - 1, 1], bed[t, 0], bed[t, 1])
    return value
