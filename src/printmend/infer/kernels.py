"""The posterior of a set of columns, and what each block of others would add to its score, in any of its sizes."""

import math
from typing import NamedTuple

import numpy as np

from printmend.jit import entry, inner

FAR = -25.0  # standard deviations below which the tail's series is exact to eight digits; erfc soon underflows


class Alternatives(NamedTuple):
    """The alternatives in size of blocks, one block after the other.

    ``blocks`` [B, 3] are the first column of each, how many columns P it has and how many alternatives. ``sds_mm`` are
    the sizes [P] of each alternative, flat; ``log_odds`` [K] its odds and ``signs`` [K] its sign, 0 for either.
    """

    blocks: np.ndarray
    sds_mm: np.ndarray
    log_odds: np.ndarray
    signs: np.ndarray


@entry
def gains(alternatives, products, variance, slope, half, freed, pull, asked, out):
    """Fill out with the log odds and ½ rᵀ(S + V⁻¹)⁻¹r − ½ log det(1 + V S) of each alternative that is ``asked`` [K]
    for; one of a sign has the share of its posterior that has this sign, twice, besides.

    V are the sizes of an alternative. What the rows tell of its columns is S = M/σ² − h hᵀ + (h F)(h F)ᵀ, which pull by
    r = s + h F p. M are the columns' ``products`` [P, P], flat, σ² the noise's ``variance``, s their part of the
    ``slope`` [C], h that of the ``half`` [C, A] that a set takes. Members taken out of the set have ``freed`` F [A, F],
    and pull by p, ``pull`` [F].
    """
    widest = 1
    for b in range(len(alternatives.blocks)):
        widest = max(widest, alternatives.blocks[b, 1])
    told, rest, more = np.empty((widest, widest + 1)), np.empty((widest, widest + 1)), np.empty((widest, len(pull)))
    square, size, one = 0, 0, 0  # where the block, its sizes and this alternative begin
    for b in range(len(alternatives.blocks)):
        first, width, count = alternatives.blocks[b, 0], alternatives.blocks[b, 1], alternatives.blocks[b, 2]
        if asked[one : one + count].any():
            mine = slice(first, first + width)
            _tell(products[square:], variance, slope[mine], half[mine], freed, pull, more, told)
        for _ in range(count):
            if asked[one]:
                sds = alternatives.sds_mm[size : size + width]
                for i in range(width):
                    for j in range(i, width):
                        rest[i, j] = told[i, j] * sds[i] * sds[j]
                    rest[i, i] += 1.0
                    rest[i, width] = told[i, width] * sds[i]
                out[one] = alternatives.log_odds[one] + 0.5 * _factored(rest, width)
                if alternatives.signs[one] != 0.0:
                    sd = math.sqrt(sds[0] ** -2 + max(told[0, 0], 0.0))
                    out[one] += log_below(alternatives.signs[one] * told[0, 1] / sd) + math.log(2.0)
            size += width
            one += 1
        square += width * width


@inner
def _tell(products, variance, slope, half, freed, pull, more, told):
    """Put S and, as its last column, r of a block [P, P + 1] into ``told``, the upper triangle alone; ``more`` [P, F]
    is room."""
    width = len(slope)
    for i in range(width):
        told[i, width] = slope[i]
        for f in range(len(pull)):
            more[i, f] = 0.0
        for a in range(len(freed)):
            for f in range(len(pull)):
                more[i, f] += half[i, a] * freed[a, f]
    for i in range(width):
        told[i, width] += _product(more[i], pull)
        for j in range(i, width):
            taken = _product(half[i], half[j]) - _product(more[i], more[j])
            told[i, j] = products[i * width + j] / variance - taken


@inner(fastmath={"reassoc"})
def _product(one, other):
    """Return the sum of products, in whatever order is fastest."""
    found = 0.0
    for at in range(len(one)):
        found += one[at] * other[at]
    return found


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


@inner
def log_below(z):
    """Return the logarithm of the probability that a standard normal value is below z."""
    if z > FAR:
        return math.log(0.5 * math.erfc(-z / math.sqrt(2.0)))
    small = 1 / (z * z)  # a product never overflows, a power of a float does
    return -0.5 * (z * z + math.log(2 * math.pi)) - math.log(-z) + math.log1p(-small + 3 * small * small)


