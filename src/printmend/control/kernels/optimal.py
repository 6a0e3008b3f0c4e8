"""Dynamic programming over one motor with play: the least sum of squared errors, exact within a window.

The carriage only ever stands where a branch of the play put it, at some lower[m] or upper[m], or at its start. So
the states of a tick are pairs (k, m): ``places[k]``, the sorted distinct positions of those tables, and a motor index
m that leaves the carriage there, first[k] ≤ m ≤ last[k]. One control moves m freely inside that range, or beyond its
end, which pushes the carriage to place low[m] (lower[m]) or high[m] (upper[m]).

A tick's window is the places left[t] ≤ k < right[t]. The least cost of being in state (k, m) at tick t is
``costs[base + (k − left[t])·width + m − first[k]]``, with ``base`` the tick's place in the array: flat, since making
views inside the loops would cost more than the loops.
"""

import numpy as np
from numba import njit


@njit(cache=True, inline="always")
def least_of_neighbours(costs, row, length, c_max, ahead, near):
    """Fill near[:length] with the least of costs[row + j − c_max … row + j + c_max]. ``ahead`` is scratch."""
    if length <= 2 * c_max + 1:
        # Every neighbourhood reaches one end: those of j ≤ c_max the first entry, the others the last one.
        least = np.inf
        for j in range(length):
            least = min(least, costs[row + j])
            ahead[j] = least
        for j in range(min(c_max + 1, length)):
            near[j] = ahead[min(j + c_max, length - 1)]
        least = np.inf
        for j in range(length - 1, 0, -1):
            least = min(least, costs[row + j])
            if j + c_max < length:
                near[j + c_max] = least
        return
    for j in range(c_max):
        ahead[j] = np.inf
        ahead[length + c_max + j] = np.inf
    for j in range(length):
        ahead[j + c_max] = costs[row + j]
    # Double the number looked at as long as it stays within the neighbourhood.
    covered, end = 1, length + 2 * c_max
    while 2 * covered <= 2 * c_max + 1:
        for j in range(end - 2 * covered + 1):
            ahead[j] = min(ahead[j], ahead[j + covered])
        covered *= 2
    rest = 2 * c_max + 1 - covered
    for j in range(length):
        near[j] = min(ahead[j], ahead[j + rest])


@njit(cache=True)
def advance(
    costs, base0, left0, right0, base, left, right, width, target, places, first, last, low, high, c_max, ahead, near
):  # fmt: skip
    """Fill the costs of one tick, at ``base``, from those of the tick before it, at ``base0``."""
    for k in range(left, right):
        row, length = base + (k - left) * width, last[k] - first[k] + 1
        if left0 <= k < right0:
            least_of_neighbours(costs, base0 + (k - left0) * width, length, c_max, ahead, near)
            for j in range(length):
                costs[row + j] = near[j]
        else:
            for j in range(length):
                costs[row + j] = np.inf
    size = low.shape[0]
    for m in range(max(last[left0] + 1 - c_max, 0), last[right0 - 1] + 1):
        best, k, end = np.inf, max(low[m], left0), min(right0, high[m] + 1)
        for reached in range(m + 1, min(m + c_max + 1, size)):
            place = low[reached]
            while k < min(place, end):
                best = min(best, costs[base0 + (k - left0) * width + m - first[k]])
                k += 1
            if left <= place < right:
                at = base + (place - left) * width + reached - first[place]
                costs[at] = min(costs[at], best)
    for m in range(first[left0], min(first[right0 - 1] + c_max, size)):
        best, k, end = np.inf, min(high[m], right0 - 1), max(left0, low[m])
        for reached in range(m - 1, max(m - c_max, 0) - 1, -1):
            place = high[reached]
            while k > place and k >= end:
                best = min(best, costs[base0 + (k - left0) * width + m - first[k]])
                k -= 1
            if left <= place < right:
                at = base + (place - left) * width + reached - first[place]
                costs[at] = min(costs[at], best)
    for k in range(left, right):
        row = base + (k - left) * width
        missed = places[k] - target
        missed *= missed
        for j in range(last[k] - first[k] + 1):
            costs[row + j] += missed


