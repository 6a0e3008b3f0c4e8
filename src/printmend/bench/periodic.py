"""Learn what a pulley repeats every turn from one traverse in each direction, by evidence.

The two traverses [+, −] are modelled as

    error₊(s) = Σ_k (u_k + v_k) · (cos, sin)(2πks/P) + drift₊(s)
    error₋(s) = −Σ_k (u_k − v_k) · (cos, sin)(2πk(θ − s)/P) + drift₋(s)

P is the travel of one turn of the pulley as it is, θ the angle (as travel) at which the return starts: what belongs
to the pulley's angle is undone on the way back. The coefficients of harmonic k have the prior variance A² k^−2p; u is
common to both directions (share (1 + r)/2 of it), v is hysteresis. Each drift is a line, a random walk of q² a 100 mm
(motion capture integrates its noise) and white noise of s². P, θ, A, p, r, q and s maximise the marginal likelihood
of the training traverses: nothing else is looked at.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize, minimize_scalar
from threadpoolctl import threadpool_limits

from printmend.path import frozen

HARMONICS = 16
_LINE_VARIANCE_MM2 = 100.0
_K = np.arange(1, HARMONICS + 1)


@dataclass(frozen=True, eq=False)
class Periodic:
    """What repeats: the harmonics' coefficients a direction [2, 2·HARMONICS] mm (cosines, then sines), and why.

    ``turn_mm`` is P, ``return_mm`` θ, ``shared`` r; ``walk_mm`` q and ``white_mm`` s say how much does not repeat.
    """

    turn_mm: float
    return_mm: float
    coefficients_mm: np.ndarray
    shared: float
    walk_mm: float
    white_mm: float
    evidence: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients_mm", frozen(np.asarray(self.coefficients_mm, float)))

    def error_mm(self, direction: int, travel_mm: np.ndarray) -> np.ndarray:
        """Predict the error [N] along a traverse in ``direction`` (+1, −1), but for a line."""
        if direction > 0:
            return _harmonics(travel_mm, self.turn_mm) @ self.coefficients_mm[0]
        return -_harmonics(self.return_mm - travel_mm, self.turn_mm) @ self.coefficients_mm[1]


def fit(plus_travel_mm: np.ndarray, plus_mm: np.ndarray, minus_travel_mm: np.ndarray, minus_mm: np.ndarray) -> Periodic:
    """Learn from a traverse in each direction: travel [N] and error [N] of each, mm."""
    # Systems of 68 unknowns: a second thread only waits.
    with threadpool_limits(1, user_api="blas"):
        traces = (_Whitener(plus_travel_mm, plus_mm), _Whitener(minus_travel_mm, minus_mm))

        def loss(values: np.ndarray) -> float:
            settings = _Settings(*map(float, values))
            return 1e9 if settings.outside() else -_posterior(traces, settings)[1] + settings.penalty()

        settings = _best(loss)
        weights, evidence = _posterior(traces, settings)
    shared, hysteresis = weights[: 2 * HARMONICS], weights[2 * HARMONICS : 4 * HARMONICS]
    return Periodic(
        turn_mm=settings.turn_mm,
        return_mm=settings.return_mm,
        coefficients_mm=np.stack([shared + hysteresis, shared - hysteresis]),
        shared=settings.share,
        walk_mm=float(np.exp(settings.log_walk)),
        white_mm=float(np.exp(settings.log_white)),
        evidence=evidence,
    )


@dataclass(frozen=True)
class _Settings:
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


def _best(loss: Callable[[np.ndarray], float]) -> _Settings:
    """Minimise in turns: the turn by itself, for changing it is what costs time, then the others."""
    values = _start(loss)
    simplex = np.vstack([np.zeros(6), np.diag([1.0, 0.4, 0.3, 1.0, 0.4, 0.3])])
    for _ in range(2):

        def turn_loss(turn: float, others: np.ndarray = values[1:]) -> float:
            return loss(np.concatenate([[turn], others]))

        bounds = (values[0] - 0.6, values[0] + 0.6)
        turn = minimize_scalar(turn_loss, method="bounded", bounds=bounds, options={"xatol": 1e-3}).x

        def others_loss(others: np.ndarray, turn: float = turn) -> float:
            return loss(np.concatenate([[turn], others]))

        options = {"maxiter": 200, "xatol": 1e-3, "fatol": 0.05, "initial_simplex": values[1:] + simplex}
        others = minimize(others_loss, values[1:], method="Nelder-Mead", options=options).x
        values = np.concatenate([[turn], others])
    return _Settings(*map(float, values))


def _start(loss: Callable[[np.ndarray], float]) -> np.ndarray:
    """Search the turn with unrelated directions, then the return's angle with related ones."""
    common = [np.log(0.5), 1.5]
    noise = [np.log(0.2), np.log(0.04)]
    turns = np.arange(34.0, 48.0, 0.5)
    turn = turns[np.argmin([loss(np.array([p, 0.0, *common, -5.9, *noise])) for p in turns])]
    angles = np.arange(0.0, turn, 1.0)
    losses = [loss(np.array([turn, angle, *common, 2.0, *noise])) for angle in angles]
    return np.array([turn, angles[np.argmin(losses)], *common, 1.0, *noise])


