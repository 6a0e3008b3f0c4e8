"""Slow, obvious versions of the machine's laws (printmend.machine.kernels), straight from physics.md."""

import numpy as np

from printmend.machine import Frame


def clip(position: float, lower: float, upper: float) -> float:
    """u ← min(max(u, lower), upper) (eq. 7)."""
    if position < lower:
        return lower
    return upper if position > upper else position


def onto_bed(coefficients: np.ndarray, origin: np.ndarray, scale: np.ndarray, place: np.ndarray) -> np.ndarray:
    """x' = x + Σ a_pq ((x + x0)/Lx)^p ((y + y0)/Ly)^q (eq. 14)."""
    u, v = (place + origin) / scale
    terms = np.array([u**p * v**q for p, q in Frame.exponents])
    return place + coefficients @ terms


def waved(waves: np.ndarray, origin: np.ndarray, scale: np.ndarray, place: np.ndarray) -> np.ndarray:
    """What wavy guides add: Σ c cos(kw) + d sin(kw) in x and in y, w the divided place along a direction (eq. 14)."""
    moved, divided = np.zeros(2), (place + origin) / scale
    for along_x, along_y, *sizes in waves:
        angle = along_x * divided[0] + along_y * divided[1]
        moved += np.reshape(sizes, (2, 2)) @ [np.cos(angle), np.sin(angle)]
    return moved


def branch_at(table: np.ndarray, first: float, pitch: float, m: float) -> float:
    """A table between its entries, and with slope 1 beyond them."""
    last = first + pitch * (len(table) - 1)
    inside = min(max(m, first), last)
    return float(np.interp(inside, np.linspace(first, last, len(table)), table)) + m - inside
