"""The one robust fit: least squares with priors, in which outlying rows have less weight."""

import math

import numpy as np

from printmend.units import SIGMA_PER_MEDIAN

DEGREES = 5.0  # of freedom of the Student's t whose tails noise has: one wrong row in twenty is nothing unusual
ROUNDS = 8  # of weighing the rows anew
NEIGHBOURS = 8  # whose errors may be alike
_CUT = math.sqrt((DEGREES + 1) / 2)
# Mean square of normal residuals of scale 1 as `weights_of` counts them: E min(z², DEGREES + 1) (Huber 1981, §6.7).
NORMAL_SQUARE = math.erf(_CUT) - 2 * _CUT * math.exp(-(_CUT**2)) / math.sqrt(math.pi) + 2 * _CUT**2 * math.erfc(_CUT)
CLIP_SIGMAS = 3.0  # a residual beyond which says no more of its neighbours


def scale_of(left_mm: np.ndarray, least_mm: float) -> float:
    """Return the standard deviation of normal residuals [M] with their median size, at least ``least_mm``."""
    return max(SIGMA_PER_MEDIAN * float(np.median(np.abs(left_mm))), least_mm)


def weights_of(left_mm: np.ndarray, scale_mm: float) -> np.ndarray:
    """Return how much residuals [M] count whose noise is normal, but for tails as Student's t has them.

    Weights that fall inside, too, as the t's own do, would take normal noise for less than it is.
    """
    return np.asarray((DEGREES + 1) / np.maximum(DEGREES + 1, (left_mm / scale_mm) ** 2))


def log_likelihood(left_mm: np.ndarray, least_mm: float) -> float:
    """Return the log likelihood of residuals, but for a constant, for the noise that `weights_of` is of, with the scale
    that makes it largest."""
    scale, inside = scale_of(left_mm, least_mm), DEGREES + 1
    for _ in range(ROUNDS):
        scale = max(float(np.sqrt(np.mean(weights_of(left_mm, scale) * left_mm**2))), least_mm)
    square = np.square(left_mm / scale)
    costs = np.minimum(square, inside) / 2 + inside / 2 * np.log(np.maximum(square / inside, 1.0))
    return -float(left_mm.size * np.log(scale) + costs.sum())


def ridge(
    columns: np.ndarray, wanted_mm: np.ndarray, sds: np.ndarray, *, first_mm: float, least_mm: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the sizes [P] of columns [M, P] with prior standard deviations [P], their covariance, and what each row
    would be off in a fit without it: e / (1 − leverage). ``first_mm`` is a guess of the scatter, ``least_mm`` its
    smallest."""
    weight, scale = np.ones(len(wanted_mm)), first_mm
    for _ in range(ROUNDS):
        covariance = np.linalg.inv(columns.T @ (weight[:, None] * columns) / scale**2 + np.diag(np.square(1 / sds)))
        sizes = covariance @ (columns.T @ (weight * wanted_mm)) / scale**2
        left, used, spread = wanted_mm - columns @ sizes, weight, scale
        scale = scale_of(left, least_mm)
        weight = weights_of(left, scale)
    leverage = np.einsum("mi,ij,mj->m", columns, covariance, columns, optimize=True) * used / spread**2
    return sizes, covariance, left / np.maximum(1.0 - leverage, 1e-6)


def own_share(left_mm: np.ndarray, scale_mm: float) -> float:
    """Return the share of residuals, in their order, that tell something of their own: where neighbours are correlated
    by ρ at a distance, 1 + 2 Σ ρ of them tell the same."""
    left = np.clip(left_mm, -CLIP_SIGMAS * scale_mm, CLIP_SIGMAS * scale_mm)
    square = float(left @ left) + 1e-12
    alike = sum(max(float(left[:-lag] @ left[lag:]) / square, 0.0) for lag in range(1, NEIGHBOURS + 1))
    return 1 / (1 + 2 * alike)
