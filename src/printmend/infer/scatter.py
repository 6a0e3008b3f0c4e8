"""Test whether residuals are independent; compute the far tail of the normal distribution."""

import numpy as np

from printmend.infer import kernels
from printmend.metrics.robust import CLIP_SIGMAS

# The far tail of the normal distribution: `pip install printmend` learns without scipy.


def log_below(z: np.ndarray) -> np.ndarray:
    """Return the logarithm of the probability that a standard normal value is below each of ``z``."""
    return np.fromiter(map(kernels.log_below, z.ravel().tolist()), float, z.size).reshape(z.shape)


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
