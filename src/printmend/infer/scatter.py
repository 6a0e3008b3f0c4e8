"""How far residuals scatter, and whether they are independent."""

import numpy as np

from printmend.metrics.robust import scale_of

LEAST_SIGMA_MM = 1e-4  # tables are written no finer
BLOCKS = (4, 16, 64)  # lengths of the blocks whose means are looked at
LEAST_BLOCKS = 8


def robust_sigma_mm(residual_mm: np.ndarray) -> float:
    """Return the standard deviation of Gaussian residuals with this median absolute value."""
    return scale_of(residual_mm, LEAST_SIGMA_MM)


def independent_share(residual_mm: np.ndarray, sigma_mm: float) -> float:
    """Return the share of residuals [M], in the order of motion, that is independent.

    It is the variance over (length × variance of the means of blocks of that length), for the worst length. Residuals
    that keep their sign for many rows are a pattern that the model lacks.
    """
    clipped = np.clip(residual_mm, -3 * sigma_mm, 3 * sigma_mm)
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
