"""The far tail of the normal distribution, and triangular matrices: `pip install printmend` learns without scipy."""

import math

import numpy as np

_FAR = -25.0  # standard deviations below which the tail's series is exact to eight digits; erfc soon underflows
_HALF = 24  # rows below which dividing costs more than it saves


def log_below(z: np.ndarray) -> np.ndarray:
    """Return the logarithm of the probability that a standard normal value is below each of ``z``."""
    with np.errstate(over="ignore", under="ignore"):  # as it should: the logarithm is -inf then, or 0
        return np.asarray(_LOG_BELOW(z), float)


def _one(z: float) -> float:
    if z > _FAR:
        return math.log(0.5 * math.erfc(-z / math.sqrt(2)))
    small = 1 / (z * z)  # a product never overflows, a power of a float does
    return -0.5 * (z * z + math.log(2 * math.pi)) - math.log(-z) + math.log1p(-small + 3 * small * small)


_LOG_BELOW = np.vectorize(_one, otypes=[float])


def inverse_of(lower: np.ndarray) -> np.ndarray:
    """Return the inverse of a lower triangular matrix [P, P], by halves: `numpy.linalg.inv` takes thrice as long."""
    half = len(lower) // 2
    if half < _HALF:
        return np.asarray(np.linalg.inv(lower))
    first, last = inverse_of(lower[:half, :half]), inverse_of(lower[half:, half:])
    return np.block([[first, np.zeros((half, len(last)))], [-last @ lower[half:, :half] @ first, last]])
