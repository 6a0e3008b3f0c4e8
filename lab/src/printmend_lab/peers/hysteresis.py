"""Peers that model hysteresis: the Prandtl-Ishlinskii operator and the Bouc-Wen model."""

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from printmend.path import Trace, frozen
from printmend.printer import Printer
from printmend_lab.peers.memory import Element, MemoryModel, memory_model
from printmend_lab.peers.rows import MotorRows, chosen

# Play operators, the parts of which models of hysteresis are made (Brokate and Sprekels 1996, ch. 2).
#
# play_r[m]: z ← max(m − r, min(m + r, z)), with z = m at the start of a path. Every operator is independent of the
# rate, and of the way-points that a straight move is cut into.


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


# The Prandtl-Ishlinskii operator and its exact inverse.
#
# u = w0·m + Σ_i w_i·play_{r_i}[m], w_i ≥ 0
#
# K. Kuhnen, Modeling, identification and compensation of complex hysteretic nonlinearities: a modified Prandtl-
# Ishlinskii approach, European Journal of Control 9 (2003) 407-418; P. Krejci and K. Kuhnen, Inverse control of systems
# with hysteresis and creep, IEE Proc. Control Theory Appl. 148 (2001) 185-192. Thresholds are equally spaced, weights
# follow from non-negative least squares, and how wide the thresholds reach from held-out blocks.

_THRESHOLDS = 10
_REACHES_MM = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)  # of the widest threshold
LEAST_OPERATOR_GAIN = 0.02  # w0: an operator that stands still has no inverse


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
    target = rows.centred(rows.error_mm) + (1 - LEAST_OPERATOR_GAIN) * columns[:, 0]
    basis, triangle = np.linalg.qr(columns)  # the same problem in as few rows as there are operators
    weights = nnls(triangle, basis.T @ target)[0]
    return PrandtlIshlinskii(LEAST_OPERATOR_GAIN + float(weights[0]), radii_mm, weights[1:])


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


# The Bouc-Wen model, solved exactly along straight moves.
#
# u = d·m − A·z, dz = dm − B·|dm|·z − Γ·dm·|z|
#
# M. Rakotondrabe, Bouc-Wen modeling and inverse multiplicative structure to compensate hysteresis nonlinearity in
# piezoelectric actuators, IEEE Trans. Automation Science and Engineering 8 (2011) 428-431, whose order is n = 1. Let w
# = z·sign(dm): then dw/d|m| = 1 − (B ± Γ)·w with + where w > 0, whose solution is an exponential on either side of 0.
# B, Γ: a grid; d, A: least squares on it; whether there is hysteresis at all: held-out blocks.

_LIMITS_MM = np.geomspace(0.01, 2.0, 27)  # z where it ends, 1/(B + Γ)
_SHAPES = (-0.5, 0.0, 0.5, 1.0)  # Γ/B; 1 leaves a turn along a straight line
LEAST_GAIN = 0.02  # of du/dm: a model that stands still has no inverse


class Shape(NamedTuple):
    """B and Γ [1/mm], numbers or arrays."""

    b: np.ndarray | float
    gamma: np.ndarray | float


def moved(z_mm: np.ndarray, by_mm: np.ndarray | float, shape: Shape) -> np.ndarray:
    """Return z after a straight move; all broadcast."""
    way, far = np.sign(by_mm), np.abs(by_mm)
    w = z_mm * way
    below, above = shape.b - shape.gamma, shape.b + shape.gamma
    to_zero = np.where(w < 0, _ways_to_zero(np.minimum(w, 0.0), below), 0.0)
    first = np.minimum(far, to_zero)
    down = np.where(w < 0, np.where(far < to_zero, _relaxed(w, first, below), 0.0), w)
    after = np.where(far > to_zero, _relaxed(np.maximum(down, 0.0), far - first, above), down)
    return np.where(way == 0, z_mm, after * way)


def _relaxed(w: np.ndarray, far: np.ndarray, rate: np.ndarray | float) -> np.ndarray:
    """Return w(far) of dw/ds = 1 − rate·w."""
    slow = np.abs(rate) < 1e-12
    safe = np.where(slow, 1.0, rate)
    return np.where(slow, w + far, w * np.exp(-safe * far) - np.expm1(-safe * far) / safe)


def _ways_to_zero(w: np.ndarray, rate: np.ndarray | float) -> np.ndarray:
    """Return how far it is from w ≤ 0 to 0: ln(1 − rate·w)/rate."""
    slow = np.abs(rate) < 1e-12
    safe = np.where(slow, 1.0, rate)
    return np.where(slow, -w, np.log1p(-safe * w) / safe)


