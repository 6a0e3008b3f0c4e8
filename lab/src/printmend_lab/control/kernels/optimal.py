"""Dynamic programming over one motor with play: the least sum of squared errors, exact within a window.

The carriage only ever stands where a branch of the play put it, at some lower[m] or upper[m], or at its start. So
the states of a tick are pairs (k, m): ``places[k]``, the sorted distinct positions of those tables, and a motor index
m that leaves the carriage there, first[k] ≤ m ≤ last[k]. A control moves m by at most c_max, and then the play clips:
k ← clip(k, low[m], high[m]).

A tick's window is the places left[t] ≤ k < right[t]; its motor indices are m0 = first[left[t]] … last[right[t] − 1].
The least cost of being in state (k, m) at tick t is ``costs[base[t] + (m − m0)·rows + k − left[t]]``, rows = right −
left, infinite where the two do not go together. Flat and dense: moving the motor is then a running minimum over the
whole tick, which the compiler turns into vector instructions, and the clip folds what sticks out of each column into
its ends.
"""

import numpy as np

from printmend.jit import entry, inner


@inner(error_model="python", _nrt=True)
def lesser(one, other, out):
    """Fill out with the lesser of two arrays, entry by entry of the first."""
    for i in range(one.shape[0]):
        out[i] = min(one[i], other[i])


@inner(error_model="python", _nrt=True)
def spread(costs, base, m0, m1, rows, n0, n1, c_max, first, second):
    """Return the least costs about each of the motor indices n0…n1, c_max to either side, in one of the scratches.

    ``costs`` from ``base`` hold the columns m0…m1. Entry (m − n0)·rows + row is the least of that row in the columns
    m − c_max…m + c_max.
    """
    size = (n1 - n0 + 1 + 2 * c_max) * rows
    begin, end = max(m0, n0 - c_max), min(m1, n1 + c_max) + 1
    skip = (begin - n0 + c_max) * rows
    length = max(end - begin, 0) * rows
    source = base + (begin - m0) * rows
    # The columns and their neighbours to the right; none are beyond the two ends. Slices, though they look dear: with
    # sums as indices the compiler finds no vectors.
    size -= rows
    edge = skip + length
    first[: min(max(skip - rows, 0), size)] = np.inf
    if length > 0:
        if skip > 0:
            first[skip - rows : skip] = costs[source : source + rows]
        lesser(costs[source : source + length - rows], costs[source + rows : source + length], first[skip:])
        if edge <= size:
            first[edge - rows : edge] = costs[source + length - rows : source + length]
            first[edge:size] = np.inf
    else:
        first[:size] = np.inf
    covered = 2
    while 2 * covered <= 2 * c_max + 1:
        size -= covered * rows
        lesser(first[:size], first[covered * rows : covered * rows + size], second[:size])
        first, second = second, first
        covered *= 2
    size, rest = (n1 - n0 + 1) * rows, (2 * c_max + 1 - covered) * rows
    lesser(first[:size], first[rest : rest + size], second[:size])
    return second


# From here on the many parameters are the arrays of one motor's `window`, and where in `costs` a tick's costs lie.
@inner(error_model="python", _nrt=True)
def advance(
    costs, base0, left0, right0, base, left, right, target, places, first, last, low, high, c_max, missed, one, other
):  # fmt: skip
    """Fill the costs of one tick, at ``base``, from those of the tick before it, at ``base0``."""
    rows0, rows = right0 - left0, right - left
    n0, n1, final = first[left], last[right - 1], low.shape[0] - 1
    near = spread(costs, base0, first[left0], last[right0 - 1], rows0, n0, n1, c_max, one, other)
    for row in range(rows):
        error = places[left + row] - target
        missed[row] = error * error
    costs[base : base + (n1 - n0 + 1) * rows] = np.inf
    # Unsigned indices: signed ones might count from the end, and asking that costs a seventh of the time.
    for m in range(n0, n1 + 1):
        at, source = base + (m - n0) * rows - left, (m - n0) * rows0 - left0
        lowest, highest = low[m], high[m]
        for k in range(max(lowest + 1, left, left0), min(highest, right, right0)):
            costs[np.uintp(at + k)] = near[np.uintp(source + k)] + missed[np.uintp(k - left)]
        if left <= lowest < right:
            best = np.inf
            for k in range(max(low[max(m - c_max, 0)], left0), min(lowest + 1, right0)):
                best = min(best, near[np.uintp(source + k)])
            costs[at + lowest] = best + missed[lowest - left]
        if left <= highest < right:
            best = np.inf
            for k in range(max(highest, left0), min(high[min(m + c_max, final)] + 1, right0)):
                best = min(best, near[np.uintp(source + k)])
            costs[at + highest] = min(costs[at + highest], best + missed[highest - left])


@inner(error_model="python", _nrt=True)
def parent(costs, base0, left0, right0, k, m, first, last, low, high, c_max):
    """Return the state (k, m) of the tick before from which (k, m) is reached at least cost."""
    best, best_k, best_m = np.inf, -1, -1
    rows, m0, m1 = right0 - left0, first[left0], last[right0 - 1]
    at = base0 - m0 * rows - left0
    if left0 <= k < right0:
        for step in range(c_max + 1):  # at rest if possible
            for n in (m - step, m + step):
                if first[k] <= n <= last[k] and costs[at + n * rows + k] < best:
                    best, best_k, best_m = costs[at + n * rows + k], k, n
    if k == low[m]:
        for n in range(min(m - 1, m1), max(m - c_max, m0) - 1, -1):
            for k0 in range(max(low[n], left0), min(k, high[n] + 1, right0)):
                if costs[at + n * rows + k0] < best:
                    best, best_k, best_m = costs[at + n * rows + k0], k0, n
    if k == high[m]:
        for n in range(max(m + 1, m0), min(m + c_max, m1) + 1):
            for k0 in range(max(k + 1, low[n], left0), min(high[n] + 1, right0)):
                if costs[at + n * rows + k0] < best:
                    best, best_k, best_m = costs[at + n * rows + k0], k0, n
    return best_k, best_m


