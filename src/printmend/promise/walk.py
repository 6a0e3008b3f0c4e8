"""Do residuals wander in the order of time, as those of an instrument do whose own zero goes for a walk?

A walk w of steps of variance q beneath noise of variance σ² is told by its differences, whose covariance is
tridiagonal: the sine transform makes it diagonal, with q + σ² (2 − 2 cos πk/n) (Harvey 1989, the local level). With the
ratio q/σ² given, σ² and whatever columns are looked for follow by least squares.
"""

from dataclasses import dataclass

import numpy as np

# Tried variances of a step over that of the noise: from 0.3 µm beneath 0.05 mm to 50 µm beneath it.
RATIOS = np.geomspace(3e-5, 1.0, 16)
SURE_NATS = 9.0  # log likelihood that a walk must gain over mere noise
# Two standard deviations of a walk's mean about its start, over √3 of its size about that mean: what may have moved so
# far is asked for as an even drift, which ends √3 of its size from its mean.
MOVED_SHARE = 2 * (2 / 3) ** 0.5
BESIDE_NATS = 3.0  # log likelihood that a cause in time must gain beside a walk, beyond the price of looking for it


@dataclass(frozen=True)
class Walk:
    """The likeliest walk: its log likelihood, what of that is more than mere noise has, and the expected root mean
    square size [mm] about its mean."""

    log_likelihood: float
    nats: float
    size_mm: float


def walk_of(residual_mm: np.ndarray, columns: np.ndarray) -> Walk:
    """Return the likeliest walk of residuals [N] in the order of time, beside ``columns`` [N, Q] of any size."""
    count = len(residual_mm) - 1
    waves = _sines(np.diff(np.column_stack([residual_mm, columns]), axis=0))
    noise = 2 - 2 * np.cos(np.pi * np.arange(1, count + 1) / (count + 1))
    logs, sigmas2 = [], []
    for ratio in (0.0, *RATIOS):
        spread = ratio + noise
        whitened = waves / np.sqrt(spread)[:, None]
        weights = np.linalg.lstsq(whitened[:, 1:], whitened[:, 0], rcond=None)[0]
        left = whitened[:, 0] - whitened[:, 1:] @ weights
        sigmas2.append(max(float(left @ left), 1e-18) / count)
        logs.append(-0.5 * (count * np.log(sigmas2[-1]) + np.log(spread).sum()))
    best = int(np.argmax(logs[1:])) + 1
    size_mm = float(np.sqrt(RATIOS[best - 1] * sigmas2[best] * count / 6))
    return Walk(logs[best], logs[best] - logs[0], size_mm)


def _sines(rows: np.ndarray) -> np.ndarray:
    """Return the orthonormal sine transform (DST-I) of each column of rows [N, Q]: the Fourier transform of what goes
    on oddly at both ends."""
    end = np.zeros((1, rows.shape[1]))
    odd = np.concatenate([end, rows, end, -rows[::-1]])
    return -np.fft.rfft(odd, axis=0).imag[1 : len(rows) + 1] / np.sqrt(2 * (len(rows) + 1))
