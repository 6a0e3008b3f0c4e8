"""A nonlinear autoregressive model with exogenous input, its terms picked out of a library one by one.

    de = dm·Σ_i θ_i ψ_i(m, sign dm, e)        e = u − m

S. A. Billings, Nonlinear System Identification (2013), ch. 3: forward regression orthogonal least squares, ranked by
the error reduction ratio. That every term is multiplied by the input's change is what a NARX model of hysteresis needs
to stand still when the input does (P. E. O. G. B. Abreu et al., Nonlinear Dynamics 102, 2020). With sines of
the motor's turn in the library it is also what SINDy would find (S. L. Brunton et al., PNAS 113 (2016) 3932-3937),
which picks in another way. The weights are fitted once more to free runs, as the noise of increments would bias them.
Held-out blocks decide, in free run, how many terms stay.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from printmend.path import Trace, frozen
from printmend.printer import Printer
from printmend_lab.peers.memory import Element, MemoryModel, memory_model
from printmend_lab.peers.rows import MotorRows, chosen

_HARMONICS = 4  # of a turn in the library
_STEP_MM = 0.2  # of the integration
_LEAST_GAIN, _MOST_GAIN = 0.02, 2.5  # of du/dm, so that a model neither stands still nor runs away
_REFERENCE_MM = 100.0  # places are counted in this
_MOST_WIDER = 1.5  # spread of a free run's error over that of the measured ones
_APART_MM = 1.0  # of path between the rows whose increments are regressed
_FIRST_GUESS = -0.8, -2.0  # weights of the plainest hysteresis: 0.4 mm wide
_REFINED = 5  # times that a free run is looked at along every weight
_MOST_ERROR_MM = 20.0  # e that the terms see


class Option(NamedTuple):
    """How many terms are picked, and whether those of the plainest hysteresis, dm and |dm|·e, are there anyway."""

    terms: int
    hysteresis: bool = False


OPTIONS = (
    Option(0), Option(1), Option(2), Option(4), Option(8), Option(0, True), Option(4, True), Option(8, True),
)  # fmt: skip


def places_library(motor_mm: np.ndarray, way: np.ndarray, turn_mm: float) -> np.ndarray:
    """Return the terms [N, F] that do not know e: 1, m, m², the turn's harmonics; and each times the way."""
    angle = np.outer(2 * np.pi * motor_mm / turn_mm, np.arange(1, _HARMONICS + 1))
    m = (motor_mm / _REFERENCE_MM)[:, None]
    even = np.concatenate([np.ones_like(m), m, m**2, np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([even, way[:, None] * even], axis=1)


def state_library(error_mm: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Return the terms [N, 4] that do: e and e², and each times the way."""
    e = np.clip(error_mm, -_MOST_ERROR_MM, _MOST_ERROR_MM)
    return np.stack([e, way * e, e**2, way * e**2], axis=1)


@dataclass(frozen=True, eq=False)
class Narx:
    """One motor: the weights of `places_library`, then of `state_library`."""

    weights: np.ndarray
    turn_mm: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", frozen(np.asarray(self.weights, float)))

    def slope(self, motor_mm: np.ndarray, way: np.ndarray, error_mm: np.ndarray) -> np.ndarray:
        """Return de/dm [K]."""
        terms = [places_library(motor_mm, way, self.turn_mm), state_library(error_mm, way)]
        slope = (self.weights * np.concatenate(terms, axis=1)).sum(axis=1)
        return np.asarray(np.clip(slope, _LEAST_GAIN - 1, _MOST_GAIN - 1))

    def start(self, motor_mm: float) -> np.ndarray:
        """Return e [1] where a layer starts."""
        return np.zeros(1)

    def step(self, memory: np.ndarray, from_mm: np.ndarray, to_mm: np.ndarray) -> np.ndarray:
        """Return e [K, 1] after straight moves [K], integrated in steps of at most 0.2 mm."""
        error, at, way = memory[:, 0], from_mm, np.sign(to_mm - from_mm)
        while (at != to_mm).any():
            left = np.abs(to_mm - at)
            by = np.where(left > _STEP_MM, _STEP_MM, left)
            error = error + way * by * self.slope(at + way * by / 2, way, error)
            at = np.where(left > _STEP_MM, at + way * by, to_mm)
        return error[:, None]

    def error_mm(self, memory: np.ndarray, motor_mm: np.ndarray) -> np.ndarray:
        """Return e [K] mm."""
        return memory[:, 0]


class Walk(NamedTuple):
    """A path cut into small moves: of each its middle, its way, its length, and the row where it ends; ``first`` of a
    layer."""

    middle_mm: np.ndarray
    way: np.ndarray
    by_mm: np.ndarray
    row: np.ndarray


def walked(rows: MotorRows, path: slice, pitch_mm: float = 2 * _STEP_MM) -> Walk:
    """Cut the rows' path into moves of at most ``pitch_mm``."""
    motor = rows.motor_mm[path]
    counts = np.maximum(np.ceil(np.abs(np.diff(motor)) / pitch_mm), 1).astype(int)
    row = np.repeat(np.arange(1, len(motor)), counts)
    share = (np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts) + 0.5) / counts[row - 1]
    by = np.diff(motor)[row - 1] / counts[row - 1]
    return Walk(motor[row - 1] + share * np.diff(motor)[row - 1], np.sign(by), by, row)


def free_run(model: Narx, rows: MotorRows) -> np.ndarray:
    """Return the error [N] mm that the model alone says along the rows' path."""
    out, state = np.zeros(len(rows.layer)), model.weights[-4:]
    for path in rows.paths():
        walk = walked(rows, path)
        base = (places_library(walk.middle_mm, walk.way, model.turn_mm) @ model.weights[:-4]).tolist()
        once, twice = (state[0] + walk.way * state[1]).tolist(), (state[2] + walk.way * state[3]).tolist()
        e, at = 0.0, []
        for b, c1, c2, by in zip(base, once, twice, walk.by_mm.tolist(), strict=True):
            seen = min(max(e, -_MOST_ERROR_MM), _MOST_ERROR_MM)
            e += by * min(max(b + (c1 + c2 * seen) * seen, _LEAST_GAIN - 1), _MOST_GAIN - 1)
            at.append(e)
        ends = np.flatnonzero(np.diff(walk.row, append=-1))
        out[path.start + 1 : path.stop] = np.array(at)[ends] if at else 0.0
    return out


def increments(rows: MotorRows, apart_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the terms' integrals [n, F] and the errors' increments [n] between measured rows ``apart_mm`` of path
    apart, or more. Between them e is taken to be straight."""
    designs, values = [], []
    for path in rows.paths():
        motor, error = rows.motor_mm[path], rows.error_mm[path]
        gone = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(motor)))])
        kept: list[int] = []
        for n in np.flatnonzero(np.isfinite(error)):
            if not kept or gone[n] - gone[kept[-1]] >= apart_mm:
                kept.append(int(n))
        if len(kept) < 2:
            continue
        walk = walked(rows, path)
        along = np.cumsum(np.abs(walk.by_mm)) - np.abs(walk.by_mm) / 2
        e = np.interp(along, gone[kept], error[kept] - error[kept].mean())
        terms = [places_library(walk.middle_mm, walk.way, rows.turn_mm), state_library(e, walk.way)]
        moves = np.concatenate(terms, axis=1) * walk.by_mm[:, None]
        sums = np.concatenate([np.zeros((1, moves.shape[1])), np.cumsum(moves, axis=0)])
        ends = np.searchsorted(walk.row, np.array(kept), side="right")
        designs.append(np.diff(sums[ends], axis=0))
        values.append(np.diff(error[kept]))
    if not designs:
        return np.zeros((0, 2 * (3 + 2 * _HARMONICS) + 4)), np.zeros(0)
    return np.concatenate(designs), np.concatenate(values)


def picked(design: np.ndarray, value: np.ndarray, terms: int) -> np.ndarray:
    """Return the weights [F] of the ``terms`` columns that forward orthogonal least squares picks; 0 of all others."""
    weights, columns, left = np.zeros(design.shape[1]), design.copy(), value.copy()
    norms = (columns**2).sum(axis=0)
    order: list[int] = []
    for _ in range(min(terms, len(value) - 1, design.shape[1])):
        size = (columns**2).sum(axis=0)
        ratio = np.where(size > 1e-9 * norms, (columns.T @ left) ** 2 / np.maximum(size, 1e-300), 0.0)
        best = int(np.argmax(ratio))
        if ratio[best] <= 1e-20:
            break
        order.append(best)
        axis = columns[:, best] / np.sqrt(size[best])
        left = left - axis * (axis @ left)
        columns = columns - np.outer(axis, axis @ columns)
    if order:
        weights[order] = np.linalg.lstsq(design[:, order], value, rcond=1e-9)[0]
    return weights


def fitted_narx(rows: MotorRows, option: Option) -> Narx:
    """Pick terms from increments, then fit their weights to free runs, which noise of the increments does not bias."""
    design, value = increments(rows, _APART_MM)
    weights = np.zeros(design.shape[1])
    if option.hysteresis:
        weights[0], weights[-3] = _FIRST_GUESS
    model = Narx(weights + picked(design, value - design @ weights, option.terms), rows.turn_mm)
    return refined(model, rows) if model.weights.any() else model


def refined(model: Narx, rows: MotorRows) -> Narx:
    """Return the model whose free run along the rows is nearest to them, from weights that are there."""
    from scipy.optimize import least_squares

    at, target = np.flatnonzero(model.weights), rows.centred(rows.error_mm[:, None])[:, 0]

    def changed(values: np.ndarray) -> Narx:
        weights = model.weights.copy()
        weights[at] = values
        return Narx(weights, model.turn_mm)

    def left(values: np.ndarray) -> np.ndarray:
        return np.asarray(rows.centred(free_run(changed(values), rows)[:, None])[:, 0] - target)

    found = least_squares(
        left, model.weights[at], x_scale=np.maximum(np.abs(model.weights[at]), 1e-3), max_nfev=_REFINED
    )
    return changed(found.x)


def stays_bounded(model: Narx, rows: MotorRows) -> bool:
    """Say whether going back and forth over what was seen, far and near, leads to no error beyond what was measured.

    A sum of increments may drift for ever: such a model is none (Billings 2013, ch. 5: look at free runs).
    """
    seen = rows.motor_mm[rows.known]
    low, high = float(seen.min()), float(seen.max())
    near = np.linspace(low, high, 9)
    corners = [*[low, high] * 4, *np.repeat(near, 2)[1:-1], *near[::-2], *[low, (low + high) / 2] * 4]
    errors = free_run(model, MotorRows(np.array(corners), np.zeros(len(corners)), np.zeros(len(corners), int)))
    return bool(np.ptp(errors) <= _MOST_WIDER * np.ptp(rows.error_mm[rows.known]) + _STEP_MM)


def narx_element(rows: MotorRows) -> Element:
    """Return the model that predicts held-out blocks best, of those that stay bounded."""
    options = [option for option in OPTIONS if not any(option) or stays_bounded(fitted_narx(rows, option), rows)]
    return fitted_narx(rows, chosen(rows, options, lambda some, option: free_run(fitted_narx(some, option), some)))


@dataclass(frozen=True)
class NarxLearner:
    """A NARX model for each motor, and the skew."""

    name: str = "narx"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> MemoryModel:
        """Learn from a trace. Raise `TraceError` where nothing that moved was measured."""
        return memory_model(trace, printer, narx_element)


# A row by its place, `peers.narx:NARX`: planned by Algorithm 1 it can be worse than no model after few points
# with play, which a registered learner must not be. `printmend_lab.peers.inverse:INVERSE` plans with it.
NARX = NarxLearner()
