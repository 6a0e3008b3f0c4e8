"""Learn what a pulley repeats every turn, and a bed at every place, from a few traverses, by evidence.

Let x be where the carriage should be, d = ±1 the direction and φ = x + phase of the file (+ lag if d < 0) the pulley's
angle as travel. A traverse is modelled as

    error(x) = d·[Σ_k u_k · (cos, sin)(2πkφ/P) + g(x)] + Σ_k v_k · (cos, sin)(2πkφ/P) + h(x) + steps + drift

What belongs to the pulley's angle (u) or to the place (g: rails, lenses) is undone on the way back; v and h are their
hysteresis. The coefficients of harmonic k have the prior variance A² k^−2p, (1 + r)/2 of it u's; g and h are Gaussian
processes of sizes B and C and length ℓ (Matérn 3/2). Each drift is a line, a random walk of q² a 100 mm (motion capture
integrates its noise) and white noise of s². Steps are sudden slips, where the evidence asks for them. P, the lag, the
phases of all files but the first, A, p, r, q, s, B, C and ℓ maximise the posterior of the training traverses: nothing
else is looked at.

A step that comes at the same angle of most turns belongs to the pulley, the others are accidents. But from first
traverses nobody can tell whether it comes again in later ones: at even odds, half of it is the best prediction.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from threadpoolctl import threadpool_limits

from printmend.path import frozen
from printmend_lab.bench.real.evidence import (
    BUMPS,
    EXPECTED,
    HARMONICS,
    NAMES,
    Settings,
    Trace1d,
    bumps,
    harmonics,
    likeliest_steps,
    system,
    turns_mm,
)

_STEP_GAIN_NATS = 2.0  # of log evidence, beyond the choice of the place, that a step has to bring
_STEPS_A_TRACE, _ROUNDS = 7, 3  # steps that a round adds to a traverse, and rounds, at most
_NEAR_MM = 3.0  # steps this close are one
_LEAST_STEP_MM = 0.1  # a lower step is none
_RETURN_CHANCE = 0.5  # that a slip of every turn comes again
_SCALE = np.array([0.2] + [0.5] * len(NAMES))  # of the turn and the settings, for the descent


@dataclass(frozen=True, eq=False)
class Periodic:
    """What repeats: coefficients [2·HARMONICS + BUMPS] mm of the pulley and the place, and of their hysteresis.

    ``steps`` holds (direction, place, height) of the steps that are predicted.
    """

    settings: Settings
    machine_mm: np.ndarray
    hysteresis_mm: np.ndarray
    steps: tuple[tuple[int, float, float], ...]

    def __post_init__(self) -> None:
        for name in ("machine_mm", "hysteresis_mm"):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), float)))

    def error_mm(self, direction: int, place_mm: np.ndarray, file: int = 0) -> np.ndarray:
        """Predict the error [N] at places [N] of a traverse in ``direction`` (+1, −1), but for a line."""
        waves = harmonics(place_mm + self.settings.shift_mm(direction, file), self.settings.turn_mm)
        repeating = np.concatenate([waves, bumps(place_mm)], axis=1)
        error = np.asarray(repeating @ (direction * self.machine_mm + self.hysteresis_mm))
        for of, place, height in self.steps:
            if of == direction:
                error += height * ((place_mm - place) * direction >= 0)
        return error


def fit(traces: Sequence[Trace1d]) -> Periodic:
    """Learn from one or more traverses in each direction; files count from 0. Adds its steps to the traces."""
    files = 1 + max(trace.file for trace in traces)

    def loss(values: np.ndarray) -> float:
        settings = Settings.of(values)
        return 1e9 if settings.outside() else -system(traces, settings).posterior()[1] + settings.penalty()

    with threadpool_limits(1, user_api="blas"):  # systems of some 100 unknowns: a second thread only waits
        span_mm = max(float(np.ptp(trace.place_mm)) for trace in traces)
        values = _descend(loss, _start(loss, files, span_mm))
        for _ in range(_ROUNDS):
            if not _add_steps(traces, Settings.of(values)):
                break
            values = _descend(loss, values)
        settings = Settings.of(values)
        weights, _ = system(traces, settings).posterior()
    machine, hysteresis, own = np.split(weights, [2 * HARMONICS + BUMPS, 2 * (2 * HARMONICS + BUMPS)])
    return Periodic(settings, machine, hysteresis, _predicted_steps(traces, own, settings.turn_mm))


def _predicted_steps(
    traces: Sequence[Trace1d], own: np.ndarray, turn_mm: float
) -> tuple[tuple[int, float, float], ...]:
    found = []
    for trace in traces:
        heights, own = own[2 : 2 + len(trace.steps_mm)], own[2 + len(trace.steps_mm) :]
        alike = sum(other.direction == trace.direction for other in traces)
        for way, height in recurring(trace, heights, turn_mm):
            found.append((trace.direction, trace.place_mm[0] + trace.direction * way, _RETURN_CHANCE * height / alike))
    return tuple(found)


def recurring(trace: Trace1d, heights_mm: np.ndarray, turn_mm: float) -> list[tuple[float, float]]:
    """Return (way, height) of the steps of every turn: of those at one angle, the median height over all the turns.

    A turn without a step at that angle counts as zero, so that what happened in a minority of turns is an accident.
    """
    merged: list[tuple[float, float]] = []
    for way, height in sorted(zip(trace.steps_mm, heights_mm, strict=True)):
        if merged and way - merged[-1][0] < _NEAR_MM:
            merged[-1] = (merged[-1][0], merged[-1][1] + height)
        else:
            merged.append((way, height))
    merged = [(way, height) for way, height in merged if abs(height) > _LEAST_STEP_MM]
    found = []
    for way, _ in merged:
        off = np.array([(other - way + turn_mm / 2) % turn_mm - turn_mm / 2 for other, _ in merged])
        same = [height for (_, height), away in zip(merged, off, strict=True) if abs(away) < turn_mm / 8]
        turns = int(np.ceil((trace.way_mm[-1] - way % turn_mm) / turn_mm))
        height = float(np.median((same + [0.0] * turns)[: max(turns, 1)]))
        if height != 0.0:
            found.append((way, height))
    return found


def _add_steps(traces: Sequence[Trace1d], settings: Settings) -> int:
    """Add the likeliest step to every traverse that gains by one, and again; return how many."""
    added = 0
    for _ in range(_STEPS_A_TRACE):
        gains = [(trace, *found) for trace, found in zip(traces, likeliest_steps(traces, settings), strict=True)]
        wanted = [(trace, way) for trace, gain, way in gains if gain >= _STEP_GAIN_NATS]
        for trace, way in wanted:
            trace.steps_mm.append(way)
        added += len(wanted)
        if not wanted:
            break
    return added


def _descend(loss: Callable[[np.ndarray], float], values: np.ndarray) -> np.ndarray:
    """Return the values at which the loss is least, searched for from ``values`` on."""
    scale = np.concatenate([_SCALE, np.full(len(values) - len(_SCALE), 0.5)])
    options = {"maxiter": 40, "eps": 1e-4, "ftol": 1e-6}
    start, bounds = np.zeros(len(values)), [(-8, 8)] * len(values)
    found = minimize(lambda off: loss(values + scale * off), start, method="L-BFGS-B", options=options, bounds=bounds)
    return np.asarray(values + scale * found.x)


def _start(loss: Callable[[np.ndarray], float], files: int, span_mm: float) -> np.ndarray:
    """Search the turn, then the phase of each other file."""
    turns = turns_mm(span_mm)
    values = min((np.array([turn, *EXPECTED] + [0.0] * (files - 1)) for turn in turns), key=loss)
    for at in range(1 + len(NAMES), len(values)):
        shifted = [values + phase * (np.arange(len(values)) == at) for phase in np.arange(-6.0, 6.1)]
        values = min(shifted, key=loss)
    return values
