"""Local search over small edits of a plan, for costs that no table of steps can hold. Checks happen in objective.py.

An edit makes one step earlier or later: a control grows by δ at tick t and shrinks by δ at a tick some later. The
machine is run again from there until its belts stand where they stood; the edit stays where the ticks in between cost
less. Ticks are counted 1…T, 0 is the start: ``wanted`` [T + 1, 2] holds the start and the targets.
"""

import numpy as np

from printmend.control.kernels.greedy import bed_position
from printmend.jit import entry

RMSE, P95, AREA, FRECHET = 0, 1, 2, 3
# Ticks by which a point may be early or late for the leash of FRECHET.
LEASH = 6
# After an edit the belts must be where they were within so many ticks.
_REJOIN = 60
# What a squared distance costs beside the objective itself: it decides where that is flat. More of it beside an area:
# most of the area that can be saved is, and the points stay where they were wanted.
_ANCHOR, _ANCHOR_AREA = 0.02, 0.3
_GAIN = 1e-9


@entry
def tick_cost(kind, wanted, t, x0, y0, x, y, threshold):
    """Return what tick t costs, which leads the nozzle from (x0, y0) to (x, y).

    RMSE: the squared distance from the target. P95: how far it is above the squared ``threshold``, at most half of
    that (beyond the percentile no further loss counts). AREA: what the moves of nozzle and target sweep between them,
    as two triangles. FRECHET: how far the squared distance from the nearest of the neighbouring targets is above the
    squared ``threshold``.
    """
    dx, dy = x - wanted[t, 0], y - wanted[t, 1]
    squared = dx * dx + dy * dy
    if kind == RMSE:
        return squared
    if kind == P95:
        return min(max(squared - threshold * threshold, 0.0), 0.5 * threshold * threshold) + _ANCHOR * squared
    if kind == AREA:
        ax, ay = wanted[t, 0] - wanted[t - 1, 0], wanted[t, 1] - wanted[t - 1, 1]
        bx, by = x - wanted[t - 1, 0], y - wanted[t - 1, 1]
        cx, cy = x0 - wanted[t - 1, 0], y0 - wanted[t - 1, 1]
        return (abs(ax * by - ay * bx) + abs(bx * cy - by * cx)) / 2 + _ANCHOR_AREA * squared
    least = squared
    for s in range(max(t - LEASH, 0), min(t + LEASH + 1, wanted.shape[0])):
        ex, ey = x - wanted[s, 0], y - wanted[s, 1]
        least = min(least, ex * ex + ey * ey)
    return max(least - threshold * threshold, 0.0) + _ANCHOR * squared


@entry
def edited(
    kind, wanted, controls, motors, belts, bed, t, later, axis, step, lower_a, upper_a, lower_b, upper_b, corexy,
    coefficients, origin, scale, threshold, new_motors, new_belts, new_bed,
):  # fmt: skip
    """Run the machine from tick t with controls[t, axis] + step and controls[later, axis] − step.

    Return (what that saves, the first tick that is as before); 0 saved where it does not rejoin the plan. The new ticks
    are in the scratch arrays, from t on.
    """
    ticks = controls.shape[0] - 1
    saved = 0.0
    m, n, p, q = motors[t - 1, 0], motors[t - 1, 1], belts[t - 1, 0], belts[t - 1, 1]
    x0, y0 = bed[t - 1, 0], bed[t - 1, 1]
    for s in range(t, min(later + _REJOIN, ticks + 1)):
        cx, cy = controls[s, 0], controls[s, 1]
        change = step if s == t else -step if s == later else 0
        if axis == 0:
            cx += change
        else:
            cy += change
        m += cx + cy if corexy else cx
        n += cx - cy if corexy else cy
        if m < 0 or n < 0 or m >= lower_a.shape[0] or n >= lower_b.shape[0]:
            return 0.0, t
        p, q = min(max(p, lower_a[m]), upper_a[m]), min(max(q, lower_b[n]), upper_b[n])
        if s >= later and p == belts[s, 0] and q == belts[s, 1]:
            # The nozzle arrives where it was, but by another way.
            x, y = bed[s, 0], bed[s, 1]
            before = tick_cost(kind, wanted, s, bed[s - 1, 0], bed[s - 1, 1], x, y, threshold)
            new_motors[s - t, 0], new_motors[s - t, 1] = m, n
            new_belts[s - t, 0], new_belts[s - t, 1] = p, q
            new_bed[s - t, 0], new_bed[s - t, 1] = x, y
            return saved + before - tick_cost(kind, wanted, s, x0, y0, x, y, threshold), s + 1
        x, y = bed_position(p, q, corexy, coefficients, origin, scale)
        saved += tick_cost(kind, wanted, s, bed[s - 1, 0], bed[s - 1, 1], bed[s, 0], bed[s, 1], threshold)
        saved -= tick_cost(kind, wanted, s, x0, y0, x, y, threshold)
        new_motors[s - t, 0], new_motors[s - t, 1] = m, n
        new_belts[s - t, 0], new_belts[s - t, 1] = p, q
        new_bed[s - t, 0], new_bed[s - t, 1] = x, y
        x0, y0 = x, y
    if later + _REJOIN > ticks:  # the plan ends before they rejoin: nothing comes after
        return saved, ticks + 1
    return 0.0, t


