"""Slow and obvious versions of what printmend.measure computes."""

import numpy as np


def best_similarity(points: np.ndarray, wanted: np.ndarray, *, scale: bool) -> np.ndarray:
    """Turn, shift and (if asked) stretch points [N, 2] onto ``wanted`` by a general minimiser."""
    from scipy.optimize import minimize  # each worker reads this file, and few run it

    middle, target = points.mean(axis=0), wanted.mean(axis=0)

    def moved(values: np.ndarray) -> np.ndarray:
        c, s = np.cos(values[0]), np.sin(values[0])
        size = 1 + values[1] if scale else 1.0
        return target + size * (points - middle) @ np.array([[c, s], [-s, c]])

    best = minimize(lambda values: ((moved(values) - wanted) ** 2).sum(), np.zeros(2), method="Nelder-Mead",
                    options={"xatol": 1e-10, "fatol": 1e-12, "maxiter": 2000})  # fmt: skip
    return moved(best.x)
