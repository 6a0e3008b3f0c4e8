"""The Bouc-Wen model, solved exactly along straight moves.

    u = d·m − A·z,   dz = dm − B·|dm|·z − Γ·dm·|z|

M. Rakotondrabe, Bouc-Wen modeling and inverse multiplicative structure to compensate hysteresis nonlinearity in
piezoelectric actuators, IEEE Trans. Automation Science and Engineering 8 (2011) 428-431, whose order is n = 1. Let
w = z·sign(dm): then dw/d|m| = 1 − (B ± Γ)·w with + where w > 0, whose solution is an exponential on either side of 0.
B, Γ: a grid; d, A: least squares on it; whether there is hysteresis at all: held-out blocks.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.peers.memory import Element, MemoryModel, memory_model
from printmend_lab.peers.rows import MotorRows, chosen

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


LEARNERS = {"bouc-wen": BoucWenLearner()}
