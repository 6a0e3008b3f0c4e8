"""How far residuals scatter."""

import numpy as np

from printmend.metrics.robust import scale_of

LEAST_SIGMA_MM = 1e-4  # tables are written no finer


def robust_sigma_mm(residual_mm: np.ndarray) -> float:
    """Return the standard deviation of Gaussian residuals with this median absolute value."""
    return scale_of(residual_mm, LEAST_SIGMA_MM)