@entry
def refine(
    kind, wanted, controls, motors, belts, bed, lower_a, upper_a, lower_b, upper_b, corexy, coefficients, origin, scale,
    threshold, c_max, apart,
):  # fmt: skip
    """Go once over the plan and keep every edit that saves; return how many did.

    ``controls`` [T + 1, 2] (the first row is none), ``motors``, ``belts`` and ``bed`` [T + 1, 2] are the plan, changed
    in place. ``apart`` [D] are the ticks between the two ends of an edit.
    """
    ticks = controls.shape[0] - 1
    room = int(apart.max()) + _REJOIN + 1
    new_motors, new_belts, new_bed = np.empty((room, 2), np.int64), np.empty((room, 2)), np.empty((room, 2))
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
                    saved, end = edited(
                        kind, wanted, controls, motors, belts, bed, t, later, axis, step, lower_a, upper_a, lower_b,
                        upper_b, corexy, coefficients, origin, scale, threshold, new_motors, new_belts, new_bed,
                    )  # fmt: skip
                    if saved > _GAIN:
                        controls[t, axis] += step
                        controls[later, axis] -= step
                        for s in range(t, end):
                            for k in range(2):
                                motors[s, k] = new_motors[s - t, k]
                                belts[s, k] = new_belts[s - t, k]
                                bed[s, k] = new_bed[s - t, k]
                        kept += 1
    return kept


@entry
def leash(wanted, bed):
    """Return the discrete Fréchet distance of two paths [N, 2] whose walkers are never more than LEASH ticks apart.

    An upper bound of the true one, and equal to it where nobody needs to run farther ahead.
    """
    count, width = wanted.shape[0], 2 * LEASH + 1
    before, row = np.full(width, np.inf), np.full(width, np.inf)
    for i in range(count):
        for k in range(width):
            j = i + k - LEASH
            row[k] = np.inf
            if not 0 <= j < count:
                continue
            dx, dy = wanted[i, 0] - bed[j, 0], wanted[i, 1] - bed[j, 1]
            here = dx * dx + dy * dy
            way = 0.0 if i == 0 and j == 0 else np.inf
            if k > 0:
                way = min(way, row[k - 1])
            if i > 0:
                way = min(way, before[k])
                if k + 1 < width:
                    way = min(way, before[k + 1])
            row[k] = max(here, way)
        before, row = row, before
    return np.sqrt(before[LEASH])


@entry
def total(kind, wanted, bed, threshold):
    """Return the sum of the costs of all ticks."""
    value = 0.0
    for t in range(1, bed.shape[0]):
        value += tick_cost(kind, wanted, t, bed[t - 1, 0], bed[t - 1, 1], bed[t, 0], bed[t, 1], threshold)
    return value
