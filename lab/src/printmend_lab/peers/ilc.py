"""Iterative learning control: print the same layer again and again, and shift each command by what was missed.

    r_{k+1} = Q·(r_k + γ·e_k)        e_k = target − measured of print k

S. Arimoto, S. Kawamura and F. Miyazaki, J. Robotic Systems 1 (1984) 123-140; D. A. Bristow, M. Tharayil and A. G.
Alleyne, IEEE Control Systems Magazine 26 (2006) 96-114, with Q a moving average without delay. It has no model, so that
nothing carries over to another layer, and its budget is prints: it is no `Learner`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

GAIN = 0.7  # γ: e contracts by |1 − γg| a print, g being the local gain, 0.6 to 1.4 on broken printers


@dataclass(frozen=True, eq=False)
class Attempt:
    """A print: its ``controls`` [T, 2], and ``missed_steps`` [T + 1, 2], target less measured, NaN where unmeasured."""

    controls: np.ndarray
    missed_steps: np.ndarray

    @property
    def rmse_steps(self) -> float:
        """The error over the measured points."""
        known = np.isfinite(self.missed_steps).all(axis=1)
        return float(np.sqrt((self.missed_steps[known] ** 2).sum(axis=1).mean()))


def iterate(
    print_layer: Callable[[np.ndarray], np.ndarray],
    targets_steps: np.ndarray,
    *,
    prints: int,
    smoothing_ticks: int = 1,
    c_max: int = 3,
) -> list[Attempt]:
    """Print targets [T + 1, 2] ``prints`` times; ``print_layer`` maps controls [T, 2] to what was measured [T + 1, 2].

    Points that were not measured (NaN) count as missed by what lies between their neighbours. The first print is as
    commanded; the last is the best that was learned.
    """
    targets = np.asarray(targets_steps, float)
    reference, attempts = targets.copy(), []
    for _ in range(prints):
        controls = followed(reference, c_max)
        attempts.append(Attempt(controls, targets - print_layer(controls)))
        reference = smoothed(reference + GAIN * _filled(attempts[-1].missed_steps), smoothing_ticks)
        reference[0] = targets[0]
    return attempts


def followed(reference_steps: np.ndarray, c_max: int) -> np.ndarray:
    """Return the controls [T, 2] that stay as near to a reference [T + 1, 2] as full steps and ``c_max`` allow."""
    wanted = np.rint(reference_steps).astype(np.int64)
    controls, at = np.empty((len(wanted) - 1, 2), np.int8), wanted[0]
    for t, place in enumerate(wanted[1:]):
        controls[t] = np.clip(place - at, -c_max, c_max)
        at = at + controls[t]
    return controls


def smoothed(path: np.ndarray, ticks: int) -> np.ndarray:
    """Return the moving average of a path [N, 2] over an odd number of ticks; its ends count as often as needed."""
    if ticks == 1:
        return path
    padded = np.pad(path, ((ticks // 2, ticks // 2), (0, 0)), mode="edge")
    return np.stack([np.convolve(padded[:, k], np.full(ticks, 1 / ticks), mode="valid") for k in range(2)], axis=1)


def _filled(values: np.ndarray) -> np.ndarray:
    out, known = values.copy(), np.isfinite(values).all(axis=1)
    for k in range(2):
        out[:, k] = np.interp(np.arange(len(values)), np.flatnonzero(known), values[known, k])
    return out
