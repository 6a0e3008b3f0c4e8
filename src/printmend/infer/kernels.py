"""What each block of columns gains beside a set, for all its alternatives in size."""

import numpy as np

from printmend.jit import entry


@entry
def gains(information, pull, sds, asked, out):
    """Fill out [B, V] with ½ rᵀ(S + V⁻¹)⁻¹r − ½ log det(1 + V S) of blocks of P columns with the sizes ``sds``
    [B, V, P] that are ``asked`` [B, V] for: S is their ``information`` [B, P, P] and r their ``pull`` [B, P].

    1 + V S is factored with r as its last column. No pivot is below 1 but by rounding.
    """
    width = sds.shape[2]
    rest = np.empty((width, width + 1))
    for b in range(sds.shape[0]):
        for v in range(sds.shape[1]):
            if not asked[b, v]:
                continue
            for i in range(width):
                for j in range(i, width):
                    rest[i, j] = information[b, i, j] * sds[b, v, i] * sds[b, v, j]
                rest[i, i] += 1.0
                rest[i, width] = pull[b, i] * sds[b, v, i]
            gain = 0.0
            for k in range(width):
                pivot = max(rest[k, k], 1.0)
                gain += rest[k, width] * rest[k, width] / pivot - np.log(pivot)
                for i in range(k + 1, width):
                    share = rest[k, i] / pivot
                    for j in range(i, width + 1):
                        rest[i, j] -= share * rest[k, j]
            out[b, v] = 0.5 * gain
