"""Test whether residuals are independent; compute the far tail of the normal distribution."""

import math

import numpy as np

from printmend.metrics.robust import CLIP_SIGMAS

# The far tail of the normal distribution, and triangular matrices: `pip install printmend` learns without scipy.

_FAR = -25.0  # standard deviations below which the tail's series is exact to eight digits; erfc soon underflows
_HALF = 24  # rows below which dividing costs more than it saves


def log_below(z: np.ndarray) -> np.ndarray:
    """Return the logarithm of the probability that a standard normal value is below each of ``z``."""
    return np.fromiter(map(_one, z.ravel().tolist()), float, z.size).reshape(z.shape)


def _one(z: float) -> float:
    if z > _FAR:
        return math.log(0.5 * math.erfc(-z / math.sqrt(2)))
    small = 1 / (z * z)  # a product never overflows, a power of a float does
    return -0.5 * (z * z + math.log(2 * math.pi)) - math.log(-z) + math.log1p(-small + 3 * small * small)


def inverse_of(lower: np.ndarray) -> np.ndarray:
    """Return the inverse of a lower triangular matrix [P, P], by halves: `numpy.linalg.inv` takes thrice as long."""
    half = len(lower) // 2
    if half < _HALF:
        return np.asarray(np.linalg.inv(lower))
    first, last = inverse_of(lower[:half, :half]), inverse_of(lower[half:, half:])
    out = np.zeros(lower.shape)  # `numpy.block` takes longer than the products
    out[:half, :half], out[half:, half:] = first, last
    out[half:, :half] = -last @ lower[half:, :half] @ first
    return out


BLOCKS = (4, 16, 64)  # lengths of the blocks whose means are looked at
LEAST_BLOCKS = 8


def independent_share(residual_mm: np.ndarray, sigma_mm: float) -> float:
    """Return the share of residuals [M], in the order of motion, that is independent.

    It is the variance over (length × variance of the means of blocks of that length), for the worst length. Residuals
    that keep their sign for many rows are a pattern that the model lacks.
    """
    clipped = np.clip(residual_mm, -CLIP_SIGMAS * sigma_mm, CLIP_SIGMAS * sigma_mm)
    variance = float(clipped @ clipped) / len(clipped) + 1e-18
    worst = 1.0
    for length in BLOCKS:
        count = len(clipped) // length
        if count >= LEAST_BLOCKS:
            sums = clipped[: count * length].reshape(count, length).sum(axis=1)
            # The mean square of the block means has a relative error of √(2/count); two of them are allowed for.
            excess = float(sums @ sums) / (count * length) / variance / (1 + 2 * np.sqrt(2 / count))
            worst = max(worst, excess)
    return 1.0 / worst
