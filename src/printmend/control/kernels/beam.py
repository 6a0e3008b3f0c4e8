"""Beam search over two coupled motors, guided by each motor's own least cost to go. Checks happen in beam.py.

States as in optimal.py: a motor index m and the place k where the carriage's belt stands.
"""

import numpy as np
from numba import njit

from printmend.control.kernels.greedy import bed_position

# States that rank so far behind the best, in squared steps, hardly ever lead to the best plan; without them it is
# found sooner, and where the beam is full a little better.
_BEHIND = 0.7


@njit(cache=True, inline="always")
def moved(k, m, low, high):
    """Return the place of a belt at place k once its motor is at m."""
    return min(max(k, low[m]), high[m])


@njit(cache=True)
def costs_to_go(targets, places, first, last, low, high, left, right, c_max, out):
    """Fill out [T + 1, R, W] with the least cost of targets t…T − 1 from each state (k, m) at tick t, one motor alone.

    Index: k − left[t], m − first[k]. The last tick costs nothing; states that must leave the window cost infinity.
    """
    out[:] = np.inf
    ticks = targets.shape[0]
    for k in range(left[ticks], right[ticks]):
        out[ticks, k - left[ticks], : last[k] - first[k] + 1] = 0.0
    for t in range(ticks - 1, -1, -1):
        for k in range(left[t], right[t]):
            for m in range(first[k], last[k] + 1):
                best = np.inf
                for m1 in range(max(m - c_max, 0), min(m + c_max + 1, low.shape[0])):
                    k1 = moved(k, m1, low, high)
                    if left[t + 1] <= k1 < right[t + 1]:
                        missed = places[k1] - targets[t]
                        value = missed * missed + out[t + 1, k1 - left[t + 1], m1 - first[k1]]
                        best = min(best, value)
                out[t, k - left[t], m - first[k]] = best


@njit(cache=True)
def search(
    targets, beam, count, togo_a, togo_b, places_a, places_b, first_a, first_b, low_a, low_b, high_a, high_b,
    left_a, left_b, right_a, right_b, weight, c_max, corexy, coefficients, origin, scale, width, parents, controls,
    costs,
):  # fmt: skip
    """Follow the ``width`` best distinct states for targets [T]; return how many remain.

    ``beam`` [width, 4] holds (k_a, m_a, k_b, m_b), ``costs`` [width] what they have cost so far, ``count`` how many
    there are; they are replaced by those of the last tick. ``parents`` [T, width] and ``controls`` [T, width, 2] lead
    back. States are ranked by cost so far + weight·(both motors' costs to go).
    """
    span = 2 * c_max if corexy else c_max
    fan = 2 * span + 1
    size = 1
    while size < 4 * width * (2 * c_max + 1) ** 2:
        size *= 2
    slots = np.full(size, -1, np.int64)
    limit = width * (2 * c_max + 1) ** 2
    found, value, rank = np.empty((limit, 4), np.int64), np.empty(limit), np.empty(limit)
    origin_of, chosen, slot_of = np.empty(limit, np.int64), np.empty((limit, 2), np.int64), np.empty(limit, np.int64)
    k1a, k1b, ha, hb = np.empty(fan, np.int64), np.empty(fan, np.int64), np.empty(fan), np.empty(fan)
    margin = np.inf
    for t in range(targets.shape[0]):
        total, leader = 0, np.inf
        for s in range(count):
            ka, ma, kb, mb = beam[s, 0], beam[s, 1], beam[s, 2], beam[s, 3]
            for i in range(fan):
                # Outside the windows a state is only as good as nothing: it stays behind all others.
                m = ma + i - span
                ha[i] = np.inf
                if 0 <= m < low_a.shape[0]:
                    k1a[i] = moved(ka, m, low_a, high_a)
                    ha[i] = 1e9
                    if left_a[t + 1] <= k1a[i] < right_a[t + 1]:
                        ha[i] = weight * togo_a[t + 1, k1a[i] - left_a[t + 1], m - first_a[k1a[i]]]
                m = mb + i - span
                hb[i] = np.inf
                if 0 <= m < low_b.shape[0]:
                    k1b[i] = moved(kb, m, low_b, high_b)
                    hb[i] = 1e9
                    if left_b[t + 1] <= k1b[i] < right_b[t + 1]:
                        hb[i] = weight * togo_b[t + 1, k1b[i] - left_b[t + 1], m - first_b[k1b[i]]]
            for cx in range(-c_max, c_max + 1):
                for cy in range(-c_max, c_max + 1):
                    ca, cb = (cx + cy, cx - cy) if corexy else (cx, cy)
                    i, j = ca + span, cb + span
                    ahead = costs[s] + ha[i] + hb[j]
                    if not ahead < leader + margin:
                        continue
                    x, y = bed_position(places_a[k1a[i]], places_b[k1b[j]], corexy, coefficients, origin, scale)
                    dx, dy = targets[t, 0] - x, targets[t, 1] - y
                    error = dx * dx + dy * dy
                    score = ahead + error
                    if not score < leader + margin:
                        continue
                    leader = min(leader, score)
                    m1a, m1b = ma + ca, mb + cb
                    slot = ((k1a[i] * 73856093) ^ (m1a * 19349663) ^ (k1b[j] * 83492791) ^ (m1b * 49979687)) & (
                        size - 1
                    )
                    while True:
                        n = slots[slot]
                        if n < 0:
                            slots[slot], slot_of[total] = total, slot
                            n, total = total, total + 1
                            value[n] = np.inf
                            found[n, 0], found[n, 1], found[n, 2], found[n, 3] = k1a[i], m1a, k1b[j], m1b
                        elif found[n, 0] != k1a[i] or found[n, 1] != m1a or found[n, 2] != k1b[j] or found[n, 3] != m1b:
                            slot = (slot + 1) & (size - 1)
                            continue
                        if costs[s] + error < value[n]:
                            value[n], rank[n], origin_of[n] = costs[s] + error, score, s
                            chosen[n, 0], chosen[n, 1] = cx, cy
                        break
        for n in range(total):
            slots[slot_of[n]] = -1
        bar = np.inf
        if total > width:
            bar = np.partition(rank[:total], width - 1)[width - 1]
        bar = min(bar, leader + _BEHIND)
        count, worst = 0, -np.inf
        for n in range(total):
            if rank[n] <= bar and count < width:
                beam[count] = found[n]
                costs[count] = value[n]
                parents[t, count] = origin_of[n]
                controls[t, count] = chosen[n]
                worst = max(worst, rank[n])
                count += 1
        margin = max(2.0 * (worst - leader), 1.0)
    return count


@njit(cache=True)
def way_back(parents, controls, state, out):
    """Fill out [T, 2] with the controls that lead to ``state`` of the last tick; return its ancestor at the first."""
    for t in range(parents.shape[0] - 1, -1, -1):
        out[t] = controls[t, state]
        state = parents[t, state]
    return state
