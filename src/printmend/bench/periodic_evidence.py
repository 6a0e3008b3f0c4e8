"""The marginal likelihood of two traverses under the model of periodic.py, and the steps that it asks for."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

HARMONICS = 16
_K = np.arange(1, HARMONICS + 1)
_LINE_VARIANCE_MM2 = 100.0
_STEP_VARIANCE_MM2 = 1.0


@dataclass(frozen=True)
class Settings:
    """P, θ, log A, p, logit r, log q and log s of periodic.py."""

    turn_mm: float
    return_mm: float
    log_size: float
    decay: float
    logit_share: float
    log_walk: float
    log_white: float

    @property
    def share(self) -> float:
        return float(1 / (1 + np.exp(-self.logit_share)))

    def outside(self) -> bool:
        sizes = -8 < self.log_walk < 3 and -6 < self.log_white < 1 and self.log_size < 3
        return not (25 < self.turn_mm < 60 and 0 <= self.decay < 6 and abs(self.logit_share) < 9 and sizes)

    def penalty(self) -> float:
        """The negative log prior of the size (half a millimetre, wide) and the decay (1.5 ± 1)."""
        return ((self.log_size - np.log(0.5)) / 2) ** 2 / 2 + (self.decay - 1.5) ** 2 / 2


class Trace1d:
    """A traverse in the eigenvectors of the random walk, where every drift's covariance is diagonal; and its steps."""

    def __init__(self, travel_mm: np.ndarray, error_mm: np.ndarray) -> None:
        self.travel_mm = np.asarray(travel_mm, float)
        walk = np.minimum.outer(self.travel_mm, self.travel_mm) / 100.0
        values, self.vectors = np.linalg.eigh(walk)
        self.values = np.maximum(values, 0.0)
        self.error = self.vectors.T @ np.asarray(error_mm, float)
        middle = (self.travel_mm - self.travel_mm.mean()) / 100.0
        self.line = self.vectors.T @ np.stack([np.ones_like(middle), middle], axis=1)
        self.steps_mm: list[float] = []
        self._turn_mm, self._waves = np.nan, np.empty((0, 0))

    def waves(self, turn_mm: float) -> np.ndarray:
        """Return the harmonics over this traverse [N, 2·HARMONICS]; the last turn's are remembered."""
        if turn_mm != self._turn_mm:
            self._turn_mm, self._waves = turn_mm, self.vectors.T @ harmonics(self.travel_mm, turn_mm)
        return self._waves

    def risen(self, places_mm: np.ndarray) -> np.ndarray:
        """Return unit steps at places [S] as columns [N, S]."""
        return self.vectors.T @ (self.travel_mm[:, None] >= np.asarray(places_mm, float)).astype(float)


def harmonics(travel_mm: np.ndarray, turn_mm: float) -> np.ndarray:
    """Return cos and sin of the first `HARMONICS` multiples of a turn [N, 2·HARMONICS]."""
    angle = np.outer(travel_mm, _K) * (2 * np.pi / turn_mm)
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=1)


class System(NamedTuple):
    """Whitened least squares: ``scaled`` [N, M] columns by the root of their ``prior`` [M] over ``noise`` [N]."""

    scaled: np.ndarray
    target: np.ndarray
    prior: np.ndarray
    noise: np.ndarray

    def posterior(self) -> tuple[np.ndarray, float]:
        """Return the mean weights [M] and the log marginal likelihood, up to a constant."""
        lower = np.linalg.cholesky(np.eye(self.scaled.shape[1]) + self.scaled.T @ self.scaled)
        projected = np.linalg.solve(lower, self.scaled.T @ self.target)
        misfit = self.target @ self.target - projected @ projected
        evidence = -misfit / 2 - np.log(np.diag(lower)).sum() - np.log(self.noise).sum()
        return np.sqrt(self.prior) * np.linalg.solve(lower.T, projected), float(evidence)


def system(traces: tuple[Trace1d, Trace1d], settings: Settings) -> System:
    """Return the system of both traverses: shared harmonics, hysteresis, a line each, the steps of each."""
    plus, minus = traces
    forth = plus.waves(settings.turn_mm)
    # −(cos, sin)(kθ − ks) from (cos, sin)(ks), by the addition theorems
    cosine, sine = minus.waves(settings.turn_mm)[:, :HARMONICS], minus.waves(settings.turn_mm)[:, HARMONICS:]
    angle = 2 * np.pi * _K * settings.return_mm / settings.turn_mm
    c, s = np.cos(angle), np.sin(angle)
    back = -np.concatenate([c * cosine + s * sine, s * cosine - c * sine], axis=1)
    own = [np.concatenate([trace.line, trace.risen(np.array(trace.steps_mm))], axis=1) for trace in traces]
    apart = np.zeros((len(forth) + len(back), own[0].shape[1] + own[1].shape[1]))
    apart[: len(forth), : own[0].shape[1]], apart[len(forth) :, own[0].shape[1] :] = own
    design = np.concatenate([np.vstack([forth, back]), np.vstack([forth, -back]), apart], axis=1)
    size = np.exp(2 * settings.log_size) * np.tile(_K.astype(float), 2) ** (-2 * settings.decay)
    rest = [np.array([_LINE_VARIANCE_MM2] * 2 + [_STEP_VARIANCE_MM2] * len(trace.steps_mm)) for trace in traces]
    prior = np.concatenate([size * (1 + settings.share) / 2, size * (1 - settings.share) / 2, *rest])
    variance = np.exp(2 * settings.log_walk) * np.concatenate([plus.values, minus.values])
    noise = np.sqrt(variance + np.exp(2 * settings.log_white))
    target = np.concatenate([plus.error, minus.error]) / noise
    return System(design * np.sqrt(prior) / noise[:, None], target, prior, noise)


def likeliest_step(traces: tuple[Trace1d, Trace1d], settings: Settings) -> tuple[float, int, float]:
    """Return (gain of log evidence, which traverse, where) of the one step that explains most.

    The gain is that of a rank-one update of the covariance, less the log of the number of places.
    """
    scaled, target, _, noise = system(traces, settings)
    inner = np.eye(scaled.shape[1]) + scaled.T @ scaled
    residual = target - scaled @ np.linalg.solve(inner, scaled.T @ target)
    best, ends = (0.0, 0, 0.0), np.cumsum([0, *(len(trace.travel_mm) for trace in traces)])
    for side, trace in enumerate(traces):
        rows = slice(ends[side], ends[side + 1])
        places = trace.travel_mm[3:-3]
        columns = trace.risen(places) * np.sqrt(_STEP_VARIANCE_MM2) / noise[rows, None]
        across = scaled[rows].T @ columns
        spread = (columns**2).sum(axis=0) - (across * np.linalg.solve(inner, across)).sum(axis=0)
        pull = columns.T @ residual[rows]
        gain = pull**2 / (1 + spread) / 2 - np.log1p(spread) / 2 - np.log(2 * len(places))
        at = int(np.argmax(gain))
        if gain[at] > best[0]:
            best = (float(gain[at]), side, float(places[at]))
    return best