@dataclass(frozen=True)
class BoucWen:
    """One motor: ``gain`` d, ``height`` A, and the shape."""

    gain: float
    height: float
    shape: Shape

    def start(self, motor_mm: float) -> np.ndarray:
        """Return z [1] at rest."""
        return np.zeros(1)

    def step(self, memory: np.ndarray, from_mm: np.ndarray, to_mm: np.ndarray) -> np.ndarray:
        """Return z [K, 1] after straight moves [K]."""
        return moved(memory, (to_mm - from_mm)[:, None], self.shape)

    def error_mm(self, memory: np.ndarray, motor_mm: np.ndarray) -> np.ndarray:
        """Return u − m [K] mm."""
        return np.asarray((self.gain - 1.0) * motor_mm - self.height * memory[:, 0])

    def inverse(self, wanted_mm: np.ndarray, *, pitch_mm: float = 1e-3) -> np.ndarray:
        """Return the motor path [N] that gives u along ``wanted_mm`` [N] from rest: m = (u + A·z)/d, z from before.

        This is the paper's inverse multiplicative structure, on steps of ``pitch_mm``, over which z hardly changes.
        """
        path = [float(wanted_mm[0] / self.gain)]
        z, u, m = np.zeros(1), float(wanted_mm[0]), path[0]
        for target in np.asarray(wanted_mm, float)[1:]:
            count = max(1, int(np.ceil(abs(target - u) / pitch_mm)))
            for wanted in np.linspace(u, target, count + 1)[1:]:
                to = float((wanted + self.height * z[0]) / self.gain)
                for _ in range(3):  # z moves with m: settle both
                    to = float((wanted + self.height * moved(z, to - m, self.shape)[0]) / self.gain)
                z, m = moved(z, to - m, self.shape), to
            u = float(target)
            path.append(m)
        return np.array(path)


def fitted_boucwen(rows: MotorRows, states_mm: np.ndarray, shapes: Shape) -> BoucWen:
    """Fit d and A for every shape [S], whose z are ``states_mm`` [N, S]; return the best."""
    motor = rows.centred(rows.motor_mm[:, None])[:, 0]
    place, z = motor + rows.centred(rows.error_mm), rows.centred(states_mm)
    b, gamma = np.asarray(shapes.b), np.asarray(shapes.gamma)
    steepest = 1 + np.maximum(b - gamma, 0.0) / (b + gamma)  # of dz/dm, just after a turn
    mm, mz, zz = motor @ motor, motor @ z, (z**2).sum(axis=0)
    det = np.maximum(mm * zz - mz**2, 1e-12 * mm * np.maximum(zz, 1e-12))
    gain = (zz * (motor @ place) - mz * (place @ z)) / det
    height = (mz * (motor @ place) - mm * (place @ z)) / det
    free = (height >= 0) & (height * steepest <= (1 - LEAST_GAIN) * gain)
    share = np.where(height < 0, 0.0, (1 - LEAST_GAIN) / steepest)  # on the bound: u = gain·(m − share·z)
    bound = motor[:, None] - share * z
    bound_gain = np.maximum((place[:, None] * bound).sum(axis=0) / np.maximum((bound**2).sum(axis=0), 1e-12), 0.1)
    gain, height = np.where(free, gain, bound_gain), np.where(free, height, share * bound_gain)
    left = ((place[:, None] - gain * motor[:, None] + height * z) ** 2).sum(axis=0)
    at = int(np.argmin(left))
    return BoucWen(float(gain[at]), float(height[at]), Shape(float(b[at]), float(gamma[at])))


def boucwen_element(rows: MotorRows) -> Element:
    """Return the model that predicts held-out blocks best; without hysteresis where that helps nothing."""
    limit, ratio = (grid.ravel() for grid in np.meshgrid(_LIMITS_MM, _SHAPES))
    b = 1 / (limit * (1 + ratio))
    shapes = Shape(b, ratio * b)
    states = states_along(rows, shapes)

    def some_shapes(hysteresis: bool) -> tuple[np.ndarray, Shape]:
        return (states, shapes) if hysteresis else (0 * states[:, :1], Shape(shapes.b[:1], shapes.gamma[:1]))  # type: ignore[index]

    def fit(some: MotorRows, hysteresis: bool) -> np.ndarray:
        z, tried = some_shapes(hysteresis)
        model = fitted_boucwen(some, z, tried)
        at = int(np.flatnonzero((tried.b == model.shape.b) & (tried.gamma == model.shape.gamma))[0])
        return np.asarray((model.gain - 1) * rows.motor_mm - model.height * z[:, at])

    return fitted_boucwen(rows, *some_shapes(chosen(rows, (False, True), fit)))


def states_along(rows: MotorRows, shapes: Shape) -> np.ndarray:
    """Return z [N, S] along the rows' path for every shape [S]."""
    out = np.zeros((len(rows.layer), np.size(shapes.b)))
    for path in rows.paths():
        steps = np.diff(rows.motor_mm[path])
        z = np.zeros(out.shape[1])
        if path.start == 0 and rows.engaged:
            z = rows.engaged / (np.asarray(shapes.b) + np.asarray(shapes.gamma))
        out[path.start] = z
        for n, by in enumerate(steps.tolist(), path.start + 1):
            if by:
                z = moved(z, by, shapes)
            out[n] = z
    return out


@dataclass(frozen=True)
class BoucWenLearner:
    """A Bouc-Wen model for each motor, and the skew."""

    name: str = "bouc-wen"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> MemoryModel:
        """Learn from a trace. Raise `TraceError` where nothing that moved was measured."""
        return memory_model(trace, printer, boucwen_element)


LEARNERS = {"prandtl-ishlinskii": PrandtlLearner(), "bouc-wen": BoucWenLearner()}
