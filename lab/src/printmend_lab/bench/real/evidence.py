"""The marginal likelihood of traverses under the model of periodic.py, and the steps that it asks for."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

HARMONICS, BUMPS = 16, 30  # of a turn, and sines of the place
_K = np.arange(1, HARMONICS + 1)
_SPAN_MM = 240.0  # the sines of the place vanish this far apart, beyond both ends of a bed of 220 mm
_OMEGA = np.pi * np.arange(1, BUMPS + 1) / _SPAN_MM
_LINE_VARIANCE_MM2, _STEP_VARIANCE_MM2 = 100.0, 1.0  # prior variances of a drift's line and of a slip's height
_LEAST_VARIANCE_MM2 = 1e-6  # of a row, so that no setting makes one exact

# What each setting is expected to be, and how sure (standard deviation).
_EXPECTED = {
    "log_size": (np.log(0.5), 2.0),
    "decay": (1.5, 1.0),
    "logit_share": (3.0, 2.0),
    "log_walk": (np.log(0.3), 1.0),
    "log_white": (np.log(0.04), 1.0),
    "log_place": (np.log(0.05), 1.0),
    "log_place_hysteresis": (np.log(0.03), 1.0),
    "log_length": (np.log(15.0), 0.5),
    "lag_mm": (0.0, 1.0),
}
NAMES = tuple(_EXPECTED)
EXPECTED = tuple(float(mean) for mean, _ in _EXPECTED.values())
_PHASE_SD_MM = 2.0  # prior standard deviation of how far a trace's turn is shifted
SHORTEST_MM, LONGEST_MM = 20.0, 72.0  # of turns: pulleys of 10 to 36 teeth
_GRID_TURNS = 0.05  # of a turn, by which a wave may be off at the end of the span between lengths of the grid
_USUAL_TURN_MM, _TURN_SD = 40.0, 0.3  # prior of the turn: its median, and the standard deviation of its logarithm


def turns_mm(span_mm: float) -> np.ndarray:
    """Return the lengths of a turn among which a search begins, for what was seen over ``span_mm``."""
    return 1 / np.arange(1 / LONGEST_MM, 1 / SHORTEST_MM, _GRID_TURNS / span_mm)


@dataclass(frozen=True)
class Settings:
    """P, log A, p, logit r, log q, log s, log B, log C, log ℓ, the lag and the phases [files] of periodic.py."""

    turn_mm: float
    log_size: float
    decay: float
    logit_share: float
    log_walk: float
    log_white: float
    log_place: float
    log_place_hysteresis: float
    log_length: float
    lag_mm: float
    phases_mm: tuple[float, ...]

    @classmethod
    def of(cls, values: np.ndarray) -> "Settings":
        """Read an array: the turn, what `NAMES` names, the phases of all files but the first."""
        turn, *rest = (float(value) for value in values)
        return cls(turn, **dict(zip(NAMES, rest, strict=False)), phases_mm=(0.0, *rest[len(NAMES) :]))

    @property
    def share(self) -> float:
        return float(1 / (1 + np.exp(-self.logit_share)))

    def outside(self) -> bool:
        """Say whether a setting is beyond what a search may try."""
        return not (SHORTEST_MM <= self.turn_mm <= LONGEST_MM and self.decay >= 0 and abs(self.logit_share) < 12)

    def penalty(self) -> float:
        """Return the negative log prior, up to a constant."""
        off = [(getattr(self, name) - mean) / spread for name, (mean, spread) in _EXPECTED.items()]
        off.append(np.log(self.turn_mm / _USUAL_TURN_MM) / _TURN_SD)
        return float(np.square(off).sum() / 2 + np.square(self.phases_mm).sum() / (2 * _PHASE_SD_MM**2))

    def shift_mm(self, direction: int, file: int) -> float:
        """Return how far the pulley is ahead of the place in a file and direction."""
        return self.phases_mm[file] + (self.lag_mm if direction < 0 else 0.0)


class Trace1d:
    """A traverse in the eigenvectors of its random walk, where every drift's covariance is diagonal; and its steps.

    ``place_mm`` [N] is where the carriage should be, from the middle of the bed, in the order of time.
    """

    def __init__(self, direction: int, place_mm: np.ndarray, error_mm: np.ndarray, file: int = 0) -> None:
        self.direction, self.file = direction, file
        self.place_mm = np.asarray(place_mm, float)
        self.way_mm = np.abs(self.place_mm - self.place_mm[0])
        values, self.vectors = np.linalg.eigh(np.minimum.outer(self.way_mm, self.way_mm) / 100.0)
        self.values = np.maximum(values, 0.0)
        self.error = self.vectors.T @ np.asarray(error_mm, float)
        middle = (self.way_mm - self.way_mm.mean()) / 100.0
        self.line = self.vectors.T @ np.stack([np.ones_like(middle), middle], axis=1)
        self.bumps = self.vectors.T @ bumps(self.place_mm)
        self.steps_mm: list[float] = []
        self._at, self._waves = (np.nan, np.nan), np.empty((0, 0))

    def waves(self, settings: Settings) -> np.ndarray:
        """Return the pulley's harmonics over this traverse [N, 2·HARMONICS]; the last ones are remembered."""
        at = (settings.turn_mm, settings.shift_mm(self.direction, self.file))
        if at != self._at:
            self._at, self._waves = at, self.vectors.T @ harmonics(self.place_mm + at[1], at[0])
        return self._waves

    def risen(self, ways_mm: np.ndarray) -> np.ndarray:
        """Return unit steps after ways [S] as columns [N, S]."""
        return self.vectors.T @ (self.way_mm[:, None] >= np.asarray(ways_mm, float)).astype(float)


