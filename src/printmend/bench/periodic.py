"""Learn what a pulley repeats every turn from one traverse in each direction, by evidence.

The two traverses [+, −] are modelled as

    error₊(s) = Σ_k (u_k + v_k) · (cos, sin)(2πks/P) + steps₊(s) + drift₊(s)
    error₋(s) = −Σ_k (u_k − v_k) · (cos, sin)(2πk(θ − s)/P) + steps₋(s) + drift₋(s)

P is the travel of one turn of the pulley as it is, θ the angle (as travel) at which the return starts: what belongs
to the pulley's angle is undone on the way back. The coefficients of harmonic k have the prior variance A² k^−2p; u is
common to both directions (share (1 + r)/2 of it), v is hysteresis. Each drift is a line, a random walk of q² a 100 mm
(motion capture integrates its noise) and white noise of s². Steps are sudden slips, where the evidence asks for them.
P, θ, A, p, r, q and s maximise the marginal likelihood of the training traverses: nothing else is looked at.

A step that comes at the same angle of most turns belongs to the pulley, the others are accidents. But from one
traverse nobody can tell whether it comes at the same places again: at even odds, half of it is the best prediction.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize, minimize_scalar
from threadpoolctl import threadpool_limits

from printmend.bench.periodic_evidence import HARMONICS, Settings, Trace1d, harmonics, likeliest_step, system
from printmend.path import frozen

_STEP_GAIN = 2.0  # of log evidence, beyond the choice of the place
_STEPS_A_ROUND, _ROUNDS = 7, 3
_NEAR_MM = 3.0  # steps this close are one
_SMALLEST_MM = 0.1
_ODDS = 0.5


@dataclass(frozen=True, eq=False)
class Periodic:
    """What repeats: the harmonics' coefficients a direction [2, 2·HARMONICS] mm (cosines, then sines), and why.

    ``steps`` holds, for + and −, the (place, height) mm of the steps that are predicted. ``turn_mm`` is P,
    ``return_mm`` θ, ``shared`` r; ``walk_mm`` q and ``white_mm`` s say how much does not repeat.
    """

    turn_mm: float
    return_mm: float
    coefficients_mm: np.ndarray
    steps: tuple[tuple[tuple[float, float], ...], tuple[tuple[float, float], ...]]
    shared: float
    walk_mm: float
    white_mm: float
    evidence: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients_mm", frozen(np.asarray(self.coefficients_mm, float)))

    def error_mm(self, direction: int, travel_mm: np.ndarray) -> np.ndarray:
        """Predict the error [N] along a traverse in ``direction`` (+1, −1), but for a line."""
        if direction > 0:
            error = harmonics(travel_mm, self.turn_mm) @ self.coefficients_mm[0]
        else:
            error = -harmonics(self.return_mm - travel_mm, self.turn_mm) @ self.coefficients_mm[1]
        for place, height in self.steps[0 if direction > 0 else 1]:
            error = error + height * (travel_mm >= place)
        return error


def fit(plus_travel_mm: np.ndarray, plus_mm: np.ndarray, minus_travel_mm: np.ndarray, minus_mm: np.ndarray) -> Periodic:
    """Learn from a traverse in each direction: travel [N] and error [N] of each, mm."""
    # Systems of some 70 unknowns: a second thread only waits.
    with threadpool_limits(1, user_api="blas"):
        traces = (Trace1d(plus_travel_mm, plus_mm), Trace1d(minus_travel_mm, minus_mm))

        def loss(values: np.ndarray) -> float:
            settings = Settings(*map(float, values))
            return 1e9 if settings.outside() else -system(traces, settings).posterior()[1] + settings.penalty()

        values = _descend(loss, _start(loss), passes=2)
        for _ in range(_ROUNDS):
            if not _add_steps(traces, Settings(*map(float, values))):
                break
            values = _descend(loss, values, passes=1)
        settings = Settings(*map(float, values))
        weights, evidence = system(traces, settings).posterior()
    shared, hysteresis = weights[: 2 * HARMONICS], weights[2 * HARMONICS : 4 * HARMONICS]
    heights = weights[4 * HARMONICS :]
    first = len(traces[0].steps_mm)
    return Periodic(
        turn_mm=settings.turn_mm,
        return_mm=settings.return_mm,
        coefficients_mm=np.stack([shared + hysteresis, shared - hysteresis]),
        steps=(
            recurring(traces[0], heights[2 : 2 + first], settings.turn_mm),
            recurring(traces[1], heights[4 + first :], settings.turn_mm),
        ),
        shared=settings.share,
        walk_mm=float(np.exp(settings.log_walk)),
        white_mm=float(np.exp(settings.log_white)),
        evidence=evidence,
    )


def recurring(trace: Trace1d, heights_mm: np.ndarray, turn_mm: float) -> tuple[tuple[float, float], ...]:
    """Return (place, height) of the steps to predict: of those at one angle, the median height over all the turns.

    A turn without a step at that angle counts as zero, so that what happened in a minority of turns is an accident.
    """
    merged: list[tuple[float, float]] = []
    for place, height in sorted(zip(trace.steps_mm, heights_mm, strict=True)):
        if merged and place - merged[-1][0] < _NEAR_MM:
            merged[-1] = (merged[-1][0], merged[-1][1] + height)
        else:
            merged.append((place, height))
    merged = [(place, height) for place, height in merged if abs(height) > _SMALLEST_MM]
    found = []
    for place, _ in merged:
        off = np.array([(other - place + turn_mm / 2) % turn_mm - turn_mm / 2 for other, _ in merged])
        same = [height for (_, height), away in zip(merged, off, strict=True) if abs(away) < turn_mm / 8]
        turns = int(np.ceil((trace.travel_mm[-1] - place % turn_mm) / turn_mm))
        height = float(np.median((same + [0.0] * turns)[: max(turns, 1)]))
        if height != 0.0:
            found.append((place, _ODDS * height))
    return tuple(found)


def _add_steps(traces: tuple[Trace1d, Trace1d], settings: Settings) -> int:
    """Add the likeliest steps to the traces one by one; return how many."""
    for added in range(_STEPS_A_ROUND):
        gain, side, place = likeliest_step(traces, settings)
        if gain < _STEP_GAIN:
            return added
        traces[side].steps_mm.append(place)
    return _STEPS_A_ROUND


def _descend(loss: Callable[[np.ndarray], float], values: np.ndarray, *, passes: int) -> np.ndarray:
    """Minimise in turns: the turn by itself, for changing it is what costs time, then the others."""
    simplex = np.vstack([np.zeros(6), np.diag([1.0, 0.4, 0.3, 1.0, 0.4, 0.3])])
    for _ in range(passes):

        def turn_loss(turn: float, others: np.ndarray = values[1:]) -> float:
            return loss(np.concatenate([[turn], others]))

        bounds = (values[0] - 0.6, values[0] + 0.6)
        turn = minimize_scalar(turn_loss, method="bounded", bounds=bounds, options={"xatol": 1e-3}).x

        def others_loss(others: np.ndarray, turn: float = turn) -> float:
            return loss(np.concatenate([[turn], others]))

        options = {"maxiter": 200, "xatol": 1e-3, "fatol": 0.05, "initial_simplex": values[1:] + simplex}
        others = minimize(others_loss, values[1:], method="Nelder-Mead", options=options).x
        values = np.concatenate([[turn], others])
    return values


def _start(loss: Callable[[np.ndarray], float]) -> np.ndarray:
    """Search the turn with unrelated directions, then the return's angle with related ones."""
    common = [np.log(0.5), 1.5]
    noise = [np.log(0.2), np.log(0.04)]
    turns = np.arange(34.0, 48.0, 0.5)
    turn = turns[np.argmin([loss(np.array([p, 0.0, *common, -5.9, *noise])) for p in turns])]
    angles = np.arange(0.0, turn, 1.0)
    losses = [loss(np.array([turn, angle, *common, 2.0, *noise])) for angle in angles]
    return np.array([turn, angles[np.argmin(losses)], *common, 1.0, *noise])
