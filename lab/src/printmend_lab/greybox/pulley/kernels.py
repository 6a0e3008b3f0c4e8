"""What is touched of a hull of discs, and the belt that it has unwound. Arrays in, arrays out."""

import numpy as np

from printmend.jit import entry


@entry
def hull_edges(discs, waves, edges, which):
    """Find where the discs [M, 3] (ρ, x, y) of h = max ρ + x cos t − y sin t hand over to one another; return how many
    edges E there are, 0 where one disc is touched all around.

    ``waves`` [3, F] are (1, cos t, −sin t) at F even angles t of a turn. Fills ``edges`` [E], which go up, and the disc
    ``which`` [E] that is touched after each; ``which[0]`` is the only one where there is no edge.
    """
    fine = waves.shape[1]
    step = 2 * np.pi / fine
    count, first, before = 0, 0, 0
    for j in range(fine + 1):
        active, most = 0, -np.inf
        if j < fine:
            for i in range(discs.shape[0]):
                height = discs[i, 0] + discs[i, 1] * waves[1, j] + discs[i, 2] * waves[2, j]
                if height > most:
                    active, most = i, height
        else:
            active = first
        if j == 0:
            first = active
        elif active != before:
            # ρ + x cos t − y sin t = 0 for the difference of the two
            size = discs[before, 0] - discs[active, 0]
            x, y = discs[before, 1] - discs[active, 1], discs[before, 2] - discs[active, 2]
            middle = np.arctan2(-y, x)
            half = np.arccos(min(max(-size / max(np.hypot(x, y), 1e-300), -1.0), 1.0))
            low = (j - 1) * step
            near = low + step / 2
            one = near + (middle - half - near + np.pi) % (2 * np.pi) - np.pi
            two = near + (middle + half - near + np.pi) % (2 * np.pi) - np.pi
            edge = one if abs(one - near) <= abs(two - near) else two
            edges[count] = min(max(edge, low), low + step)
            which[count] = active
            count += 1
        before = active
    if count == 0:
        which[0] = first
    return count


@entry
def unwind(edges, which, discs, slopes, angle, value, derivatives):
    """Fill ``value`` [N] with U − θ at angles θ [N], and ``derivatives`` [N, P].

    ``which`` [E] disc is touched between ``edges`` [E + 1], which go once round. What is unwound is ∫ (1, cos t,
    −sin t) dt over where each disc is touched, times ``discs`` [M, 3], and ``slopes`` [M, 3, P] for the derivatives.
    """
    count, size = which.shape[0], slopes.shape[2]
    spent = np.zeros((count + 1, size + 1))
    for k in range(count):
        i, a, b = which[k], edges[k], edges[k + 1]
        whole, sine, cosine = b - a, np.sin(b) - np.sin(a), np.cos(b) - np.cos(a)
        spent[k + 1, size] = spent[k, size] + whole * discs[i, 0] + sine * discs[i, 1] + cosine * discs[i, 2]
        for p in range(size):
            more = whole * slopes[i, 0, p] + sine * slopes[i, 1, p] + cosine * slopes[i, 2, p]
            spent[k + 1, p] = spent[k, p] + more
    for t in range(angle.shape[0]):
        rest = (angle[t] - edges[0]) % (2 * np.pi)
        turns = np.round((angle[t] - edges[0] - rest) / (2 * np.pi))
        rest += edges[0]
        k = 0
        while k < count - 1 and edges[k + 1] <= rest:
            k += 1
        i, a = which[k], edges[k]
        whole, sine, cosine = rest - a, np.sin(rest) - np.sin(a), np.cos(rest) - np.cos(a)
        here = whole * discs[i, 0] + sine * discs[i, 1] + cosine * discs[i, 2]
        value[t] = turns * spent[count, size] + spent[k, size] + here - angle[t]
        for p in range(size):
            here = whole * slopes[i, 0, p] + sine * slopes[i, 1, p] + cosine * slopes[i, 2, p]
            derivatives[t, p] = turns * spent[count, p] + spent[k, p] + here
