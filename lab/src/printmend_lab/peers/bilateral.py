"""Lead-screw tables: the error at equally spaced places, going forwards and going back, interpolated between them.

LinuxCNC's COMP_FILE (http://linuxcnc.org/docs/html/config/ini-config.html: triplets of nominal, forward and reverse, at
most 256 a joint), Mach's screw map, and Beckhoff's bidirectional leadscrew error compensation (TF5200, axis
compensation). Measured with a gauge these tables are exact at their places; here they follow from least squares over
all rows, so that any print will do. Positions are the bed's: no table knows that a pulley turns.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from printmend.learn.mechanism_model import MechanismModel
from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.peers.branches import Drive, branch_model, followed
from printmend_lab.peers.rows import MotorRows, chosen, least_squares, ways

MOST_PLACES = 256  # of a table, as LinuxCNC has them
_PITCHES_MM = (40.0, 20.0, 10.0, 5.0, 2.5, 1.25)
_AWAY_MM = (0.0, 1.0)  # rows this soon after a turn are left out: the play may not be taken up yet
_SMOOTHING = 1e-3  # rows that a difference between neighbouring places weighs: fills what was not measured
_CONSTANT = 1e-6  # of that, against a table's own level, which the layer's constant could take as well


class Table(NamedTuple):
    """What a table looks like: the distance of its places, how long after a turn rows count, and whether it has two
    sides."""

    pitch_mm: float
    away_mm: float
    two_sided: bool


OPTIONS = (
    None,
    *(Table(pitch, 0.0, False) for pitch in _PITCHES_MM),
    *(Table(pitch, away, True) for pitch in _PITCHES_MM for away in _AWAY_MM),
)


def bilateral_drive(rows: MotorRows) -> Drive:
    """Return the drive of the table that predicts held-out blocks best; without one, a scale error."""
    return fitted_table(rows, chosen(rows, OPTIONS, lambda some, option: followed(fitted_table(some, option), some)))


def fitted_table(rows: MotorRows, table: Table | None) -> Drive:
    """Fit a scale and a table to rows."""
    known = rows.known
    low, high = float(rows.motor_mm[known].min()), float(rows.motor_mm[known].max())
    if table is None:
        scale = max(float(least_squares(rows, rows.motor_mm[:, None])[0]), -0.9)
        return lambda motor_mm: (scale * motor_mm, scale * motor_mm)
    count = min(max(2, round((high - low) / table.pitch_mm) + 1), MOST_PLACES)
    places = np.linspace(low, high, count)
    way, since = ways(rows)
    kept = rows.only((since >= table.away_mm) & known) if table.two_sided else rows
    kept = rows if kept.is_sparse else kept
    hats = np.stack([np.interp(rows.motor_mm, places, unit) for unit in np.eye(count)], axis=1)
    sides = [np.where(way > 0, 1.0, -1.0)[:, None] * hats] if table.two_sided else []
    columns = np.concatenate([rows.motor_mm[:, None], hats, *sides], axis=1)
    weights = smooth_least_squares(kept, columns, count)
    scale, middle = weights[0], weights[1 : 1 + count]
    half = weights[1 + count :] if table.two_sided else np.zeros(count)

    def drive(motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        straight = scale * motor_mm
        return (
            straight + np.interp(motor_mm, places, middle + half),
            straight + np.interp(motor_mm, places, middle - half),
        )

    return drive


def smooth_least_squares(rows: MotorRows, columns: np.ndarray, count: int) -> np.ndarray:
    """Return the weights of a scale and of tables of ``count`` places, neighbours differing as little as they can."""
    design, error = rows.centred(columns), rows.centred(rows.error_mm)
    inner, width = design.T @ design, columns.shape[1]
    differences = np.diff(np.eye(count), axis=0)
    for first in range(1, width, count):
        mine = slice(first, first + count)
        inner[mine, mine] += _SMOOTHING * (differences.T @ differences + _CONSTANT * np.eye(count))
    return np.linalg.solve(inner, design.T @ error)


@dataclass(frozen=True)
class Bilateral:
    """A table with two sides for each motor, and the skew."""

    name: str = "bilateral"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> MechanismModel:
        """Learn from a trace. Raise `TraceError` where nothing that moved was measured."""
        return branch_model(trace, printer, bilateral_drive)


LEARNERS = {"bilateral": Bilateral()}
