"""trace.csv: commanded way-points and where they were measured, as a table that any program can write.

The header has at least ``x_mm,y_mm,x_measured_mm,y_measured_mm``. The text is UTF-8, or UTF-16 with its mark. Cells end
with commas, or with semicolons or tabs as a spreadsheet of another language has them. Each row is a commanded
way-point, in the order of motion since homing; the first is the home position. Moves between rows are straight.
Measured cells are empty where nothing was measured. These columns are optional: ``z_mm``, ``z_measured_mm``, ``layer``,
and ``sigma_mm``. Others have the same value in every row. ``placed`` is 0 if the measured positions have their own
origin, as in a scan. ``scale_sd``, ``axes_sd``, ``lean_sd``, ``wave_mm``, ``carriage_mm``, ``lens_mm``,
``resized_sd`` and ``paper_sd`` are the instrument's uncertainty (see `Instrument`); ``scale_axes``, ``scale_lean`` and
``axes_lean`` are the correlations of the first three, ``turn_x_rad`` and ``turn_y_rad`` how it lay. ``motion_mm2`` and
``motion_sd_mm2`` give the error of a moving head (see `Motion`); ``printer``, ``kinematics`` and ``probe`` name the
print (see `Origin`). A wall shows one direction only: its row has empty measured cells, the direction out of the
plastic in ``nx``, ``ny``, and the offset along it in ``offset_mm``. Other columns are ignored.
"""

import codecs
import csv
import io
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from printmend.errors import TraceError, reason
from printmend.files import replacing
from printmend.measure.checks import AXES_TODO, LEAST_MEASURED, check_origin, is_at_home, wrong_axes
from printmend.messages import say
from printmend.path import DOUBTS, Instrument, Motion, Origin, Trace
from printmend.printer import Printer, printer_of
from printmend.units import MM_PER_INCH

REQUIRED = ("x_mm", "y_mm", "x_measured_mm", "y_measured_mm")
OPTIONAL = ("sigma_mm", "z_mm", "layer", "z_measured_mm")
PLACED = "placed"
WALL = ("nx", "ny", "offset_mm")
MOTION = ("motion_mm2", "motion_sd_mm2")  # from lines printed at speed: `Motion`
TOGETHER = ("scale_axes", "scale_lean", "axes_lean")  # correlations of the first three, after a length was settled
ORIGIN = ("printer", "kinematics", "probe")
SIGNED = (*TOGETHER, "turn_x_rad", "turn_y_rad")  # each from −1 to 1, left out where all are 0
SHARED = (PLACED, *DOUBTS, *SIGNED, *MOTION)  # one number for all rows
KNOWN = (*REQUIRED, *OPTIONAL, *WALL, *SHARED)
_ROUNDED = -1e-5  # rounding to six digits may make an eigenvalue of the correlations this small
_MOST_DOUBT = 0.5  # an instrument less sure of a length than this measures nothing
OUTSIDE_MM = 10.0  # purge lines lie a few millimetres beyond some beds
_LARGEST_MM = 1e9  # larger values are clipped to this: they are wrong all the same, and their squares stay finite
# Typical distance between an axis's commanded and measured places, both sorted, as a share of their spread: no pulley
# error reaches this, but a wrong unit does.
_SAME_PLACES_SHARE = 0.35
_MOST_MOTION_MM2 = 1.0  # a head that strays by a millimetre prints nothing
# Steps of a last digit: what finer ones hide is below the noise of any instrument.
STEPS_MM = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01)
_EXACT_MM = 1e-9  # by which a decimal number may miss its binary one
_MOST_LAYERS = 1_000_000  # largest number of a layer
_FILLED_SHARE, _HOME_APART_MM = 0.5, 0.5  # least share of the bed that a test print spans; how far home may lie outside
_FARTHEST_WALL_MM = 50.0  # largest distance of a wall from its commanded place
HEADER_TODO = say("start-with-header", ",".join(REQUIRED))

# Stands for an empty cell while the table is parsed; no printer goes there, and a literal nan stays visible.
_EMPTY = -9.25e303
_EMPTY_TEXT = b"-9.25e303"  # stands for an empty cell while numbers are read; no measurement is that large
_BLANK_ROW = re.compile(rb"^[ \t]*(?:,[ \t]*)+$", re.MULTILINE)
_CELL_ENDS = (b";", b"\t")  # instead of commas; numbers may have a decimal comma then
_BLANK_LINE = re.compile(rb"\n[ \t]*(?=\n)")


