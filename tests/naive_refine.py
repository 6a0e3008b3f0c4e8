"""Slow, obvious versions of the local search over a plan."""

from collections.abc import Callable

import numpy as np

LEASH = 6
REJOIN = 60
ANCHOR = {"p95": 0.02, "area": 0.3, "frechet": 0.02}


def area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """The area of a triangle."""
    (x, y), (u, v) = b - a, c - a
    return abs(x * v - y * u) / 2


def tick_cost(objective: str, wanted: np.ndarray, printed: np.ndarray, t: int, threshold: float) -> float:
    """What tick t of a print costs, see the kernel."""
    squared = float(((printed[t] - wanted[t]) ** 2).sum())
    if objective == "rmse":
        return squared
    if objective == "p95":
        own = min(max(squared - threshold**2, 0.0), threshold**2 / 2)
    elif objective == "area":
        own = area(wanted[t - 1], wanted[t], printed[t]) + area(wanted[t - 1], printed[t], printed[t - 1])
    else:
        near = wanted[max(t - LEASH, 0) : t + LEASH + 1]
        own = max(float(((near - printed[t]) ** 2).sum(axis=1).min()) - threshold**2, 0.0)
    return own + ANCHOR[objective] * squared


def cost(objective: str, wanted: np.ndarray, printed: np.ndarray, threshold: float) -> float:
    return sum(tick_cost(objective, wanted, printed, t, threshold) for t in range(1, len(wanted)))


def refine(
    objective: str,
    wanted: np.ndarray,
    controls: np.ndarray,
    run: Callable[[np.ndarray], np.ndarray],
    threshold: float,
    c_max: int,
    apart: tuple[int, ...],
) -> np.ndarray:
    """One pass over controls [T, 2]: print everything again, by ``run``, for every edit of the plan."""
    controls = controls.copy()
    least = cost(objective, wanted, run(controls), threshold)
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
                    value = cost(objective, wanted, run(edit), threshold)
                    if value < least - 1e-9:
                        controls, least = edit, value
    return controls


def frechet(one: np.ndarray, other: np.ndarray, reach: int) -> float:
    """The discrete Fréchet distance of paths whose walkers are at most ``reach`` points apart."""
    table = np.full((len(one), len(other)), np.inf)
    for i in range(len(one)):
        for j in range(len(other)):
            if abs(i - j) > reach:
                continue
            ways = [table[i - 1, j] if i else np.inf, table[i, j - 1] if j else np.inf]
            ways.append(table[i - 1, j - 1] if i and j else np.inf)
            table[i, j] = max(np.hypot(*(one[i] - other[j])), 0.0 if i == j == 0 else min(ways))
    return float(table[-1, -1])
