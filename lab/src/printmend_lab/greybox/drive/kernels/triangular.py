"""Factors and inverses of small symmetric matrices, the latter of which numpy has not for triangles. Checks: fit.py."""

import numpy as np

from printmend.jit import entry, inner


@entry
def lower_inverse(factor, out):
    """Fill out [N, N], zeros, with the inverse of a lower triangular matrix."""
    invert_lower(factor, out)


@inner
def invert_lower(factor, out):
    """Fill out [N, N], zeros, with the inverse of the lower triangle of ``factor``, row by row: L X = I, forwards."""
    for i in range(factor.shape[0]):
        row = out[i]
        row[i] = 1.0
        for k in range(i):
            share, above = factor[i, k], out[k]
            for j in range(k + 1):
                row[j] -= share * above[j]
        share = 1.0 / factor[i, i]
        for j in range(i + 1):
            row[j] *= share


@inner
def cholesky(matrix):
    """Turn the upper triangle of a positive definite matrix [N, N] into Lᵀ, row by row, and write L below it."""
    size = matrix.shape[0]
    for k in range(size):
        row = matrix[k]
        root = np.sqrt(row[k])
        row[k] = root
        for j in range(k + 1, size):
            row[j] /= root
            matrix[j, k] = row[j]
        for i in range(k + 1, size):
            share, below = row[i], matrix[i]
            for j in range(i, size):
                below[j] -= share * row[j]
