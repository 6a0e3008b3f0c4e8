"""Peers that correct without memory: skew and scale, one number of backlash, tables of a lead screw."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from printmend.learn.mechanism_model import MechanismModel
from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.peers.hysteresis import lags
from printmend_lab.peers.memory import Drive, branch_model, followed_drive
from printmend_lab.peers.rows import MotorRows, chosen, least_squares, ways

# Skew and scale: what Klipper and Marlin can be told of a crooked machine.
#
# The steps a millimetre of each axis (Marlin M92, Klipper rotation_distance) and one angle between x and y (Marlin
# M852, Klipper skew_correction: https://www.klipper3d.org/Skew_Correction.html), here by least squares over all points
# instead of three lengths with callipers.


def scale_drive(rows: MotorRows) -> Drive:
    """Return the drive of one scale error: u = (1 + e)·m."""
    error = float(least_squares(rows, rows.motor_mm[:, None])[0])
    error = max(error, -0.9)  # nothing drives backwards
    return lambda motor_mm: (error * motor_mm, error * motor_mm)


@dataclass(frozen=True)
class Affine:
    """Scale each axis and the angle between them; no play, nothing that repeats."""

    name: str = "affine"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> MechanismModel:
        """Learn from a trace. Raise `TraceError` where nothing that moved was measured."""
        return branch_model(trace, printer, scale_drive)


# One number of backlash an axis: Marlin's M425, and what two drafts would bring to Klipper.
#
# Marlin (https://marlinfw.org/docs/gcode/M425.html), RepRapFirmware (M425) and the drafts #7157 and #7259 of Klipper
# add a constant distance to each move that turns back. The model behind them is an ordinary play of that width, behind
# a scale (M92). Marlin can spread the correction over some millimetres after a turn (`S`, smoothing): that moves when
# it is added, not how much, and on the lattice of full steps there is nothing to smooth.

_RADII_MM = np.concatenate([[0.0], np.geomspace(0.01, 1.5, 64)])  # half-widths that are tried first, mm
_FINER = 33  # half-widths between the best one's neighbours that are tried then


def backlash_drive(rows: MotorRows) -> Drive:
    """Return the drive u = (1 + e)·play(m) of the likeliest width, without play where that predicts as well."""
    half_mm = likely_play_mm(rows) / 2
    gain, _ = best_width(rows, lags(rows, np.array([half_mm])))
    return lambda motor_mm: (gain * (motor_mm - half_mm) - motor_mm, gain * (motor_mm + half_mm) - motor_mm)


def likely_play_mm(rows: MotorRows) -> float:
    """Return the width of the play [mm] that explains the rows best, 0 where none predicts held-out blocks as well."""
    table = lags(rows, _RADII_MM)

    def fit(some: MotorRows, with_play: bool) -> np.ndarray:
        tried = table if with_play else table[:, :1]
        gain, at = best_width(some, tried)
        return np.asarray(gain * (rows.motor_mm + tried[:, at]) - rows.motor_mm)

    return best_play_mm(rows) if chosen(rows, (False, True), fit) else 0.0


def best_play_mm(rows: MotorRows) -> float:
    """Return the width of the play [mm] that explains the rows best behind a scale."""
    _, at = best_width(rows, lags(rows, _RADII_MM))
    radii = np.linspace(_RADII_MM[max(at - 1, 0)], _RADII_MM[min(at + 1, len(_RADII_MM) - 1)], _FINER)
    _, at = best_width(rows, lags(rows, radii))
    return float(2 * radii[at])


def best_width(rows: MotorRows, table_mm: np.ndarray) -> tuple[float, int]:
    """Return the gain and the number of the operator, of those whose lags [N, R] are given, that explains rows best."""
    motor = rows.centred(rows.motor_mm[:, None])[:, 0]
    place = motor + rows.centred(rows.error_mm)
    columns = motor[:, None] + rows.centred(table_mm)
    gain = np.maximum((columns * place[:, None]).sum(axis=0) / np.maximum((columns**2).sum(axis=0), 1e-12), 0.1)
    at = int(np.argmin(((place[:, None] - gain * columns) ** 2).sum(axis=0)))
    return float(gain[at]), at


@dataclass(frozen=True)
class Backlash:
    """Scale and skew, and one constant play a motor."""

    name: str = "backlash"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> MechanismModel:
        """Learn from a trace. Raise `TraceError` where nothing that moved was measured."""
        return branch_model(trace, printer, backlash_drive)


# Lead-screw tables: the error at equally spaced places, going forwards and going back, interpolated between them.
#
# LinuxCNC's COMP_FILE (http://linuxcnc.org/docs/html/config/ini-config.html: triplets of nominal, forward and reverse,
# at most 256 a joint), Mach's screw map, and Beckhoff's bidirectional leadscrew error compensation (TF5200, axis
# compensation). Measured with a gauge these tables are exact at their places; here they follow from least squares over
# all rows, so that any print will do. Positions are the bed's: no table knows that a pulley turns.

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
    return fitted_table(
        rows, chosen(rows, OPTIONS, lambda some, option: followed_drive(fitted_table(some, option), some))
    )


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


LEARNERS = {"affine": Affine(), "backlash": Backlash(), "bilateral": Bilateral()}
