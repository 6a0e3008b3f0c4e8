"""Check a trace before learning from it: the right printer, the right axes, enough points, no copied rows.

Rank correlations find swapped, mirrored and turned tables, because outliers hardly change ranks. Two different preset
names mean two printers, and so do two names that owners gave. A preset's name and an owner's name may mean one printer
if the kinematics agree: the owner may have named it after the measurement.
"""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from printmend.errors import TraceError
from printmend.messages import say
from printmend.path import Origin, Trace
from printmend.printer import Printer, preset_names, read_printer
from printmend.printer.printer import bare_name


def check_origin(subject: str | Path, origin: Origin | None, printer: Printer) -> None:
    """Raise `TraceError` if a measurement comes from another printer; ``subject`` names the measurement."""
    if origin is None or bare_name(origin.printer) == bare_name(printer.name):
        return
    known = {bare_name(read_printer(name).name) for name in preset_names()}
    is_other = origin.kinematics not in ("", printer.kinematics)
    if not is_other and (bare_name(origin.printer) in known) != (bare_name(printer.name) in known):
        return
    raise TraceError(
        subject, wanted=say("measurement", printer.name), came=say("one", origin.printer),
        todo=say("take-printer-if-one-under-another"),
    )  # fmt: skip


SURE_RANK_CORRELATION = 0.8  # Spearman's, between a measured column and its commanded one
LEAST_MARGIN = 0.25  # by how much less the other column must correlate
AXES_TODO = say("swap-columns-back-let-each-axis")
LEAST_SPREAD_MM = 15.0  # smallest spread of an axis that shows its direction


def wrong_axes(commanded_mm: np.ndarray, measured_mm: np.ndarray) -> str | None:
    """Return what is wrong with the axes of measured places [N, 2] (NaN: not measured), or None if nothing surely is.

    Places along a single line show no error: both axes look alike there.
    """
    rows = np.flatnonzero(np.isfinite(measured_mm).all(axis=1))
    if len(rows) > MOST_COMPARED:
        rows = rows[np.linspace(0, len(rows) - 1, MOST_COMPARED).astype(np.int64)]
    commanded, measured = commanded_mm[rows], measured_mm[rows]
    if len(rows) < 10 or np.diff(np.quantile(commanded, (0.1, 0.9), axis=0), axis=0).min() < LEAST_SPREAD_MM:
        return None
    ranks = [np.argsort(np.argsort(values, axis=0), axis=0) for values in (commanded, measured)]
    together = np.atleast_2d(np.corrcoef(np.hstack(ranks).T))[:2, 2:]  # of commanded x, y with measured x, y
    own, across = np.diag(together), np.array([together[0, 1], together[1, 0]])
    if np.abs(across).min() > SURE_RANK_CORRELATION and np.abs(own).max() < np.abs(across).min() - LEAST_MARGIN:
        if (across > 0).all():
            return say("axes-swapped")
        if (across < 0).all():
            return say("axes-swapped-mirrored")
        return say("all-turned-left" if across[0] > 0 else "all-turned-right")
    if np.abs(own).min() < SURE_RANK_CORRELATION or np.abs(own).min() < np.abs(across).max() + LEAST_MARGIN:
        return None
    if (own < 0).all():
        return say("all-turned-half")
    return say("x-mirrored") if own[0] < 0 else say("y-mirrored") if own[1] < 0 else None


LEAST_MEASURED = 10  # measured points; fewer say nothing
AT_HOME_MM = 0.05  # a place nearer to the home position is that position
FARTHEST_MM = 1e5  # no bed reaches so far: such a cell is a mistake
MOST_COMPARED = 4000  # rows whose ranks are compared; more only take longer
LEAST_MOVE_MM = 20.0  # a shorter move of a motor proves nothing: play of up to 2 mm may hide it
# Measured millimetres for each commanded one: the worst pulleys known have 0.39 and 1.41 (physics.md eq. 5).
POSSIBLE_GAINS = (0.2, 5.0)
POSSIBLE_LEADS = (0.5, 2.0)  # the same of heights: a screw of half or twice the lead shows at a glance
_BEYOND_MM = 20.0  # a height that lies farther beyond the axis' ends is a mistake
_SAME_DIGITS = 6  # of millimetres: places that differ by less are the same
LEAST_RANK_CORRELATION = 0.5  # Spearman's, of commanded and measured positions


def check_trace(trace: Trace, printer: Printer) -> None:
    """Raise `TraceError` if a trace lacks a commanded position, if it has too few or impossible measured positions, or
    if these do not follow a motor."""
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
    if heights_alone(trace):
        raise TraceError(
            say("trace"), wanted=say("points-at-several-places"), came=say("heights-at-one-place"),
            todo=say("learn-flat-print-then-update-by-heights"),
        )  # fmt: skip
    if len(trace) < LEAST_MEASURED or count < LEAST_MEASURED:
        raise TraceError(
            say("trace"), wanted=say("least-measured-points", LEAST_MEASURED), came=say("rows", count, len(trace)),
            todo=say("measure-more-print-printmend-probe-makes"),
        )  # fmt: skip
    _check_follows(trace, printer)


