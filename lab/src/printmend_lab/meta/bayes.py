"""The closed form between what is believed and what was measured; numpy here, another array library in training.

Functions take ``xp``, the library: numpy, or one with its interface that can differentiate (`tools/train_meta.py`).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from printmend_lab.greybox.drive.fit import lower_inverse
from printmend_lab.meta.columns import FIXED, FIXED_SD_MM, GROUPS

# What is believed for a first look: standard deviations of all weights and of the noise [mm].
LOOKS = ((0.03, 0.01), (0.03, 0.1), (0.5, 0.01), (0.5, 0.1))
LEARNED = len(GROUPS) - FIXED  # groups of which the network says what to believe
FEATURES = len(LOOKS) * (2 * LEARNED + 1) + 2  # what it reads: two numbers a group and one more a look, count and turn
OUTPUTS = LEARNED + 1  # what it says: a standard deviation a group, and that of the noise
_LEAST = 1e-5  # added to what a logarithm is taken of


@dataclass(frozen=True, eq=False)
class Evidence:
    """All that is kept of the rows, whatever their number and order: ``gram`` = ΦᵀWΦ [C, C], ``slope`` = ΦᵀWr [C],
    ``square`` = rᵀWr, ``count`` = ΣW, and ``seen``, the share of the motor's turn that the rows meet."""

    gram: np.ndarray
    slope: np.ndarray
    square: float
    count: float
    seen: float


def posterior(xp: Any, gram: Any, slope: Any, deviation: Any, sigma: Any) -> tuple[Any, Any]:
    """Return the mean [C] and covariance [C, C] (physics.md eq. 19) for prior standard deviations [C] and the noise."""
    if xp is np:
        whitened = _whitened(gram, deviation, sigma) * deviation
        covariance = whitened.T @ whitened
    else:
        inner = xp.eye(gram.shape[-1]) + deviation[:, None] * gram * deviation[None, :] / sigma**2
        covariance = deviation[:, None] * xp.linalg.inv(inner) * deviation[None, :]
    return covariance @ slope / sigma**2, covariance


def _glance(xp: Any, gram: Any, slope: Any, deviation: Any, sigma: float) -> tuple[Any, Any]:
    """Return the posterior's mean [C] and variances [C]; numpy needs no covariance for that."""
    if xp is not np:
        mean, covariance = posterior(xp, gram, slope, deviation, sigma)
        return mean, xp.diagonal(covariance)
    whitened = _whitened(gram, deviation, sigma) * deviation
    return (whitened @ slope) @ whitened / sigma**2, np.einsum("ij,ij->j", whitened, whitened)


def _whitened(gram: np.ndarray, deviation: np.ndarray, sigma: float) -> np.ndarray:
    """Return the inverse Cholesky factor [C, C] of the posterior's precision in units of the prior's deviations."""
    inner = gram * np.outer(deviation / sigma, deviation / sigma)
    inner.flat[:: len(inner) + 1] += 1.0
    return lower_inverse(np.linalg.cholesky(inner))


def first_look(xp: Any, gram: Any, slope: Any, square: Any, count: Any, seen: Any, member: Any) -> Any:
    """Return what the network reads [FEATURES]: how large each group seems under simple beliefs, and how settled."""
    found = []
    sizes = member.sum(axis=0)
    for sd_mm, sigma_mm in LOOKS:
        deviation = believed(xp, xp.full(LEARNED, np.log(sd_mm)), member)
        mean, variance = _glance(xp, gram, slope, deviation, sigma_mm)
        rms = xp.sqrt((mean**2 @ member) / sizes)
        settled = (variance / deviation**2) @ member / sizes
        left = xp.maximum(square - 2 * mean @ slope + mean @ gram @ mean, 0.0) / count
        found += [xp.log10(rms[FIXED:] + _LEAST), settled[FIXED:], xp.log10(xp.sqrt(left) + _LEAST)[None]]
    return xp.concatenate([*found, xp.stack([xp.log10(count), seen])])


def believed(xp: Any, log_sd: Any, member: Any) -> Any:
    """Return the standard deviation [C] of every column from the logarithms [LEARNED] of the groups'."""
    return member @ xp.concatenate([xp.array(FIXED_SD_MM), xp.exp(log_sd)])


def membership(group: np.ndarray) -> np.ndarray:
    """Return which group [C, G] each column [C] belongs to, as zeros and ones."""
    return np.asarray(group[:, None] == np.arange(len(GROUPS)), float)


def forward(xp: Any, weights: Any, features: Any) -> Any:
    """Return what the network says [OUTPUTS]: the logarithms of the groups' standard deviations and of the noise."""
    hidden = (features - weights["mean"]) / weights["spread"]
    for layer in range(LAYERS):
        hidden = hidden @ weights[f"w{layer}"] + weights[f"b{layer}"]
        if layer < LAYERS - 1:
            hidden = xp.tanh(hidden)
    return CENTRE + REACH * xp.tanh(hidden / REACH)


LAYERS, WIDTH = 4, 96
CENTRE, REACH = np.log(0.05), 6.0  # no belief is narrower or wider than e^±6 times 0.05 mm