def read_trace(path: str | Path, printer: Printer | str | Path) -> Trace:
    """Read a trace.csv; ``printer``, or the one that it names, gives the bed that the points must lie on.

    Raises `TraceError` for a missing or text cell, NaN, infinity, a wrong unit, too few points, most points far outside
    the bed and a table that names another printer.
    """
    path, printer = Path(path), printer_of(printer)
    names, columns, origin, blank_rows = _table(path)
    check_origin(path, origin, printer)
    commanded = np.stack([columns["x_mm"], columns["y_mm"]], axis=1)
    measured = np.stack([columns["x_measured_mm"], columns["y_measured_mm"]], axis=1)
    _check_values(path, columns)
    both = np.isfinite(measured).all(axis=1)
    normal, offset = _walls(path, names, columns)
    heights = np.isfinite(columns["z_measured_mm"]) if "z_measured_mm" in columns else both
    if max(both.sum(), heights.sum()) < LEAST_MEASURED and offset is None:
        raise TraceError(
            path,
            wanted=say("least-measured-points", LEAST_MEASURED),
            came=say("rows", int(both.sum()), len(commanded)),
            todo=say("measure-more-print-printmend-probe-makes"),
        )
    home = np.array(printer.home_mm)
    _check_unit(path, commanded, measured, home)
    _check_inches(path, commanded, printer)
    _check_bed(path, commanded, measured, printer)
    layer = columns.get("layer")
    return Trace(
        commanded_mm=commanded,
        measured_mm=measured,
        sigma_mm=columns.get("sigma_mm"),
        z_mm=columns.get("z_mm"),
        z_measured_mm=columns.get("z_measured_mm"),
        layer=None if layer is None else np.where(np.isnan(layer), -1, layer).astype(np.int64),
        homed=is_at_home(commanded[0], printer),
        placed=PLACED not in columns or bool(columns[PLACED][0] != 0),
        instrument=_instrument(path, columns),
        normal=normal,
        offset_mm=offset,
        origin=origin,
        blank_rows=blank_rows,
        motion=_motion(path, columns),
        step_mm=_step_mm(measured[both]),
    )


def _walls(path: Path, names: list[str], columns: dict[str, np.ndarray]) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return the walls' directions [N, 2], normalised, and their offsets [N]; None if no row has any."""
    if not any(name in names for name in WALL):
        return None, None
    if missing := [name for name in WALL if name not in names]:
        raise TraceError(path, wanted=say("nx-ny-offset-mm-walls"), came=say("no", missing[0]), todo=say("add-column"))
    nx, ny, offset = (columns[name] for name in WALL)
    whole = np.isfinite(nx) & np.isfinite(ny) & np.isfinite(offset)
    length = np.hypot(nx, ny)
    if (
        wrong := np.flatnonzero(whole & ~((length > 0.5) & (length < 2.0) & (np.abs(offset) < _FARTHEST_WALL_MM)))
    ).size:
        raise TraceError(
            path, wanted=say("nx-ny-length-1-offset-mm"),
            came=say("row-after-header", *(f"{each[wrong[0]]:g}" for each in (nx, ny, offset)), wrong[0] + 1),
            todo=say("correct-row-leave-cells-empty"),
        )  # fmt: skip
    if whole.sum() == 0:
        return None, None
    normal = np.where(whole[:, None], np.stack([nx, ny], axis=1) / np.where(whole, length, 1.0)[:, None], np.nan)
    return normal, np.where(whole, offset, np.nan)


