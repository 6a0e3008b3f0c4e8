"""What every peer learns from: each motor's commanded path, what was measured along it, and validation in blocks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from printmend.errors import TraceError
from printmend.path import Trace, frozen, last_way
from printmend.printer import Printer

FOLDS = 5  # blocks of consecutive rows: rows beside each other are too alike to check one another
_FEWEST_ROWS = 4  # of one motor, below which it is taken as designed
_EXACT_MM2 = 1e-16  # square errors below this are rounding
_LEAST_GAIN = 0.02  # of the logarithm of the square error: less is not worth a richer model

Option = TypeVar("Option")
Fit = Callable[["MotorRows", Option], np.ndarray]
"""Learn from rows with an option; return the predicted error [N] mm at every row, but for a constant a layer."""


@dataclass(frozen=True, eq=False)
class MotorRows:
    """One motor: ``motor_mm`` [N] commanded, ``error_mm`` [N] measured less commanded (NaN where unmeasured).

    ``layer`` [N] numbers the prints from 0: each has an origin of its own, and the path is not joined between them.
    ``engaged`` is the way in which the motor homed just before row 0, 0 where its play rests in the middle; ``turn_mm``
    is the travel of one turn of a healthy pulley.
    """

    motor_mm: np.ndarray
    error_mm: np.ndarray
    layer: np.ndarray
    engaged: int = 0
    turn_mm: float = 40.0

    def __post_init__(self) -> None:
        for name in ("motor_mm", "error_mm", "layer"):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name))))

    @property
    def known(self) -> np.ndarray:
        """A mask [N] of the measured rows."""
        return np.isfinite(self.error_mm)

    @property
    def is_sparse(self) -> bool:
        """Say whether the motor is to be taken as designed: hardly measured, or at rest."""
        known = self.known
        return int(known.sum()) < _FEWEST_ROWS or float(np.ptp(self.motor_mm[known])) == 0.0

    def only(self, mask: np.ndarray) -> "MotorRows":
        """Return the same path with only the rows of a mask [N] measured."""
        return replace(self, error_mm=np.where(mask, self.error_mm, np.nan))

    def paths(self) -> list[slice]:
        """Return the rows of each layer, in order."""
        starts = np.flatnonzero(np.diff(self.layer, prepend=-1))
        return [slice(a, b) for a, b in zip(starts, [*starts[1:], len(self.layer)], strict=True)]

    def centred(self, columns: np.ndarray) -> np.ndarray:
        """Return the measured rows [n, F] of columns [N, F] less each layer's mean over them."""
        known, out = self.known, np.array(columns, float)
        for path in self.paths():
            mine = known[path]
            if mine.any():
                out[path] -= out[path][mine].mean(axis=0)
        return out[known]


def motor_rows(trace: Trace, printer: Printer) -> tuple[MotorRows, MotorRows]:
    """Return the rows of both planar motors. Raise `TraceError` where nothing that moved was measured."""
    commanded, measured = printer.to_motor(trace.commanded_mm), printer.to_motor(trace.measured_mm)
    layer = np.zeros(len(trace), np.int64) if trace.layer is None else trace.layer
    layer = np.cumsum(np.diff(layer, prepend=layer[:1]) != 0)
    if not np.isfinite(commanded).all():
        raise TraceError("trace", wanted="a commanded position in every row", came="an empty one", todo="fill it in")
    engaged = [printer.motor_home_direction(k) if trace.homed else 0 for k in range(2)]
    turns = [printer.axes[k].mm_per_turn for k in range(2)]
    a, b = (MotorRows(commanded[:, k], measured[:, k] - commanded[:, k], layer, engaged[k], turns[k]) for k in range(2))
    if a.is_sparse and b.is_sparse:
        raise TraceError(
            "trace", wanted=f"{_FEWEST_ROWS} measured rows of a motor that moved", todo="measure more way-points",
            came=f"{int(a.known.sum())} and {int(b.known.sum())}",
        )  # fmt: skip
    return a, b


def ways(rows: MotorRows) -> tuple[np.ndarray, np.ndarray]:
    """Return the way of each row's last motion [N] (±1, 0) and how far the motor went since it last turned [N] mm."""
    way, since = np.zeros(len(rows.layer)), np.zeros(len(rows.layer))
    for path in rows.paths():
        motor = rows.motor_mm[path]
        way[path] = last_way(motor)
        gone = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(motor)))])
        turned = np.diff(way[path], prepend=way[path][:1]) != 0
        at = np.maximum.accumulate(np.where(turned, np.arange(len(motor)) - 1, 0))
        since[path] = gone - gone[np.maximum(at, 0)]
    return way, since


def least_squares(rows: MotorRows, columns: np.ndarray, ridge: np.ndarray | float = 0.0) -> np.ndarray:
    """Return the weights [F] of columns [N, F] that explain the error best, each layer with a constant of its own.

    ``ridge`` is the penalty of each weight's square, in the units of the squared error.
    """
    design, error = rows.centred(columns), rows.centred(rows.error_mm)
    penalty = np.sqrt(np.broadcast_to(np.asarray(ridge, float), (design.shape[1],)))
    if penalty.any():
        design, error = np.vstack([design, np.diag(penalty)]), np.concatenate([error, np.zeros(len(penalty))])
    return np.linalg.lstsq(design, error, rcond=1e-12)[0]


def chosen(rows: MotorRows, options: Sequence[Option], fit: Fit) -> Option:
    """Return the option with the least error in held-out blocks; ``options`` go from simple to rich.

    A richer one must be better, in the logarithm, by more than the standard error of the difference over the blocks
    (Hastie, Tibshirani and Friedman 2009, 7.10: the one-standard-error rule), so that noise alone buys nothing.
    """
    best, least = options[0], block_errors_mm2(rows, fit, options[0])
    for option in options[1:]:
        errors = block_errors_mm2(rows, fit, option)
        gain = np.log(least + _EXACT_MM2) - np.log(errors + _EXACT_MM2)
        if gain.mean() > max(float(gain.std(ddof=1)) / np.sqrt(len(gain)), _LEAST_GAIN):
            best, least = option, errors
    return best


def block_errors_mm2(rows: MotorRows, fit: Fit, option: Option) -> np.ndarray:
    """Return the mean square errors [B] mm² of predicting each block of consecutive rows from the others."""
    known = np.flatnonzero(rows.known)
    blocks = np.array_split(known, min(FOLDS, len(known)))
    return np.array([_held_out_mm2(rows, fit, option, block) for block in blocks])


def _held_out_mm2(rows: MotorRows, fit: Fit, option: Option, block: np.ndarray) -> float:
    held = np.zeros(len(rows.layer), bool)
    held[block] = True
    rest = rows.only(~held)
    left = rows.error_mm - (np.zeros(len(held)) if rest.is_sparse else fit(rest, option))
    squares = 0.0
    for path in rows.paths():
        mine, others = held[path], rest.known[path]
        if mine.any():
            origin = left[path][others if others.any() else mine].mean()
            squares += float(((left[path][mine] - origin) ** 2).sum())
    return squares / len(block)
