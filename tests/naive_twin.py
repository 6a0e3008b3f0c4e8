"""Slow, obvious versions of the twin and of the corruptions, straight from the equations of physics.md."""

import numpy as np


def play(motor: np.ndarray, start: float, lower: np.ndarray, upper: np.ndarray) -> list[float]:
    """u ← min(max(u, lower(m)), upper(m)), one step at a time (eq. 7)."""
    u = start
    positions = [u]
    for m in motor:
        if u < lower[m]:
            u = lower[m]
        if u > upper[m]:
            u = upper[m]
        positions.append(u)
    return positions


def gain_step(p: int, c: int, gains: np.ndarray) -> float:
    """One control by the rules of physics.md §8.1."""
    x = float(p)
    for _ in range(abs(c)):
        x += np.sign(c) * gains[round(x) - 1]
        x = min(max(x, 0.0), len(gains) - 1.0)
    return x - p


def gain_run(controls: np.ndarray, start: int, gains: np.ndarray, bed: int) -> list[float]:
    printed, nominal = float(start), start
    positions = [printed]
    for c in controls:
        printed = min(max(printed + gain_step(nominal, int(c), gains), 0.0), float(bed))
        nominal = min(max(nominal + int(c), 0), bed)
        positions.append(printed)
    return positions


def hull_support_mm(points_mm: np.ndarray, phi_rad: np.ndarray) -> np.ndarray:
    """h(φ) = max over hull points p of p·(cos φ, sin φ) (eq. 1)."""
    return np.array([(points_mm @ [np.cos(phi), np.sin(phi)]).max() for phi in phi_rad])
