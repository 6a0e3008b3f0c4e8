"""One number of backlash an axis: Marlin's M425, and what two drafts would bring to Klipper.

Marlin (https://marlinfw.org/docs/gcode/M425.html), RepRapFirmware (M425) and the drafts #7157 and #7259 of Klipper add
a constant distance to each move that turns back. The model behind them is an ordinary play of that width, behind a
scale (M92). Marlin can spread the correction over some millimetres after a turn (`S`, smoothing): that moves when it is
added, not how much, and on the lattice of full steps there is nothing to smooth.
"""

from dataclasses import dataclass

import numpy as np

from printmend.learn.mechanism_model import MechanismModel
from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.peers.branches import Drive, branch_model
from printmend_lab.peers.operators import lags
from printmend_lab.peers.rows import MotorRows, chosen

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


LEARNERS = {"backlash": Backlash()}
