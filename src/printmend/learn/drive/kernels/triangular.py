"""The inverse of a triangular matrix, which numpy does not have. Checks: fit.py."""

from printmend.jit import entry


@entry
def lower_inverse(factor, out):
    """Fill out [N, N], zeros, with the inverse of a lower triangular matrix, row by row: L X = I, forwards."""
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
