"""Dynamic programming over one motor with play: the least sum of squared errors, exact within a window.

The carriage only ever stands where a branch of the play put it, at some lower[m] or upper[m], or at its start. So
the states of a tick are pairs (k, m): ``places[k]``, the sorted distinct positions of those tables, and a motor index
m that leaves the carriage there, first[k] ≤ m ≤ last[k]. One control moves m freely inside that range, or beyond its
end, which pushes the carriage to place low[m] (lower[m]) or high[m] (upper[m]).

``costs[t, k − left[t], m − first[k]]`` is the least cost of being in a state at tick t; a tick's window is the places
left[t] ≤ k < right[t].
"""

import numpy as np
from numba import njit


@njit(cache=True, inline="always")
def least_of_neighbours(source, length, c_max, ahead, near):
    """Fill near[:length] with the least of source[j − c_max … j + c_max], j < length. ``ahead`` is scratch."""
    if length <= 2 * c_max + 1:
        # Every neighbourhood reaches one end: those of j ≤ c_max the first entry, the others the last one.
        ahead[0] = source[0]
        for j in range(1, length):
            ahead[j] = min(ahead[j - 1], source[j])
        for j in range(min(c_max + 1, length)):
            near[j] = ahead[min(j + c_max, length - 1)]
        least = np.inf
        for j in range(length - 1, 0, -1):
            least = min(least, source[j])
            if j + c_max < length:
                near[j + c_max] = least
        return
    for j in range(c_max):
        ahead[j] = np.inf
        ahead[length + c_max + j] = np.inf
    for j in range(length):
        ahead[j + c_max] = source[j]
    # Double the number looked at as long as it stays within the neighbourhood.
    covered, end = 1, length + 2 * c_max
    while 2 * covered <= 2 * c_max + 1:
        for j in range(end - 2 * covered + 1):
            ahead[j] = ahead[j + covered] if ahead[j + covered] < ahead[j] else ahead[j]
        covered *= 2
    rest = 2 * c_max + 1 - covered
    for j in range(length):
        near[j] = ahead[j + rest] if ahead[j + rest] < ahead[j] else ahead[j]


@njit(cache=True)
def advance(before, left0, right0, after, left, right, target, places, first, last, low, high, c_max, ahead, near):
    """Fill ``after``, the costs of one tick, from ``before``, those of the tick before it."""
    for k in range(left, right):
        for j in range(last[k] - first[k] + 1):
            after[k - left, j] = np.inf
    for m in range(max(last[left0] + 1 - c_max, 0), last[right0 - 1] + 1):
        best, k, end = np.inf, max(low[m], left0), min(right0, high[m] + 1)
        for reached in range(m + 1, min(m + c_max + 1, low.shape[0])):
            place = low[reached]
            while k < min(place, end):
                best = min(best, before[k - left0, m - first[k]])
                k += 1
            if left <= place < right:
                j = reached - first[place]
                after[place - left, j] = min(after[place - left, j], best)
    for m in range(first[left0], min(first[right0 - 1] + c_max, low.shape[0])):
        best, k, end = np.inf, min(high[m], right0 - 1), max(left0, low[m])
        for reached in range(m - 1, max(m - c_max, 0) - 1, -1):
            place = high[reached]
            while k > place and k >= end:
                best = min(best, before[k - left0, m - first[k]])
                k -= 1
            if left <= place < right:
                j = reached - first[place]
                after[place - left, j] = min(after[place - left, j], best)
    for k in range(left, right):
        row, length = after[k - left], last[k] - first[k] + 1
        missed = places[k] - target
        missed *= missed
        if left0 <= k < right0:
            least_of_neighbours(before[k - left0], length, c_max, ahead, near)
            for j in range(length):
                row[j] = (near[j] if near[j] < row[j] else row[j]) + missed
        else:
            for j in range(length):
                row[j] += missed


@njit(cache=True)
def parent(before, left0, right0, k, m, first, last, low, high, c_max):
    """Return the state (k, m) of the tick before from which (k, m) is reached at the least cost."""
    best, best_k, best_m = np.inf, -1, -1
    if left0 <= k < right0:
        for step in range(c_max + 1):
            for m0 in (m - step, m + step):
                if first[k] <= m0 <= last[k] and before[k - left0, m0 - first[k]] < best:
                    best, best_k, best_m = before[k - left0, m0 - first[k]], k, m0
    if k == low[m]:
        for m0 in range(m - 1, max(m - c_max, 0) - 1, -1):
            for k0 in range(max(low[m0], left0), min(k, high[m0] + 1, right0)):
                if before[k0 - left0, m0 - first[k0]] < best:
                    best, best_k, best_m = before[k0 - left0, m0 - first[k0]], k0, m0
    if k == high[m]:
        for m0 in range(m + 1, min(m + c_max + 1, low.shape[0])):
            for k0 in range(max(k + 1, low[m0], left0), min(high[m0] + 1, right0)):
                if before[k0 - left0, m0 - first[k0]] < best:
                    best, best_k, best_m = before[k0 - left0, m0 - first[k0]], k0, m0
    return best_k, best_m


@njit(cache=True)
def search(targets, k_start, m_start, places, first, last, low, high, left, right, c_max, block, width, motor):
    """Fill ``motor`` [T + 1] with the indices of a cheapest plan for targets [T]; return its cost.

    Keeps the costs of one block of ticks and of the first tick of every block: a block is made again when the way
    back passes through it. ``width`` is the longest row.
    """
    ticks = targets.shape[0]
    blocks = (ticks + block - 1) // block
    height = 0
    for t in range(ticks + 1):
        height = max(height, right[t] - left[t])
    marks = np.empty((blocks, height, width))
    costs = np.empty((min(block, ticks) + 1, height, width))
    ahead, near = np.empty(width + 2 * c_max), np.empty(width)
    for k in range(left[0], right[0]):
        marks[0, k - left[0]] = np.inf
    marks[0, k_start - left[0], m_start - first[k_start]] = 0.0
    k, m, total = -1, -1, np.inf
    for b in range(2 * blocks - 1):
        # Forward over all blocks, then back over all but the last, whose costs are still there.
        here = b if b < blocks else 2 * blocks - 2 - b
        begin, end = here * block, min((here + 1) * block, ticks)
        costs[0] = marks[here]
        for t in range(begin, end):
            i = t - begin
            advance(
                costs[i], left[t], right[t], costs[i + 1], left[t + 1], right[t + 1], targets[t],
                places, first, last, low, high, c_max, ahead, near,
            )  # fmt: skip
        if b < blocks - 1:
            marks[b + 1] = costs[end - begin]
            continue
        if b == blocks - 1:
            for k0 in range(left[ticks], right[ticks]):
                for m0 in range(first[k0], last[k0] + 1):
                    value = costs[end - begin, k0 - left[ticks], m0 - first[k0]]
                    if value < total:
                        total, k, m = value, k0, m0
            motor[ticks] = m
        for t in range(end - 1, begin - 1, -1):
            k, m = parent(costs[t - begin], left[t], right[t], k, m, first, last, low, high, c_max)
            motor[t] = m
    return total


@njit(cache=True)
def follow(motor, position, lower, upper, out):
    """Fill out [T + 1] with the positions of a carriage whose motor takes the indices [T + 1]."""
    out[0] = position
    for t in range(1, motor.shape[0]):
        position = min(max(position, lower[motor[t]]), upper[motor[t]])
        out[t] = position
