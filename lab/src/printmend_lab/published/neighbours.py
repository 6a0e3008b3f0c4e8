"""The published code's simplest learners: the nearest rows, and a straight line (physics.md §8 and §8.1).

The features and targets are those of the trees. Both axes together have no table: they are asked move by move.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.published.increments import AxisModel, JointUnits, transitions_of

Predict = Callable[[np.ndarray], np.ndarray]
Regress = Callable[[np.ndarray, np.ndarray], Predict]
"""Fit rows [N, F] to values [N, outputs]; return what predicts values [K, outputs] at rows [K, F]."""


def nearest(rows: np.ndarray, values: np.ndarray) -> Predict:
    """Fit a default ``KNeighborsRegressor``."""
    from sklearn.neighbors import KNeighborsRegressor

    model = KNeighborsRegressor(n_jobs=1).fit(rows, values)
    return lambda asked: np.asarray(model.predict(asked))


def line(rows: np.ndarray, values: np.ndarray) -> Predict:
    """Fit a default ``LinearRegression``."""
    from sklearn.linear_model import LinearRegression

    model = LinearRegression().fit(rows, values)
    # summed row by row, so that a batch says what its rows say
    return lambda asked: (asked[:, None, :] * model.coef_).sum(axis=2) + model.intercept_


@dataclass(frozen=True, eq=False)
class JointModel(JointUnits):
    """A regression over (x nominal, y nominal, sign cx, sign cy) with two outputs, the displacements of one tick."""

    printer: Printer
    predict: Predict

    def unit_displacement(self, nominal: np.ndarray, signs: np.ndarray) -> np.ndarray:
        """Return the predicted displacement [K, 2] of one tick; an axis at rest stays."""
        rows = np.concatenate([nominal, signs], axis=1).astype(float)
        rows, place = np.unique(rows, axis=0, return_inverse=True)
        return np.asarray(self.predict(rows)[place.reshape(-1)] * np.abs(signs))

    def tabulate(self, start_steps: np.ndarray, *, c_max: int = 3) -> None:
        """Return nothing: every place of the bed would be a cell."""
        return None


@dataclass(frozen=True)
class JointLearner:
    """Both axes from both axes."""

    name: str
    regress: Regress

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> JointModel:
        """Fit one-tick displacements to (x, y, sign cx, sign cy). Raise `TraceError` for a trace without moves."""
        data = transitions_of(trace, printer)
        rows = np.concatenate([data.nominal_steps, data.controls], axis=1).astype(float)
        return JointModel(printer, self.regress(rows, data.displacement_steps))


@dataclass(frozen=True)
class AxisLearner:
    """Each axis from itself: displacement × sign(c) over the nominal position, rows in which that axis moved."""

    name: str
    regress: Regress

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> AxisModel:
        """Fit a gain for each axis; an axis that never moved is taken as healthy. Raise `TraceError` without moves."""
        data = transitions_of(trace, printer)
        gains = []
        for axis, bed in enumerate(printer.bed_steps):
            moves = data.controls[:, axis] != 0
            values = data.displacement_steps[moves, axis, None] * data.controls[moves, axis, None]
            if not moves.any():
                gains.append(np.ones(bed + 1))
                continue
            predict = self.regress(data.nominal_steps[moves, axis, None].astype(float), values)
            gains.append(predict(np.arange(bed + 1.0)[:, None])[:, 0])
        return AxisModel(printer, (gains[0], gains[1]))


# Rows by place, `printmend_lab.published.neighbours:KNN`: they do worse than no model on healthy printers and on few
# points, which a registered learner must not.
KNN, LINEAR = JointLearner("knn", nearest), JointLearner("linear", line)
LEARNERS = {learner.name: learner for learner in (AxisLearner("knn-axis", nearest), AxisLearner("linear-axis", line))}
