"""The Prandtl-Ishlinskii operator and its exact inverse.

    u = w0·m + Σ_i w_i·play_{r_i}[m],   w_i ≥ 0

K. Kuhnen, Modeling, identification and compensation of complex hysteretic nonlinearities: a modified Prandtl-Ishlinskii
approach, European Journal of Control 9 (2003) 407-418; P. Krejci and K. Kuhnen, Inverse control of systems with
hysteresis and creep, IEE Proc. Control Theory Appl. 148 (2001) 185-192. Thresholds are equally spaced, weights follow
from non-negative least squares, and how wide the thresholds reach from held-out blocks.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from printmend.path import Trace, frozen
from printmend.printer import Printer
from printmend_lab.peers.memory import Element, MemoryModel, memory_model
from printmend_lab.peers.operators import lags, play, played
from printmend_lab.peers.rows import MotorRows, chosen

_THRESHOLDS = 10
_REACHES_MM = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)  # of the widest threshold
LEAST_GAIN = 0.02  # w0: an operator that stands still has no inverse


@dataclass(frozen=True, eq=False)
class PrandtlIshlinskii:
    """The operator: ``gain`` w0 > 0, thresholds ``radii_mm`` [R] > 0 that rise, ``weights`` [R] ≥ 0."""

    gain: float
    radii_mm: np.ndarray
    weights: np.ndarray

    def __post_init__(self) -> None:
        for name in ("radii_mm", "weights"):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), float)))

    def run(self, motor_mm: np.ndarray) -> np.ndarray:
        """Return the operator's output [N] along a path [N] that starts at rest."""
        return np.asarray(self.gain * motor_mm + play(motor_mm, self.radii_mm) @ self.weights)

    def inverse(self) -> "PrandtlIshlinskii":
        """Return the operator that undoes this one, exactly (physics.md §4).

        w0' = 1/w0, r_i' = w0 r_i + Σ_{j<i} w_j (r_i − r_j), w_i' = −w_i / ((w0 + Σ_{j≤i} w_j)(w0 + Σ_{j<i} w_j))
        """
        upto = self.gain + np.cumsum(self.weights)
        before = upto - self.weights
        apart = np.maximum(self.radii_mm[:, None] - self.radii_mm[None, :], 0.0)
        radii = self.gain * self.radii_mm + (apart * self.weights).sum(axis=1)
        return PrandtlIshlinskii(1 / self.gain, radii, -self.weights / (upto * before))

    def start(self, motor_mm: float) -> np.ndarray:
        """Return the operators' states [R] at rest."""
        return np.full(len(self.radii_mm), motor_mm)

    def step(self, memory: np.ndarray, from_mm: np.ndarray, to_mm: np.ndarray) -> np.ndarray:
        """Return the operators' states [K, R] after straight moves [K]."""
        return played(memory, to_mm[:, None], self.radii_mm)

    def error_mm(self, memory: np.ndarray, motor_mm: np.ndarray) -> np.ndarray:
        """Return the output less the motor's position [K] mm."""
        lag = (self.weights * (memory - motor_mm[:, None])).sum(axis=1)
        return np.asarray((self.gain + self.weights.sum() - 1.0) * motor_mm + lag)


def thresholds_mm(reach_mm: float) -> np.ndarray:
    """Return the thresholds [R] of which the widest is ``reach_mm``; none for 0."""
    return reach_mm * np.arange(1, _THRESHOLDS + 1) / _THRESHOLDS if reach_mm else np.zeros(0)


def fitted_operator(rows: MotorRows, radii_mm: np.ndarray, lags_mm: np.ndarray) -> PrandtlIshlinskii:
    """Fit an operator with the thresholds ``radii_mm`` [R], whose `lags` along the rows' path are ``lags_mm`` [N, R]; a
    bare gain for none."""
    from scipy.optimize import nnls

    motor = rows.motor_mm[:, None]
    columns = rows.centred(np.concatenate([motor, motor + lags_mm], axis=1))
    target = rows.centred(rows.error_mm) + (1 - LEAST_GAIN) * columns[:, 0]
    basis, triangle = np.linalg.qr(columns)  # the same problem in as few rows as there are operators
    weights = nnls(triangle, basis.T @ target)[0]
    return PrandtlIshlinskii(LEAST_GAIN + float(weights[0]), radii_mm, weights[1:])


def prandtl_element(rows: MotorRows) -> Element:
    """Return the operator that predicts held-out blocks best."""

    @cache
    def table(reach_mm: float) -> tuple[np.ndarray, np.ndarray]:  # of the path, whichever rows are measured
        radii = thresholds_mm(reach_mm)
        return radii, lags(rows, radii)

    def fit(some: MotorRows, reach_mm: float) -> np.ndarray:
        radii, lag = table(reach_mm)
        operator = fitted_operator(some, radii, lag)
        return np.asarray((operator.gain + operator.weights.sum() - 1) * rows.motor_mm + lag @ operator.weights)

    return fitted_operator(rows, *table(chosen(rows, (0.0, *_REACHES_MM), fit)))


@dataclass(frozen=True)
class PrandtlLearner:
    """A Prandtl-Ishlinskii operator for each motor, and the skew."""

    name: str = "prandtl-ishlinskii"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> MemoryModel:
        """Learn from a trace. Raise `TraceError` where nothing that moved was measured."""
        return memory_model(trace, printer, prandtl_element)


LEARNERS = {"prandtl-ishlinskii": PrandtlLearner()}