@inner(error_model="python", _nrt=True)
def settled(costs, base, begin, end, left, right, first, last, low, high, c_max, states, seen):
    """Return the last tick, and its state, that the cheapest ways to all states of tick ``end`` have in common.

    ``base`` [ticks] are counted from tick ``begin``, which is a single state. ``states`` [2, N, 2] and ``seen`` [N] are
    scratch for the states of a tick; ``seen`` comes and goes as zeros.
    """
    count, now = 0, 0
    for m in range(first[left[end]], last[right[end] - 1] + 1):
        for k in range(max(left[end], low[m]), min(right[end], high[m] + 1)):
            at = base[end - begin] + (m - first[left[end]]) * (right[end] - left[end]) + k - left[end]
            if costs[at] < np.inf:
                states[now, count, 0], states[now, count, 1] = k, m
                count += 1
    t = end
    while count > 1:
        t -= 1
        found = 0
        rows, m0 = right[t] - left[t], first[left[t]]
        for n in range(count):
            k, m = parent(
                costs, base[t - begin], left[t], right[t], states[now, n, 0], states[now, n, 1], first, last, low, high,
                c_max,
            )  # fmt: skip
            at = (m - m0) * rows + k - left[t]
            if seen[at] == 0:
                seen[at] = 1
                states[1 - now, found, 0], states[1 - now, found, 1] = k, m
                found += 1
        now = 1 - now
        for n in range(found):
            seen[(states[now, n, 1] - m0) * rows + states[now, n, 0] - left[t]] = 0
        count = found
    return t, states[now, 0, 0], states[now, 0, 1]


@inner(error_model="python", _nrt=True)
def way_back(costs, base, begin, t, k, m, left, right, first, last, low, high, c_max, motor):
    """Fill motor[begin : t + 1] with the indices of the cheapest way to state (k, m) of tick t."""
    motor[t] = m
    while t > begin:
        t -= 1
        k, m = parent(costs, base[t - begin], left[t], right[t], k, m, first, last, low, high, c_max)
        motor[t] = m


@entry
def search(targets, k_start, m_start, places, first, last, low, high, left, right, c_max, room, motor):
    """Fill ``motor`` [T + 1] with the indices of a cheapest plan for targets [T]; return its cost.

    About ``room`` costs are kept. When they fill up, the ways to all states of the newest tick are followed back until
    they are one: all before that is decided, and its costs are dropped. Only where they stay apart is more room made.
    """
    ticks = targets.shape[0]
    height, broad = 0, 0
    for t in range(ticks + 1):
        height = max(height, right[t] - left[t])
        broad = max(broad, last[right[t] - 1] - first[left[t]] + 1)
    largest = height * broad
    costs = np.empty(max(room, 3 * largest))
    base = np.empty(ticks + 1, np.int64)
    missed, scratch = np.empty(height), np.empty((2, height * (broad + 2 * c_max)))
    states, seen = np.empty((2, largest, 2), np.int64), np.zeros(largest, np.int8)
    rows, begin, base[0] = right[0] - left[0], 0, 0
    used = rows * (last[right[0] - 1] - first[left[0]] + 1)
    costs[:used] = np.inf
    costs[(m_start - first[left[0]]) * rows + k_start - left[0]] = 0.0
    for t in range(ticks):
        size = (right[t + 1] - left[t + 1]) * (last[right[t + 1] - 1] - first[left[t + 1]] + 1)
        if used + size > costs.shape[0]:
            here, k, m = settled(costs, base, begin, t, left, right, first, last, low, high, c_max, states, seen)
            way_back(costs, base, begin, here, k, m, left, right, first, last, low, high, c_max, motor)
            dropped = base[here - begin]
            kept = costs if 2 * (used - dropped) <= costs.shape[0] else np.empty(2 * costs.shape[0])
            for i in range(used - dropped):
                kept[i] = costs[dropped + i]
            for i in range(t - here + 1):
                base[i] = base[here - begin + i] - dropped
            costs, begin, used = kept, here, used - dropped
        base[t + 1 - begin] = used
        advance(
            costs, base[t - begin], left[t], right[t], used, left[t + 1], right[t + 1], targets[t],
            places, first, last, low, high, c_max, missed, scratch[0], scratch[1],
        )  # fmt: skip
        used += size
    total, k_end, m_end = np.inf, -1, -1
    rows, m0 = right[ticks] - left[ticks], first[left[ticks]]
    for k in range(left[ticks], right[ticks]):
        for m in range(first[k], last[k] + 1):
            value = costs[base[ticks - begin] + (m - m0) * rows + k - left[ticks]]
            if value < total:
                total, k_end, m_end = value, k, m
    way_back(costs, base, begin, ticks, k_end, m_end, left, right, first, last, low, high, c_max, motor)
    return total