def _instrument(path: Path, columns: dict[str, np.ndarray]) -> Instrument | None:
    """Return the instrument that the first row describes, None where no column does."""
    found = {name: float(columns[name][0]) for name in DOUBTS if name in columns}
    for name, value in found.items():
        if not 0 <= value <= _MOST_DOUBT:
            raise TraceError(
                path, wanted=say("from-0", name, _MOST_DOUBT), came=f"{value:g}", todo=say("leave-column-out")
            )
    signed = {name: float(columns[name][0]) for name in SIGNED if name in columns}
    for name, value in signed.items():
        if not -1 <= value <= 1:
            raise TraceError(path, wanted=say("from-1-1", name), came=f"{value:g}", todo=say("leave-column-out"))
    instrument = Instrument(**found, **signed)
    if np.linalg.eigvalsh(replace(instrument, scale_sd=1.0, axes_sd=1.0, lean_sd=1.0).covariance)[0] < _ROUNDED:
        raise TraceError(
            path, wanted=say("possible-together", ", ".join(TOGETHER)),
            came=", ".join(f"{getattr(instrument, name):g}" for name in TOGETHER), todo=say("leave-these-columns-out"),
        )  # fmt: skip
    return instrument if found else None


def _step_mm(places_mm: np.ndarray) -> float:
    """Return the largest step of which all measured places [N, 2] are multiples, 0 where `STEPS_MM` has none."""
    for step in STEPS_MM if len(places_mm) else ():
        if np.abs(places_mm - step * np.round(places_mm / step)).max() < _EXACT_MM:
            return step
    return 0.0


def _motion(path: Path, columns: dict[str, np.ndarray]) -> Motion | None:
    """Return how far a moving head strays by the first row, or None without these columns."""
    if not all(name in columns for name in MOTION):
        return None
    square, sd = (float(columns[name][0]) for name in MOTION)
    if abs(square) > _MOST_MOTION_MM2 or not 0 < sd <= _MOST_MOTION_MM2:
        raise TraceError(
            path, wanted=say("from-0", MOTION[1], _MOST_MOTION_MM2), came=f"{square:g}, {sd:g}",
            todo=say("leave-column-out"),
        )  # fmt: skip
    return Motion(square, sd)


def write_trace(path: str | Path, trace: Trace) -> None:
    """Write ``trace`` so that `read_trace` gives it back to the nanometre; NaN becomes an empty cell."""
    names, columns = list(REQUIRED), [*trace.commanded_mm.T, *trace.measured_mm.T]
    for name in OPTIONAL:
        if (values := getattr(trace, name)) is not None:
            names.append(name)
            columns.append(values)
    if trace.normal is not None and trace.offset_mm is not None:
        names += WALL
        columns += [*trace.normal.T, trace.offset_mm]
    if not trace.placed:
        names.append(PLACED)
        columns.append(np.zeros(len(trace)))
    if trace.instrument is not None:
        said = [*DOUBTS, *(SIGNED if any(getattr(trace.instrument, name) for name in SIGNED) else ())]
        names += said
        columns += [np.full(len(trace), getattr(trace.instrument, name)) for name in said]
    if trace.motion is not None:
        names += MOTION
        columns += [np.full(len(trace), value) for value in (trace.motion.square_mm2, trace.motion.sd_mm2)]
    formats = {"layer": "%d", PLACED: "%d", **dict.fromkeys(MOTION, "%.9f")}
    row = ",".join(formats.get(name, "%.6f") for name in names) + "\n"
    end = "\n"
    if trace.origin is not None:  # the same in every row
        names += ORIGIN
        end = "".join(f",{_quoted(text)}" for text in vars(trace.origin).values()) + end
    with replacing(Path(path)) as file:
        file.write(",".join(names) + "\n")
        for first in range(0, len(trace), 100_000):
            block = zip(*(column[first : first + 100_000].tolist() for column in columns), strict=True)
            file.write("".join([row % cells for cells in block]).replace("nan", "").replace("\n", end))


def _quoted(text: str) -> str:
    """Return a cell that holds text."""
    text = " ".join(text.split()).replace('"', '""')
    return f'"{text}"' if "," in text or '"' in text else text


