"""Slow, obvious versions of the local search over a plan."""

from collections.abc import Callable

import numpy as np


def area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """The area of a triangle."""
    (x, y), (u, v) = b - a, c - a
    return abs(x * v - y * u) / 2


def tick_cost(shares: tuple[float, float], wanted: np.ndarray, printed: np.ndarray, t: int) -> float:
    """What tick t of a print costs, see the kernel."""
    swept = area(wanted[t - 1], wanted[t], printed[t]) + area(wanted[t - 1], printed[t], printed[t - 1])
    return shares[0] * swept + shares[1] * float(((printed[t] - wanted[t]) ** 2).sum())


def cost(shares: tuple[float, float], wanted: np.ndarray, printed: np.ndarray) -> float:
    return sum(tick_cost(shares, wanted, printed, t) for t in range(1, len(wanted)))


def refine(
    shares: tuple[float, float],
    wanted: np.ndarray,
    controls: np.ndarray,
    run: Callable[[np.ndarray], np.ndarray],
    c_max: int,
    apart: tuple[int, ...],
) -> np.ndarray:
    """One pass over controls [T, 2]: print everything again, by ``run``, for every edit of the plan."""
    controls = controls.copy()
    least = cost(shares, wanted, run(controls))
    for t in range(len(controls)):
        for distance in apart:
            for axis in range(2):
                for step in (1, -1, 2, -2):
                    edit = controls.copy()
                    if t + distance >= len(controls):
                        continue
                    edit[t, axis] += step
                    edit[t + distance, axis] -= step
                    if np.abs(edit).max() > c_max:
                        continue
                    value = cost(shares, wanted, run(edit))
                    if value < least - 1e-9:
                        controls, least = edit, value
    return controls