def harmonics(angle_mm: np.ndarray, turn_mm: float) -> np.ndarray:
    """Return cos and sin of the first `HARMONICS` multiples of a turn [N, 2·HARMONICS]."""
    angle = np.outer(angle_mm, _K) * (2 * np.pi / turn_mm)
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=1)


def bumps(place_mm: np.ndarray) -> np.ndarray:
    """Return the sines [N, BUMPS] of which a smooth function of the place is made (Solin and Särkkä 2020, eq. 56)."""
    return np.sin(np.outer(place_mm + _SPAN_MM / 2, _OMEGA)) * np.sqrt(2 / _SPAN_MM)


def _bump_variance(size_mm: float, length_mm: float) -> np.ndarray:
    """Return the spectral density [BUMPS] of the Matérn 3/2 covariance of a size and a length."""
    rate = np.sqrt(3) / length_mm
    return size_mm**2 * 4 * rate**3 / (rate**2 + _OMEGA**2) ** 2


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


def system(traces: Sequence[Trace1d], settings: Settings) -> System:
    """Return the system of all traverses: pulley and place, the hysteresis of both, a line and the steps of each."""
    own = [np.concatenate([trace.line, trace.risen(np.array(trace.steps_mm))], axis=1) for trace in traces]
    ends = np.cumsum([0, *(block.shape[1] for block in own)])
    rows = []
    for trace, block, start in zip(traces, own, ends, strict=False):
        waves, apart = trace.waves(settings), np.zeros((len(block), ends[-1]))
        apart[:, start : start + block.shape[1]] = block
        repeating = np.concatenate([waves, trace.bumps], axis=1)
        rows.append(np.concatenate([trace.direction * repeating, repeating, apart], axis=1))
    size = np.exp(2 * settings.log_size) * np.tile(_K.astype(float), 2) ** (-2 * settings.decay)
    place, hysteresis = (
        _bump_variance(np.exp(log_size), np.exp(settings.log_length))
        for log_size in (settings.log_place, settings.log_place_hysteresis)
    )
    rest = [np.array([_LINE_VARIANCE_MM2] * 2 + [_STEP_VARIANCE_MM2] * len(trace.steps_mm)) for trace in traces]
    share = settings.share
    prior = np.concatenate([size * (1 + share) / 2, place, size * (1 - share) / 2, hysteresis, *rest])
    variance = np.exp(2 * settings.log_walk) * np.concatenate([trace.values for trace in traces])
    noise = np.sqrt(variance + np.exp(2 * settings.log_white) + _LEAST_VARIANCE_MM2)
    target = np.concatenate([trace.error for trace in traces]) / noise
    return System(np.vstack(rows) * np.sqrt(prior) / noise[:, None], target, prior, noise)


def likeliest_steps(traces: Sequence[Trace1d], settings: Settings) -> list[tuple[float, float]]:
    """Return, for each traverse, (gain of log evidence, after what way) of the one step that explains most of it.

    The gain is that of a rank-one update of the covariance, less the log of the number of places.
    """
    scaled, target, _, noise = system(traces, settings)
    inner = np.eye(scaled.shape[1]) + scaled.T @ scaled
    residual = target - scaled @ np.linalg.solve(inner, scaled.T @ target)
    found, ends = [], np.cumsum([0, *(len(trace.way_mm) for trace in traces)])
    for trace, start, end in zip(traces, ends, ends[1:], strict=False):
        ways = trace.way_mm[3:-3]
        columns = trace.risen(ways) * np.sqrt(_STEP_VARIANCE_MM2) / noise[start:end, None]
        across = scaled[start:end].T @ columns
        spread = (columns**2).sum(axis=0) - (across * np.linalg.solve(inner, across)).sum(axis=0)
        pull = columns.T @ residual[start:end]
        gain = pull**2 / (1 + spread) / 2 - np.log1p(spread) / 2 - np.log(sum(len(t.way_mm) - 6 for t in traces))
        at = int(np.argmax(gain))
        found.append((float(gain[at]), float(ways[at])))
    return found