class _Whitener:
    """A traverse in the eigenvectors of the random walk, where every drift's covariance is diagonal."""

    def __init__(self, travel_mm: np.ndarray, error_mm: np.ndarray) -> None:
        self.travel_mm = np.asarray(travel_mm, float)
        walk = np.minimum.outer(self.travel_mm, self.travel_mm) / 100.0
        values, self.vectors = np.linalg.eigh(walk)
        self.values = np.maximum(values, 0.0)
        self.error = self.vectors.T @ np.asarray(error_mm, float)
        middle = (self.travel_mm - self.travel_mm.mean()) / 100.0
        self.line = self.vectors.T @ np.stack([np.ones_like(middle), middle], axis=1)
        self._turn_mm, self._waves = np.nan, np.empty((0, 0))

    def waves(self, turn_mm: float) -> np.ndarray:
        """Return the harmonics over this traverse [N, 2·HARMONICS]; the last turn's are remembered."""
        if turn_mm != self._turn_mm:
            self._turn_mm, self._waves = turn_mm, self.vectors.T @ _harmonics(self.travel_mm, turn_mm)
        return self._waves


def _harmonics(travel_mm: np.ndarray, turn_mm: float) -> np.ndarray:
    angle = np.outer(travel_mm, _K) * (2 * np.pi / turn_mm)
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=1)


def _posterior(traces: tuple[_Whitener, _Whitener], settings: _Settings) -> tuple[np.ndarray, float]:
    """Return the mean weights (shared, hysteresis, lines) and the log marginal likelihood, up to a constant."""
    plus, minus = traces
    forth = plus.waves(settings.turn_mm)
    # −(cos, sin)(kθ − ks) from (cos, sin)(ks), by the addition theorems
    cosine, sine = minus.waves(settings.turn_mm)[:, :HARMONICS], minus.waves(settings.turn_mm)[:, HARMONICS:]
    angle = 2 * np.pi * _K * settings.return_mm / settings.turn_mm
    c, s = np.cos(angle), np.sin(angle)
    back = -np.concatenate([c * cosine + s * sine, s * cosine - c * sine], axis=1)
    lines = np.zeros((len(forth) + len(back), 4))
    lines[: len(forth), :2], lines[len(forth) :, 2:] = plus.line, minus.line
    design = np.concatenate([np.vstack([forth, back]), np.vstack([forth, -back]), lines], axis=1)
    size = np.exp(2 * settings.log_size) * np.tile(_K.astype(float), 2) ** (-2 * settings.decay)
    prior = np.concatenate(
        [size * (1 + settings.share) / 2, size * (1 - settings.share) / 2, np.full(4, _LINE_VARIANCE_MM2)]
    )
    variance = np.exp(2 * settings.log_walk) * np.concatenate([plus.values, minus.values])
    noise = np.sqrt(variance + np.exp(2 * settings.log_white))
    scaled = design * np.sqrt(prior) / noise[:, None]
    target = np.concatenate([plus.error, minus.error]) / noise
    lower = np.linalg.cholesky(np.eye(scaled.shape[1]) + scaled.T @ scaled)
    projected = np.linalg.solve(lower, scaled.T @ target)
    evidence = -(target @ target - projected @ projected) / 2 - np.log(np.diag(lower)).sum() - np.log(noise).sum()
    return np.sqrt(prior) * np.linalg.solve(lower.T, projected), float(evidence)
