"""What a fit with the waves of one length leaves, for many lengths (least squares' periodogram). Checks: period.py."""

import numpy as np

from printmend.jit import entry, inner
from printmend_lab.greybox.drive.kernels.triangular import cholesky

RIDGE = 1e-9  # share of the equations' trace that is added to their diagonal


# Its many parameters are the rows of one motor, and how many waves are fitted to them.
@entry(error_model="numpy")
def lengths_left(lengths, motor, side, along, fixed, error, weight, harmonics, play_harmonics, fading, left):
    """Fill left [L] with the weighed sum of squares that a fit with the waves of each length [L] leaves.

    The N rows are at ``motor`` [N]; beside the columns ``fixed`` [N, F] are fitted cos and sin of the first
    ``harmonics`` of the length, the first ``play_harmonics`` of them times ``side`` [N], and where ``fading`` is true
    the first one times ``along`` [N]. ``error`` [N] is what is fitted, with the weights ``weight`` [N].
    """
    given = fixed.shape[1]
    waves = 2 * (harmonics + play_harmonics + (1 if fading else 0))
    size = given + waves
    gram, row, first = np.zeros((size + 1, size + 1)), np.empty(size + 1), np.zeros((given + 1, given + 1))
    for n in range(len(motor)):
        row[0] = error[n]
        for i in range(given):
            row[1 + i] = fixed[n, i]
        for i in range(given + 1):
            share, below = weight[n] * row[i], first[i]
            for j in range(i + 1):
                below[j] += share * row[j]
    for at in range(len(lengths)):
        gram[:] = 0.0
        for i in range(given + 1):
            for j in range(given + 1):
                gram[i, j] = first[i, j]
        for n in range(len(motor)):
            row[0] = error[n]
            for i in range(given):
                row[1 + i] = fixed[n, i]
            angle = motor[n] * (2.0 * np.pi / lengths[at])
            c, s = np.cos(angle), np.sin(angle)
            a, b = c, s
            k = given + 1
            for harmonic in range(harmonics):
                row[k], row[k + 1] = a, b
                k += 2
                if harmonic < play_harmonics:
                    row[k], row[k + 1] = a * side[n], b * side[n]
                    k += 2
                a, b = a * c - b * s, a * s + b * c
            if fading:
                row[k], row[k + 1] = c * along[n], s * along[n]
            for i in range(given + 1, size + 1):
                share, below = weight[n] * row[i], gram[i]
                for j in range(i + 1):
                    below[j] += share * row[j]
        left[at] = _left(gram)


@inner(error_model="numpy")
def _left(gram):
    """Return what the best fit leaves: ``gram`` [1 + C, 1 + C] holds the products, in its lower triangle, first those
    of the error."""
    size = gram.shape[0] - 1
    factor, pull = np.empty((size, size)), np.empty(size)
    trace = 0.0
    for i in range(size):
        trace += gram[1 + i, 1 + i]
    for i in range(size):
        pull[i] = gram[1 + i, 0]
        for j in range(i + 1):
            factor[j, i] = gram[1 + i, 1 + j]
        factor[i, i] += RIDGE * trace
    cholesky(factor)
    left = gram[0, 0]
    for i in range(size):  # forwards through L: the fit explains the square of what comes out
        for j in range(i):
            pull[i] -= factor[i, j] * pull[j]
        pull[i] /= factor[i, i]
        left -= pull[i] * pull[i]
    return max(left, 1e-12)
