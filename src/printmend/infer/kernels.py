"""What each block of columns gains beside a set, for all its alternatives in size."""

import numpy as np

from printmend.jit import entry, inner


@entry
def gains(shapes, information, pull, sds, asked, out):
    """Fill out with ½ rᵀ(S + V⁻¹)⁻¹r − ½ log det(1 + V S) of the blocks of several groups, one group after the other.

    ``shapes`` [G, 3] are how many blocks B each group has, with how many alternatives V, of P columns. The other arrays
    hold those of all groups, flat: S is the ``information`` [B, P, P], r the ``pull`` [B, P], and V are the sizes
    ``sds`` [B, V, P] that are ``asked`` [B, V] for, as ``out`` [B, V] has them.
    """
    widest = 0
    for g in range(shapes.shape[0]):
        widest = max(widest, shapes[g, 2])
    rest = np.empty((widest, widest + 1))
    square, row, size, one = 0, 0, 0, 0  # where the block, its pull, its sizes and this alternative begin
    for g in range(shapes.shape[0]):
        width = shapes[g, 2]
        for _b in range(shapes[g, 0]):
            for _v in range(shapes[g, 1]):
                if asked[one]:
                    for i in range(width):
                        for j in range(i, width):
                            rest[i, j] = information[square + i * width + j] * sds[size + i] * sds[size + j]
                        rest[i, i] += 1.0
                        rest[i, width] = pull[row + i] * sds[size + i]
                    out[one] = 0.5 * _factored(rest, width)
                size += width
                one += 1
            row += width
            square += width * width


@inner
def _factored(rest, width):
    """Return rᵀM⁻¹r − log det M of M = 1 + V S, the upper triangle of ``rest`` [P, P + 1] with r as its last column,
    which it overwrites.

    M is factored by two pivots at a time: `rest` is read and written half as often. No pivot is below 1 but by
    rounding.
    """
    gain, k = 0.0, 0
    while k < width:
        pivot = max(rest[k, k], 1.0)
        gain += rest[k, width] * rest[k, width] / pivot - np.log(pivot)
        if k + 1 == width:
            break
        share = rest[k, k + 1] / pivot
        for j in range(k + 1, width + 1):
            rest[k + 1, j] -= share * rest[k, j]
        other = max(rest[k + 1, k + 1], 1.0)
        gain += rest[k + 1, width] * rest[k + 1, width] / other - np.log(other)
        for i in range(k + 2, width):
            share, more = rest[k, i] / pivot, rest[k + 1, i] / other
            for j in range(i, width + 1):
                rest[i, j] = rest[i, j] - share * rest[k, j] - more * rest[k + 1, j]
        k += 2
    return gain