@entry
def weigh(products, slope, sds, signs, errors, limits, mean, root):
    """Fill ``mean`` [A] and ``root`` [A, A] with the posterior of sizes of standard deviations ``sds`` [A] a priori;
    return the noise's variance and the log evidence. A size whose sign is not 0 in ``signs`` [A] is of this sign.

    The rows tell ``products`` [A, A] of the columns and their ``slope`` [A]; both are overwritten. ``errors`` are their
    sum of squares and their count. ``limits`` are the first variance of the noise, the least one, the most rounds of
    expectation and maximisation that find it, and the share of change at which these stop.
    """
    (square, count), (variance, least, rounds, settled), size = errors, limits, len(sds)
    factor, rest, half = np.empty((size, size)), np.empty(size), np.empty(size)
    for i in range(size):
        slope[i] *= sds[i]
        for j in range(size):
            products[i, j] *= sds[i] * sds[j]
    while True:
        log_det = _rooted(products, variance, factor, root)
        for i in range(size):
            mean[i], rest[i] = 0.0, slope[i] / variance
        for _ in range(2):  # the second time for what rounding left
            _put_product(root, rest, half)
            for i in range(size):
                for j in range(i + 1):
                    mean[j] += root[i, j] * half[i]
            _put_product(products, mean, half)
            for i in range(size):
                rest[i] = slope[i] / variance - mean[i] - half[i] / variance
        told, made, sure = _product(mean, slope), _product(mean, half), 0.0
        if rounds == 0:
            break
        for i in range(size):
            sure += 1.0 - _product(root[i], root[i])  # what the sizes' covariance adds
        newer = max((square - 2 * told + made + variance * sure) / max(count, 1.0), least)
        if abs(newer - variance) < settled * variance:
            break
        variance, rounds = newer, rounds - 1
    # the least that any sizes leave: rounding of the mean counts by its square alone
    quadratic = (square - 2 * told + made) / variance + _product(mean, mean)
    evidence = -0.5 * (count * math.log(variance) + log_det + quadratic)
    for i in range(size):
        if signs[i] != 0.0:
            norm = 0.0
            for j in range(i, size):
                norm += root[j, i] * root[j, i]
            evidence += log_below(signs[i] * mean[i] / math.sqrt(norm)) + math.log(2.0)
    for i in range(size):
        mean[i] *= sds[i]
        for j in range(size):
            root[i, j] *= sds[j]
    return variance, evidence


@inner
def _rooted(products, variance, factor, root):
    """Put the inverse [A, A] of the lower root L of M = 1 + ``products`` / variance into ``root``; return log det M.

    Each row of Lᵀ and of the inverse takes those above it two at a time: it is read and written half as often.
    """
    size, log_det = len(products), 0.0
    for i in range(size):
        for j in range(i, size):
            factor[i, j] = products[i, j] / variance
        factor[i, i] += 1.0
        root[i] = 0.0
        root[i, i] = 1.0
        for k in range(0, i - 1, 2):
            _take(factor[i, i:], factor[k, i:], factor[k, i], factor[k + 1, i:], factor[k + 1, i])
            _take(root[i, : k + 2], root[k], factor[k, i], root[k + 1], factor[k + 1, i])
        if i % 2:
            _take(factor[i, i:], factor[i - 1, i:], factor[i - 1, i], factor[i - 1, i:], 0.0)
            _take(root[i, :i], root[i - 1], factor[i - 1, i], root[i - 1], 0.0)
        pivot = math.sqrt(factor[i, i])
        log_det += 2 * math.log(pivot)
        for j in range(i, size):
            factor[i, j] /= pivot
        for j in range(i + 1):
            root[i, j] /= pivot
    return log_det


@inner
def _take(row, one, share, other, more):
    """Take shares of two other rows from a row, as far as it goes."""
    for j in range(len(row)):
        row[j] -= share * one[j] + more * other[j]


@inner
def _put_product(matrix, vector, out):
    """Put the product of a matrix [A, A] and a vector [A] into ``out`` [A]."""
    for i in range(len(vector)):
        out[i] = _product(matrix[i], vector)
