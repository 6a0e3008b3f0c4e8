"""The loop that finds the cheapest history of jumps. Arrays and scalars in, arrays out; checks in ladder.py."""

import numpy as np

from printmend.jit import entry


@entry
def cheapest_levels(cost, price, path):
    """Choose a level for every row so that the sum of ``cost`` and ``price`` for each rung climbed is least.

    ``cost`` [N, A, B] is what row t costs at level (a, b); going from (a, b) to (c, d) costs price·(|c − a| + |d − b|),
    starting at (a, b) half of that counted from the middle level. Fills ``path`` [N, 2]; returns the whole cost.
    """
    count, across, along = cost.shape
    best = np.empty((across, along))
    for a in range(across):
        for b in range(along):
            best[a, b] = cost[0, a, b] + 0.5 * price * (abs(a - across // 2) + abs(b - along // 2))
    origin = np.empty((count, across, along), np.int32)
    for t in range(1, count):
        back = origin[t]
        for a in range(across):
            for b in range(along):
                back[a, b] = a * along + b
        # The cheapest way to every level: the distance transform of |Δa| + |Δb|, two passes a direction.
        for a in range(across):
            for b in range(1, along):
                if best[a, b - 1] + price < best[a, b]:
                    best[a, b], back[a, b] = best[a, b - 1] + price, back[a, b - 1]
            for b in range(along - 2, -1, -1):
                if best[a, b + 1] + price < best[a, b]:
                    best[a, b], back[a, b] = best[a, b + 1] + price, back[a, b + 1]
        for b in range(along):
            for a in range(1, across):
                if best[a - 1, b] + price < best[a, b]:
                    best[a, b], back[a, b] = best[a - 1, b] + price, back[a - 1, b]
            for a in range(across - 2, -1, -1):
                if best[a + 1, b] + price < best[a, b]:
                    best[a, b], back[a, b] = best[a + 1, b] + price, back[a + 1, b]
        best += cost[t]
    level, least = 0, np.inf
    for a in range(across):
        for b in range(along):
            if best[a, b] < least:
                level, least = a * along + b, best[a, b]
    for t in range(count - 1, -1, -1):
        path[t, 0], path[t, 1] = level // along, level % along
        if t > 0:
            level = origin[t, level // along, level % along]
    return least