def _table(path: Path) -> tuple[list[str], dict[str, np.ndarray], Origin | None, int]:
    """Return the header's names, the known columns [N] (NaN where a cell is empty), the print's origin, and the number
    of blank rows between others."""
    try:
        data = path.read_bytes()
    except (OSError, ValueError) as error:
        raise TraceError(path, wanted=say("trace-csv"), came=reason(error), todo=say("check-path")) from None
    try:
        text = data.decode("utf-16" if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise TraceError(path, wanted=say("utf-8-table"), came=say("other-bytes"), todo=say("save-csv-utf-8"))
    data = text.replace("\r\n", "\n").replace("\r", "\n").encode()
    first, _, rest = data.partition(b"\n")
    if b"," not in first and (mark := next((each for each in _CELL_ENDS if each in first), None)) is not None:
        first, rest = (each.replace(b",", b".").replace(mark, b",") for each in (first, rest))
    rest = _BLANK_ROW.sub(b"", rest)  # rows of commas, as spreadsheets append; empty lines keep line numbers
    names = [name.strip().strip('"').lower() for name in first.decode().split(",")]
    _check_header(path, names, first.decode())
    line = next((line for line in io.BytesIO(rest) if line.strip()), b"").decode().strip()
    cells = next(csv.reader([line]), []) if len(line) < csv.field_size_limit() else []
    _check_quotes(path, rest)
    _check_width(path, rest, len(names), len(cells))
    wanted = [name for name in KNOWN if name in names]
    places = [names.index(name) for name in wanted]
    values = _parse_fast(rest, places)
    if values is None:
        values = _parse_slowly(path, rest.decode(), names, places)
    if len(values) == 0:
        raise TraceError(
            path,
            wanted=say("least-measured-points", LEAST_MEASURED),
            came=say("no-rows"),
            todo=say("add-measured-points"),
        )
    blank_rows = len(_BLANK_LINE.findall(rest.strip()))
    return names, {name: values[:, i] for i, name in enumerate(wanted)}, _origin(names, cells), blank_rows


def _origin(names: list[str], cells: list[str]) -> Origin | None:
    """Return the print's origin by the first row, or None if it names none."""
    if ORIGIN[0] not in names:
        return None
    said = dict(zip(names, cells, strict=False))
    origin = Origin(*(said.get(name, "").strip() for name in ORIGIN))
    return origin if origin.printer else None


def _check_header(path: Path, names: list[str], line: str) -> None:
    missing = [name for name in REQUIRED if name not in names]
    if missing:
        came = say("header", repr(line[:80])) if line.strip() else say("empty-first-line")
        raise TraceError(path, wanted=say("column", missing[0]), came=came, todo=HEADER_TODO)
    known = [name for name in names if name in KNOWN]
    if twice := sorted({name for name in known if known.count(name) > 1}):
        raise TraceError(path, wanted=say("one-column", twice[0]), came=say("two"), todo=say("remove-one-them"))


def _check_quotes(path: Path, text: bytes) -> None:
    """Raise `TraceError` for a quote that is not closed in its line: its cell would swallow the rows below."""
    for number, line in enumerate(text.split(b"\n") if b'"' in text else (), start=2):
        is_odd = line.count(b'"') % 2 and len(line) < csv.field_size_limit()
        if is_odd and len(list(csv.reader([line.decode(), ""]))) == 1:
            raise TraceError(
                path, wanted=say("row-line"), came=say("quote-line-not-closed-there", number),
                todo=say("close-take-away"),
            )  # fmt: skip


def _check_width(path: Path, text: bytes, width: int, first: int) -> None:
    """Raise `TraceError` for a row with more cells than the header's ``width``, as decimal commas make.

    Extra cells may be empty, say if each line ends with a comma, as long as all rows have as many as the ``first``.
    """
    for number, line in enumerate(text.split(b"\n"), start=2):
        if (first <= width and line.count(b",") < width) or len(line) >= csv.field_size_limit():
            continue
        cells = [cell.strip() for cell in next(csv.reader([line.decode()]), [])]
        is_wide = len(cells) > width or first > width
        if any(cells) and is_wide and (len(cells) != first or any(cells[width:])):
            raise TraceError(
                path, wanted=say("cells-row-header-has", width), came=say("cells-line", len(cells), number),
                todo=say("write-numbers-decimal-point-text-has"),
            )  # fmt: skip


def _parse_fast(text: bytes, places: list[int]) -> np.ndarray | None:
    """Return the columns at ``places`` [N, len(places)] by numpy's parser, or None when a cell is odd."""
    text = b"\n" + text.rstrip() + b"\n"
    for _ in range(2):  # twice, because neighbouring empty cells share a comma
        text = text.replace(b",,", b"," + _EMPTY_TEXT + b",")
    text = text.replace(b",\n", b"," + _EMPTY_TEXT + b"\n").replace(b"\n,", b"\n" + _EMPTY_TEXT + b",")
    if not text.strip():
        return np.empty((0, len(places)))
    try:
        values = np.loadtxt(
            io.BytesIO(text),
            delimiter=",",
            usecols=places,
            comments=None,
            quotechar='"',
            ndmin=2,
            encoding="utf-8",
        )
    except ValueError:
        return None
    if not np.isfinite(values).all():
        return None
    values[values == _EMPTY] = np.nan
    return values


def _parse_slowly(path: Path, text: str, names: list[str], places: list[int]) -> np.ndarray:
    """Parse cell by cell, so that the first odd cell can be named."""
    rows = []
    if max(map(len, text.split("\n"))) > csv.field_size_limit():
        raise TraceError(path, wanted=say("row-line"), came=say("endless-line"), todo=HEADER_TODO)
    reader = csv.reader(io.StringIO(text))
    for cells in reader:
        if not any(cell.strip() for cell in cells):
            continue
        line = reader.line_num + 1
        if len(cells) <= max(places):
            raise TraceError(
                path,
                wanted=say("cells-line", len(names), line),
                came=f"{len(cells)}",
                todo=say("leave-cell-empty-where-nothing-measured"),
            )
        rows.append([_number(path, cells[place].strip(), names[place], line) for place in places])
    return np.array(rows, float).reshape(-1, len(places))


def _number(path: Path, cell: str, name: str, line: int) -> float:
    if not cell:
        return math.nan
    try:
        value = float(cell.replace(",", "."))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TraceError(
            path,
            wanted=say("number-line", name, line),
            came=repr(cell[:40]),
            todo=say("correct-leave-column-out" if name in SHARED else "leave-measured-cells-empty-where-nothing"),
        )
    return value


def _check_values(path: Path, columns: dict[str, np.ndarray]) -> None:
    for name, values in columns.items():
        if name in SHARED and (other := np.flatnonzero(values != values[0])).size:
            row, value = other[0] + 1, values[other[0]]
            came = say("value-row-after-header", f"{value:g}", row)
            if np.isnan(value):
                came = say("empty-cell-row-after-header", row)
            wanted = say("every-row", name if np.isnan(values[0]) else f"{name} {values[0]:g}")
            raise TraceError(path, wanted=wanted, came=came, todo=say("correct-leave-column-out"))
    for name in ("x_mm", "y_mm"):
        if (empty := np.flatnonzero(np.isnan(columns[name]))).size:
            raise TraceError(
                path,
                wanted=say("every-row", name),
                came=say("empty-cell-row-after-header", empty[0] + 1),
                todo=say("write-every-commanded-way-point-only"),
            )
    if "layer" in columns and (np.abs(columns["layer"]) > _MOST_LAYERS).any():
        raise TraceError(path, wanted=say("layers-up", _MOST_LAYERS), came=say("number-beyond"), todo=say("correct"))
    if "sigma_mm" in columns and (columns["sigma_mm"] < 0).any():
        raise TraceError(path, wanted=say("sigma-mm-0"), came=say("negative-one"), todo=say("correct-leave-empty"))


def _check_unit(path: Path, commanded: np.ndarray, measured: np.ndarray, home: np.ndarray) -> None:
    """Refuse inches, centimetres and swapped columns, by the slope of measured on commanded.

    Damaged pulleys have gains of 0.6–1.3, and slopes over a short stretch vary more. Only a slope beyond these, over
    a stretch much longer than the play, shows a wrong unit.
    """
    rows = np.isfinite(measured).all(axis=1)
    if not rows.any():  # walls alone
        return
    x, y = (
        np.clip(values[rows] - np.median(values[rows], axis=0), -_LARGEST_MM, _LARGEST_MM)
        for values in (commanded, measured)
    )
    spread = np.sqrt((x**2).mean())
    slope = _slope(x.ravel(), y.ravel())
    if (wrong := wrong_axes(commanded, measured)) is not None:
        raise TraceError(path, wanted=say("positions-along-printer-s-own-x"), came=wrong, todo=AXES_TODO)
    wide = np.median(np.abs(y)) / max(float(np.median(np.abs(x))), 1e-9)  # shuffled rows have no slope, but their width
    for factor, unit in ((MM_PER_INCH, say("inches")), (10.0, say("centimetres"))):
        for column, ratio in (("measured", slope * factor), ("commanded", slope / factor)):
            # a commanded table in inches spans only a few units, so its spread has no lower limit
            if 0.63 < ratio < 1.58 and wide < 3 * abs(slope) and (spread > 4.0 or column == "commanded"):
                raise TraceError(
                    path,
                    wanted=say("millimetres"),
                    came=say(f"{column}-look-like-factor", unit, f"{factor:g}"),
                    todo=say(f"multiply-{column}-columns", f"{factor:g}"),
                )
    # `learn.order` sorts or reports the same places in another order: it knows the printer's path
    apart = np.median(np.abs(np.sort(x, axis=0) - np.sort(y, axis=0)), axis=0) / np.maximum(x.std(axis=0), 1e-9)
    for axis, given, found in zip("xy", x.T, y.T, strict=True):
        if (
            apart.max() > _SAME_PLACES_SHARE
            and np.sqrt((given**2).mean()) > 15.0
            and not 0.3 < (slope := _slope(given, found)) < 3.0
        ):
            raise TraceError(
                path,
                wanted=say("measured-positions-follow-commanded-ones"),
                came=say("slope-between-them", f"{slope:.3g}", axis),
                todo=say("check-unit-order-rows-whether-x"),
            )
    for factor, unit in ((MM_PER_INCH, say("inches")), (10.0, say("centimetres"))):
        if np.abs(home).max() > 20 and np.allclose(commanded[0] * factor, home, atol=0.02 * factor):
            raise TraceError(
                path,
                wanted=say("millimetres"),
                came=say("home-position-factor", unit, f"{factor:g}"),
                todo=say("multiply-all-columns", f"{factor:g}"),
            )


def _check_inches(path: Path, commanded: np.ndarray, printer: Printer) -> None:
    """Raise `TraceError` for a table wholly in inches: it fills a corner of the bed, 1/25.4 of its size."""
    low, high = np.array([(axis.min_mm, axis.max_mm) for axis in printer.axes[:2]]).T
    inside = (commanded >= low / MM_PER_INCH - _HOME_APART_MM) & (commanded <= high / MM_PER_INCH + _HOME_APART_MM)
    span = np.ptp(commanded, axis=0)
    if inside.all() and (span > _FILLED_SHARE * (high - low) / MM_PER_INCH).all():
        raise TraceError(
            path, wanted=say("millimetres"), came=say("all-places-like-inches", f"{span.max():.1f}"),
            todo=say("multiply-all-columns", f"{MM_PER_INCH:g}"),
        )  # fmt: skip


def _slope(x: np.ndarray, y: np.ndarray) -> float:
    """Return the weighted median of y/x, weights |x|: the least-absolute slope, which one wild point cannot turn."""
    x, y = x[x != 0], y[x != 0]
    if not len(x):
        return 1.0
    order = np.argsort(y / x)
    weights = np.cumsum(np.abs(x)[order])
    return float((y / x)[order[np.searchsorted(weights, weights[-1] / 2)]])


def _check_bed(path: Path, commanded: np.ndarray, measured: np.ndarray, printer: Printer) -> None:
    low = np.array([printer.x.min_mm, printer.y.min_mm])
    high = np.array([printer.x.max_mm, printer.y.max_mm])
    low, high = np.minimum(low, printer.home_mm) - OUTSIDE_MM, np.maximum(high, printer.home_mm) + OUTSIDE_MM
    # a scan has an origin of its own, so measured points may lie up to a bed's length away
    reach = high - low
    with np.errstate(invalid="ignore"):
        outside = ((commanded < low) | (commanded > high)).any(axis=1)
        lost = ((measured < low - reach) | (measured > high + reach)).any(axis=1)
    lost &= lost.sum() > len(lost) / 2  # a few are wrong cells, which learning leaves out
    for mask, points, what in ((outside, commanded, "commanded"), (lost, measured, "measured")):
        if mask.any():
            row = int(np.argmax(mask))
            raise TraceError(
                path,
                wanted=say("points-bed", what, printer.name),
                came=say("row-after-header-2", f"{points[row, 0]:g}", f"{points[row, 1]:g}", row + 1),
                todo=say("check-unit-printer"),
            )
