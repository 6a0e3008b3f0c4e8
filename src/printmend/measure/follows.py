"""Check that a trace can teach: enough measured places, all possible, and following the motors' commands."""

from dataclasses import replace

import numpy as np

from printmend.errors import TraceError
from printmend.messages import say
from printmend.path import Trace
from printmend.printer import Printer

LEAST_MEASURED = 10  # measured points; fewer say nothing
FARTHEST_MM = 1e5  # no bed reaches so far: such a cell is a mistake
MOST_COMPARED = 4000  # rows of which ranks are compared; more take time and say the same
LEAST_MOVE_MM = 20.0  # a motor that moved less proves nothing: play may hide the move (2 mm at worst)
# Measured millimetres for each commanded one: the worst pulleys known have 0.39 and 1.41 (physics.md eq. 5).
POSSIBLE_GAINS = (0.2, 5.0)
_BEYOND_MM = 20.0  # a height that lies farther beyond the axis' ends is a mistake
_SAME_DIGITS = 6  # of millimetres: places that differ by less are the same
LEAST_RANK_CORRELATION = 0.5  # Spearman's, of commanded and measured positions


def check_trace(trace: Trace) -> None:
    """Raise `TraceError` where a trace lacks a commanded position or has too few, or impossible, measured ones."""
    if not np.isfinite(trace.commanded_mm).all():
        raise TraceError(
            say("trace"), wanted=say("every-commanded-way-point"), came=say("nan"),
            todo=say("only-measured-cells-may-empty"),
        )  # fmt: skip
    known = np.isfinite(trace.measured_mm)
    if (far := np.abs(trace.measured_mm, where=known, out=np.zeros(known.shape)).max(initial=0.0)) > FARTHEST_MM:
        raise TraceError(
            say("trace"), wanted=say("positions-bed-mm"), came=f"{far:g}", todo=say("leave-wrong-cells-empty")
        )
    count = max(int(trace.measured_rows.sum()), int(trace.wall_rows.sum()))
    if len(trace) < LEAST_MEASURED or count < LEAST_MEASURED:
        raise TraceError(
            say("trace"), wanted=say("least-measured-points", LEAST_MEASURED), came=say("rows", count, len(trace)),
            todo=say("measure-more-print-printmend-probe-makes"),
        )  # fmt: skip


def check_follows(trace: Trace, printer: Printer) -> None:
    """Raise `TraceError` where the measured positions do not follow a motor, so that they are of another print.

    The test is on ranks and quantiles, which single wrong points hardly change. A motor that hardly moved passes.
    """
    measured = np.flatnonzero(trace.measured_rows & ~trace.wall_rows)
    if len(measured) > MOST_COMPARED:
        measured = measured[np.linspace(0, len(measured) - 1, MOST_COMPARED).astype(np.int64)]
    motors, belts = (printer.to_motor(each[measured]) for each in (trace.commanded_mm, trace.measured_mm))
    for name, motor, belt in zip(printer.motors, motors.T, belts.T, strict=True):
        moved, followed = (float(np.ptp(np.quantile(each, (0.1, 0.9)))) if len(each) else 0.0 for each in (motor, belt))
        if moved < LEAST_MOVE_MM:
            continue
        together = float(np.corrcoef(_ranks(motor), _ranks(belt))[0, 1]) if followed else 0.0
        least, most = POSSIBLE_GAINS
        if together < LEAST_RANK_CORRELATION or not least < followed / moved < most:
            came = say("moves-per-commanded", f"{followed / moved:.2f}", f"{together:.2f}")
            raise TraceError(
                say("trace"), wanted=say("measured-positions-follow-commands-along", name.upper()), came=came,
                todo=say("check-each-row-own-point-millimetres"),
            )  # fmt: skip


def with_heights(trace: Trace, printer: Printer) -> Trace:
    """Return a trace whose empty commanded heights are the last before; without any it has none.

    Raises `TraceError` for heights that are none of this printer.
    """
    if trace.z_mm is None or not np.isfinite(trace.z_mm).any():
        return replace(trace, z_mm=None)
    low, high = printer.z.min_mm - _BEYOND_MM, printer.z.max_mm + _BEYOND_MM
    for name, values in (("z_mm", trace.z_mm), ("z_measured_mm", trace.z_measured_mm)):
        if values is not None and (off := (values < low) | (values > high)).any():
            raise TraceError(
                say("trace"), wanted=say("column-from-to-mm", name, f"{low:g}", f"{high:g}"),
                came=f"{values[off][0]:g}", todo=say("check-unit-printer"),
            )  # fmt: skip
    known = np.isfinite(trace.z_mm)
    last = np.maximum.accumulate(np.where(known, np.arange(len(known)), -1))
    return replace(trace, z_mm=np.where(last >= 0, trace.z_mm[np.maximum(last, 0)], printer.z.home_mm))


def _ranks(places_mm: np.ndarray) -> np.ndarray:
    """Return the rank of each place [N], of equal ones their mean: most rows of a table may lie on one line."""
    which, count = np.unique(np.round(places_mm, _SAME_DIGITS), return_inverse=True, return_counts=True)[1:]
    return np.asarray((np.cumsum(count) - count / 2)[which])