@njit(cache=True)
def parent(costs, base0, left0, right0, width, k, m, first, last, low, high, c_max):
    """Return the state (k, m) of the tick before from which (k, m) is reached at the least cost."""
    best, best_k, best_m = np.inf, -1, -1
    if left0 <= k < right0:
        row = base0 + (k - left0) * width - first[k]
        for step in range(c_max + 1):  # at rest if possible
            for m0 in (m - step, m + step):
                if first[k] <= m0 <= last[k] and costs[row + m0] < best:
                    best, best_k, best_m = costs[row + m0], k, m0
    if k == low[m]:
        for m0 in range(m - 1, max(m - c_max, 0) - 1, -1):
            for k0 in range(max(low[m0], left0), min(k, high[m0] + 1, right0)):
                value = costs[base0 + (k0 - left0) * width + m0 - first[k0]]
                if value < best:
                    best, best_k, best_m = value, k0, m0
    if k == high[m]:
        for m0 in range(m + 1, min(m + c_max + 1, low.shape[0])):
            for k0 in range(max(k + 1, low[m0], left0), min(high[m0] + 1, right0)):
                value = costs[base0 + (k0 - left0) * width + m0 - first[k0]]
                if value < best:
                    best, best_k, best_m = value, k0, m0
    return best_k, best_m


@njit(cache=True)
def search(
    targets, k_start, m_start, places, first, last, low, high, left, right, c_max, block, width, height, motor
):  # fmt: skip
    """Fill ``motor`` [T + 1] with the indices of a cheapest plan for targets [T]; return its cost.

    Keeps the costs of one block of ticks and of the first tick of every block: a block is made again when the way
    back passes through it. ``width`` is the longest row, ``height`` the most rows of a tick.
    """
    ticks = targets.shape[0]
    blocks = (ticks + block - 1) // block
    tick = width * height
    marks = np.full((blocks, tick), np.inf)
    costs = np.empty((min(block, ticks) + 1) * tick)
    ahead, near = np.empty(width + 2 * c_max), np.empty(width)
    marks[0, (k_start - left[0]) * width + m_start - first[k_start]] = 0.0
    k, m, total = -1, -1, np.inf
    for b in range(2 * blocks - 1):
        # Forward over all blocks, then back over all but the last, whose costs are still there.
        here = b if b < blocks else 2 * blocks - 2 - b
        begin, end = here * block, min((here + 1) * block, ticks)
        costs[:tick] = marks[here]
        for t in range(begin, end):
            base = (t - begin) * tick
            advance(
                costs, base, left[t], right[t], base + tick, left[t + 1], right[t + 1], width, targets[t],
                places, first, last, low, high, c_max, ahead, near,
            )  # fmt: skip
        if b < blocks - 1:
            marks[b + 1] = costs[(end - begin) * tick : (end - begin + 1) * tick]
            continue
        if b == blocks - 1:
            for k0 in range(left[ticks], right[ticks]):
                for m0 in range(first[k0], last[k0] + 1):
                    value = costs[(end - begin) * tick + (k0 - left[ticks]) * width + m0 - first[k0]]
                    if value < total:
                        total, k, m = value, k0, m0
            motor[ticks] = m
        for t in range(end - 1, begin - 1, -1):
            k, m = parent(
                costs, (t - begin) * tick, left[t], right[t], width, k, m, first, last, low, high, c_max
            )  # fmt: skip
            motor[t] = m
    return total


@njit(cache=True)
def follow(motor, position, lower, upper, out):
    """Fill out [T + 1] with the positions of a carriage whose motor takes the indices [T + 1]."""
    out[0] = position
    for t in range(1, motor.shape[0]):
        position = min(max(position, lower[motor[t]]), upper[motor[t]])
        out[t] = position
