"""A Gaussian process over where the motor is, where in its turn, and on which side of its play.

C. E. Rasmussen and C. K. I. Williams, Gaussian Processes for Machine Learning (2006), ch. 2, 4 and 5; periodic features
are those of D. MacKay 1998 (their eq. 4.31), the play operator as a further input is how hysteresis becomes a function
(X. Zhao and Y. Tan, Sensors and Actuators A 126 (2006) 306-311). scikit-learn fits it: one squared exponential kernel
with a length for each input, by marginal likelihood.

The model is the two branches that the process predicts with the play taken up either way. Whether it is told the side
at all, held-out blocks decide.
"""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from printmend.learn.mechanism_model import MechanismModel
from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.peers.classical import best_play_mm
from printmend_lab.peers.hysteresis import lags
from printmend_lab.peers.memory import Drive, branch_model
from printmend_lab.peers.rows import MotorRows, chosen, least_squares

_SEARCH_ROWS, _MOST_ROWS = 160, 800  # that it looks at to find its kernel, and in the end: its cost is their cube
_GRID_MM = 0.5  # between the places where it is asked
_LEAST_HALF_MM = 0.05  # half-width of the operator that tells the side
_LEAST_MM = 1e-6  # of spread, below which there is nothing to learn


def process_drive(rows: MotorRows) -> Drive:
    """Return the branches that a Gaussian process over the rows predicts, on top of a scale error."""
    scale = max(float(least_squares(rows, rows.motor_mm[:, None])[0]), -0.9)
    rows_left = MotorRows(rows.motor_mm, rows.error_mm - scale * rows.motor_mm, rows.layer, rows.engaged, rows.turn_mm)
    known = rows.motor_mm[rows.known]
    if float(rows_left.centred(rows_left.error_mm[:, None]).std()) < _LEAST_MM:
        return lambda motor_mm: (scale * motor_mm, scale * motor_mm)
    half = max(best_play_mm(rows) / 2, _LEAST_HALF_MM)
    side = -lags(rows, np.array([half]))[:, 0] / half  # 1: pushed forwards
    sides = {False: np.zeros(len(side)), True: side}
    kernels = {told: fitted_process(rows_left, sides[told]).kernel_ for told in sides}

    def fit(some: MotorRows, told: bool) -> np.ndarray:
        return predicted(fitted_process(some, sides[told], kernels[told]), rows.motor_mm, sides[told], rows.turn_mm)

    told = chosen(rows_left, (False, True), fit)
    process = fitted_process(rows_left, sides[told], kernels[told], most=_MOST_ROWS)
    places = np.arange(known.min() - rows.turn_mm, known.max() + rows.turn_mm, _GRID_MM)
    forwards, back = (
        predicted(process, places, np.full(len(places), way if told else 0.0), rows.turn_mm) for way in (1.0, -1.0)
    )

    def drive(motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        straight = scale * motor_mm
        return straight + np.interp(motor_mm, places, forwards), straight + np.interp(motor_mm, places, back)

    return drive


def fitted_process(rows: MotorRows, side: np.ndarray, kernel: Any = None, *, most: int = _SEARCH_ROWS) -> Any:
    """Fit a process to at most ``most`` rows, its kernel too unless one is given."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    known = np.flatnonzero(rows.known)
    seen = np.unique(np.linspace(0, len(known) - 1, most).astype(int))
    error = rows.centred(rows.error_mm[:, None])[seen, 0]
    optimizer = None if kernel is not None else "fmin_l_bfgs_b"
    if kernel is None:
        lengths = RBF([1.0, 1.0, 3.0, 3.0], (0.1, 100.0))
        kernel = ConstantKernel(1.0, (1e-3, 1e3)) * lengths + WhiteKernel(0.01, (1e-6, 1.0))
    process = GaussianProcessRegressor(kernel, optimizer=optimizer, normalize_y=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a length at its bound: an input that does not matter
        return process.fit(_inputs(rows.motor_mm[known[seen]], side[known[seen]], rows.turn_mm), error)


def predicted(process: Any, motor_mm: np.ndarray, side: np.ndarray, turn_mm: float) -> np.ndarray:
    """Return the mean that a process predicts [N] mm."""
    return np.asarray(process.predict(_inputs(motor_mm, side, turn_mm)))


def _inputs(motor_mm: np.ndarray, side: np.ndarray, turn_mm: float) -> np.ndarray:
    angle = 2 * np.pi * motor_mm / turn_mm
    return np.stack([np.cos(angle), np.sin(angle), motor_mm / turn_mm, side], axis=1)


@dataclass(frozen=True)
class ProcessLearner:
    """A Gaussian process for each motor, and the skew."""

    name: str = "gaussian-process"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> MechanismModel:
        """Learn from a trace. Raise `TraceError` where nothing that moved was measured."""
        return branch_model(trace, printer, process_drive)


LEARNERS = {"gaussian-process": ProcessLearner()}
