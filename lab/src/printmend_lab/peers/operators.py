"""Play operators, the parts of which models of hysteresis are made (Brokate and Sprekels 1996, ch. 2).

play_r[m]: z ← max(m − r, min(m + r, z)), with z = m at the start of a path. Every operator is independent of the rate,
and of the way-points that a straight move is cut into.
"""

import numpy as np

from printmend_lab.peers.rows import MotorRows


def play(motor_mm: np.ndarray, radii_mm: np.ndarray, engaged: int = 0) -> np.ndarray:
    """Return the play operators [N, R] of half-widths ``radii_mm`` [R] along one path [N] mm.

    ``engaged`` is the way in which the path's first place was reached; 0 where every play rests in its middle there.
    """
    radii = np.asarray(radii_mm, float)
    out = np.empty((len(motor_mm), len(radii)))
    state = float(motor_mm[0]) - engaged * radii
    for n, m in enumerate(np.asarray(motor_mm, float)):
        state = played(state, m, radii)
        out[n] = state
    return out


def played(state_mm: np.ndarray, motor_mm: np.ndarray | float, radii_mm: np.ndarray) -> np.ndarray:
    """Return the operators' next states once the motor is at ``motor_mm``, which broadcasts against them."""
    return np.asarray(np.maximum(motor_mm - radii_mm, np.minimum(motor_mm + radii_mm, state_mm)))


def lags(rows: MotorRows, radii_mm: np.ndarray) -> np.ndarray:
    """Return how far each operator [N, R] lies from the motor, layer by layer: within ±r."""
    parts = [
        play(rows.motor_mm[path], radii_mm, 0 if path.start else rows.engaged) - rows.motor_mm[path, None]
        for path in rows.paths()
    ]
    return np.concatenate(parts)