def heights_alone(trace: Trace) -> bool:
    """Return whether heights were measured, but X and Y nowhere, or at one place from which the head never moved."""
    plane = (trace.measured_rows | trace.wall_rows).any() and np.ptp(trace.commanded_mm, axis=0).any()
    return trace.z_measured_mm is not None and not plane


def is_at_home(place_mm: np.ndarray, printer: Printer) -> bool:
    """Return whether a place [2] is a printer's home position."""
    return bool(np.abs(place_mm - np.array(printer.home_mm)).max() <= AT_HOME_MM)


def _check_follows(trace: Trace, printer: Printer) -> None:
    """Raise `TraceError` if the measured positions do not follow a motor: they belong to another print.

    The test uses ranks and quantiles, which outliers hardly change. A motor that hardly moved passes.
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
    """Fill each empty commanded height with the last known one; drop the heights if all are empty.

    Raises `TraceError` for heights that this printer cannot reach.
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
    """Return the rank of each place [N]. Equal places share their mean rank: most rows may lie on one line."""
    which, count = np.unique(np.round(places_mm, _SAME_DIGITS), return_inverse=True, return_counts=True)[1:]
    return np.asarray((np.cumsum(count) - count / 2)[which])


LEAST_COPIES = 10  # fewest rows that count as copies; fewer may be chance
LEAST_COPIES_SHARE = 0.45  # least share of the measured rows: in a table pasted twice nearly half are copies
RANDOM_SDS = 3.0  # rows are in random order if their mean step lies within this many standard deviations of chance
_DIGITS = 16  # hexadecimal digits of a digest
_FARTHEST_MM = 1e6  # a cell beyond this is a mistake, and counts as this


def counted_once(trace: Trace) -> tuple[Trace, int]:
    """Return the trace with the measurements of copied rows removed, and the number of copies.

    The commanded motion stays. A way back over the same places with the same measurements is no copy. Rows that repeat
    others in random order are copies: no print revisits its places in that way. The trace is unchanged if there are
    fewer copies than a second paste would make.
    """
    seen = np.isfinite(_measured(trace)).any(axis=1)
    columns = _everything(trace)
    # one number for each row: equal rows get equal numbers, and others differ but for one chance in 10¹²
    key = (columns * np.random.default_rng(0).standard_normal(columns.shape[1])).sum(axis=1)
    row = np.unique(key, return_inverse=True)[1]
    before, after = np.append(-1, row[:-1]), np.append(row[1:], -1)
    # a copy repeats a row and its neighbour on the same side; on a way back the neighbours change sides
    copies = np.flatnonzero(seen & (_again(row, before) | _again(row, after) | (row == before)))
    repeating = np.flatnonzero(seen & _again(row, np.zeros_like(row)))
    if len(repeating) >= LEAST_COPIES and in_no_order(trace.commanded_mm[repeating]):
        copies = repeating
    if len(copies) < max(LEAST_COPIES, LEAST_COPIES_SHARE * seen.sum()):
        return trace, 0
    left = {}
    for name in ("measured_mm", "z_measured_mm", "normal", "offset_mm"):
        if (values := getattr(trace, name)) is not None:
            left[name] = values.copy()
            left[name][copies] = np.nan
    return replace(trace, **left), len(copies)


def in_no_order(places_mm: np.ndarray) -> bool:
    """Return whether places [N, 2] come in a random order.

    A nozzle goes from neighbour to neighbour. In random order, successive rows are as far apart as any two rows (the
    mean of n steps scatters by 1/√n). Rows that go back and forth across the bed are farther apart.
    """
    shuffled = places_mm[np.random.default_rng(0).permutation(len(places_mm))]
    step_mm, any_mm = (float(np.hypot(*np.diff(each, axis=0).T).mean()) for each in (places_mm, shuffled))
    return abs(step_mm - any_mm) <= RANDOM_SDS / np.sqrt(len(places_mm)) * any_mm


def _again(row: np.ndarray, beside: np.ndarray) -> np.ndarray:
    """Mark the pairs of two numbers [N] that occurred earlier."""
    again = np.ones(len(row), bool)
    again[np.unique(row * (len(row) + 2) + beside, return_index=True)[1]] = False
    return again


def digest_of(trace: Trace) -> str:
    """Return a hexadecimal digest of the commanded and measured places, to the nanometre."""
    if trace.taken is not None:
        return trace.taken
    whole_nm = np.rint(_everything(trace) * 1e6).astype(np.int64)
    return hashlib.sha256(whole_nm.tobytes()).hexdigest()[:_DIGITS]


def _measured(trace: Trace) -> np.ndarray:
    """Return all that was measured [N, ≥ 2], NaN where nothing was."""
    return _side_by_side(trace.measured_mm, trace.z_measured_mm, trace.offset_mm)


def _everything(trace: Trace) -> np.ndarray:
    """Return commands and measurements [N, ≥ 4], with −`_FARTHEST_MM` for NaN."""
    columns = _side_by_side(trace.commanded_mm, trace.z_mm, trace.layer, trace.normal, _measured(trace))
    return np.nan_to_num(columns, nan=-_FARTHEST_MM).clip(-_FARTHEST_MM, _FARTHEST_MM)


def _side_by_side(*columns: np.ndarray | None) -> np.ndarray:
    return np.column_stack([values for values in columns if values is not None])
