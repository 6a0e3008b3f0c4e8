"""Points along a path, and how far printed ones lie from the wanted path around their own place on it."""

import numpy as np

from printmend.jit import entry


@entry
def distances(wanted, printed, joined, near, out):
    """Fill out [P] with the distance of printed [P, 2] from the nearest of the wanted segments around each point.

    Segment j leads from wanted[j] to wanted[j + 1] where joined[j]; looked at are ``near`` of them to either side of
    the point's own, as far as the bead does not end. A point without any has the distance 0.
    """
    count = wanted.shape[0]
    for i in range(count):
        low, high = i, i
        while low > 0 and i - low < near + 1 and joined[low - 1]:
            low -= 1
        while high + 1 < count and high - i < near + 1 and joined[high]:
            high += 1
        best = np.inf
        for j in range(low, high):
            ax, ay = wanted[j + 1, 0] - wanted[j, 0], wanted[j + 1, 1] - wanted[j, 1]
            bx, by = printed[i, 0] - wanted[j, 0], printed[i, 1] - wanted[j, 1]
            size = ax * ax + ay * ay
            share = min(max((ax * bx + ay * by) / size, 0.0), 1.0) if size > 0.0 else 0.0
            dx, dy = bx - share * ax, by - share * ay
            best = min(best, dx * dx + dy * dy)
        out[i] = np.sqrt(best) if high > low else 0.0


# Its many parameters are the columns of a table of lines, and the two arrays that it fills.
@entry
def points(start, end, center, turn, sweep, radius, begin, finish, counts, jumped, out, at):
    """Fill out [N, 3] with points along lines [L]: ``counts`` + 1 of each, ends included, the first only where the head
    jumped there; at [N] with the part of the file that each is, from ``begin`` to ``finish``.

    Lines that ``turn`` are arcs about ``center`` [L, 2], over the angle ``sweep`` [L] rad.
    """
    row = 0
    for line in range(counts.shape[0]):
        arc = turn[line] != 0
        first = np.arctan2(start[line, 1] - center[line, 1], start[line, 0] - center[line, 0]) if arc else 0.0
        for step in range(0 if jumped[line] else 1, counts[line] + 1):
            share = step / counts[line]
            for axis in range(3):
                out[row, axis] = start[line, axis] + share * (end[line, axis] - start[line, axis])
            if arc and share < 1.0:
                angle = first + share * sweep[line]
                out[row, 0] = center[line, 0] + radius[line] * np.cos(angle)
                out[row, 1] = center[line, 1] + radius[line] * np.sin(angle)
            at[row] = begin[line] + share * (finish[line] - begin[line])
            row += 1
