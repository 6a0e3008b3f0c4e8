"""`printmend bench measured`: every learner on data that nobody here simulated.

A figure is the root mean square of what a learner did not foresee of the judged tracks, as a share of what the
straight line from input to output leaves (`naive`): 1 is no use, 0 is perfect.
"""

import csv
import hashlib
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from printmend.errors import InputError, TraceError, reason
from printmend.files import read_text
from printmend.learn.registry import ORACLE, check_model_name, fit
from printmend.path import Trace, frozen
from printmend.printer import Printer, read_printer
from printmend.protocols import WorldModel
from printmend.units import MM_PER_INCH
from printmend_lab.bench.case import Case, Result, run
from printmend_lab.bench.report import grouped
from printmend_lab.bench.traverse import middles_mm, read_runs, signals
from printmend_lab.executor import HERE, Executor

# A measured set as tracks: what was commanded, what was measured; some to learn from, the others to be judged.

Free = Literal["mean", "line", "start"]


@dataclass(frozen=True, eq=False)
class Track:
    """One run: ``commanded`` [N] and ``measured`` [N] (NaN where nothing was), in the set's own units, in the order of
    time. The input came from ``run_up`` before its first sample, at which nothing was measured."""

    commanded: np.ndarray
    measured: np.ndarray
    run_up: float = 0.0

    def __post_init__(self) -> None:
        for name in ("commanded", "measured"):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), float)))

    def part(self, start: float, end: float) -> "Track":
        """Return the samples between two shares of the track."""
        a, b = round(start * len(self.commanded)), round(end * len(self.commanded))
        return Track(self.commanded[a:b], self.measured[a:b], self.run_up)


@dataclass(frozen=True, eq=False)
class MeasuredSet:
    """What is learned from and what is judged.

    ``free`` is what of a judged track is not predicted: its mean, its straight line, or nothing but its start.
    Input and output are lengths or angles of one unit, of which ``mm_per_unit`` make a millimetre of a printer's axis;
    None where they are different things, which are stretched to it. Tracks of a ``joined`` set follow each other on one
    machine; otherwise each begins at rest.
    """

    name: str
    learned: tuple[Track, ...]
    judged: tuple[Track, ...]
    free: Free = "mean"
    mm_per_unit: float | None = None
    joined: bool = True


def span(tracks: Sequence[Track]) -> tuple[float, float]:
    """Return the least and the largest input of tracks."""
    values = np.concatenate([[*track.commanded, track.commanded[0] + track.run_up] for track in tracks])
    return float(values.min()), float(values.max())


def less_free(track: Track, values: np.ndarray, free: Free) -> np.ndarray:
    """Take off values [N] along a track what is not predicted."""
    if free == "start":
        return values
    commanded = track.commanded
    columns = np.ones((len(values), 1)) if free == "mean" else np.stack([np.ones_like(commanded), commanded], axis=1)
    known = np.isfinite(values)
    return np.asarray(values - columns @ np.linalg.lstsq(columns[known], values[known], rcond=None)[0])


# Flatbed scans of printed tensile specimens, measured: length, width of the ends, width of the neck.
#
# Baumann, Eichhoff and Roller (University of Stuttgart) scanned dog-bones after EN ISO 527-2 in yellow and purple
# plastic on white paper. A folder has the scans and a `nominal.csv` of file,dpi,length_mm,width_mm,neck_mm, one line a
# scan. Plastic is what has a colour. A specimen lies in any direction: its own axes are those of its pixels' moments.

COLUMNS = ("file", "dpi", "length_mm", "width_mm", "neck_mm")
_COLOURED = 0.25  # of a pixel's value, by which its channels differ at least where there is plastic
_END_SHARE, _NECK_SHARE = 0.06, 0.2  # of the length: how much of either end, and of the middle, is looked at
_FEWEST_PIXELS = 2000
_EDGE_SHARE = 0.002  # of the pixels that may stand out at either side: hairs and dust


def measured_specimen(path: Path, dpi: float) -> dict[str, float]:
    """Return length, width of the ends and width of the neck [mm] of the largest piece of plastic in a scan.

    Raises `TraceError` for a file that is no picture, or has no plastic in it.
    """
    from PIL import Image, UnidentifiedImageError
    from scipy.ndimage import label

    try:
        with Image.open(path) as image:
            pixels = np.asarray(image.convert("RGB"), float)
    except (OSError, ValueError, UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise TraceError(path, wanted="a scan as PNG", came=reason(error), todo="fetch it again") from None
    brightest = pixels.max(axis=2)
    pieces, count = label(brightest - pixels.min(axis=2) > _COLOURED * np.maximum(brightest, 1.0))
    sizes = np.bincount(pieces.ravel())[1:]
    if not count or sizes.max() < _FEWEST_PIXELS:
        raise TraceError(path, wanted="a coloured specimen on white paper", came="none", todo="leave this scan out")
    rows, columns = np.nonzero(pieces == 1 + int(np.argmax(sizes)))
    places = np.stack([columns, rows], axis=1) * (MM_PER_INCH / dpi)
    along = _turned(places)
    pixel_mm = MM_PER_INCH / dpi
    length = _extent(along[:, 0], pixel_mm)
    far = np.abs(along[:, 0]) / length  # 0 in the middle, ½ at either end
    ends = [
        along[(along[:, 0] * side > 0) & (far > 0.5 - 2 * _END_SHARE) & (far < 0.5 - _END_SHARE)] for side in (-1, 1)
    ]
    neck = along[far < _NECK_SHARE / 2]
    return {
        "length_mm": length,
        "width_mm": float(np.mean([_extent(end[:, 1], pixel_mm) for end in ends])),
        "neck_mm": _extent(neck[:, 1], pixel_mm),
    }


def _turned(places_mm: np.ndarray) -> np.ndarray:
    """Return places [N, 2] along and across the axis of their largest moment, from the middle of their extent."""
    about = places_mm - places_mm.mean(axis=0)
    _, axes = np.linalg.eigh(about.T @ about)
    turned = about @ axes[:, ::-1]
    return np.asarray(
        turned - (np.quantile(turned, _EDGE_SHARE, axis=0) + np.quantile(turned, 1 - _EDGE_SHARE, axis=0)) / 2
    )


def _extent(values_mm: np.ndarray, pixel_mm: float) -> float:
    """Return how far values [N] reach: rows of pixels that are full enough, so that a hair is none."""
    cells = np.floor((values_mm - values_mm.min()) / pixel_mm).astype(int)
    full = np.flatnonzero(np.bincount(cells) > 0.3 * np.median(np.bincount(cells)))
    return float((full[-1] - full[0] + 1) * pixel_mm)


# Read each form of measured data, and split it.

_RUN_UP_MM = 10.0  # a carriage had sped up over this way before a traverse's first sample, or more
_BEHIND_MM = 2.0  # traverses came without their own line: any distance keeps the way back behind the way out
_COUNTS, _CENTIDEGREES = 16384, 36000  # of an encoder's turn, as counts and as its table has them
_TURN_MM = 40.0  # of a printer's axis, to which an encoder's turn is laid
_EVERY_COUNT, _EVERY_SAMPLE = 64, 8
_FEWEST, _FEWEST_SPECIMENS = 8, 4  # samples of a track; scans of a folder
_SETTLED_ROWS = 3  # of one target, after which a servo may stand
_DIMENSIONS = ("axis", "nominal_mm", "measured_mm")


def read_pulleys(path: Path) -> list[MeasuredSet]:
    """Return a set for each shape and speed of the traverses that `bench real` reads, places from the bed's middle."""
    items, sets = read_runs(path), []
    for key in dict.fromkeys((item.shape, item.speed_mm_s) for item in items):
        mine = [item for item in items if (item.shape, item.speed_mm_s) == key]
        tracks = []
        for item, middle in zip(mine, middles_mm(mine), strict=True):
            place = item.direction * (item.travel_mm - middle)
            error = item.direction * (item.error_mm - _BEHIND_MM / 2)
            tracks.append(Track(place, place + error, -item.direction * _RUN_UP_MM))
        first = [next((n for n, item in enumerate(mine) if item.direction == way), None) for way in (1, -1)]
        if None in first or len(mine) < 3:
            raise _wrong(path, "a traverse of either direction, and a later one", f"{len(mine)} of {key[0]} {key[1]:g}")
        later = [track for n, track in enumerate(tracks) if n not in first]
        learned = tuple(tracks[n] for n in first if n is not None)
        sets.append(MeasuredSet(f"{key[0]} {key[1]:g}", learned, tuple(later), "line", 1.0))
    return sets


def read_encoder(path: Path) -> list[MeasuredSet]:
    """Return the set of an encoder: the true angle at every count, in hundredths of a degree.

    ``path`` is a CSV index,value, or a folder that holds one, or the firmware's lookup_table.cpp.
    """
    if path.is_dir():
        files = sorted(path.rglob("lookup_table.cpp")) or sorted(path.glob("*_lookup.csv"))
        if not files:
            raise _wrong(path, "a lookup_table.cpp or *_lookup.csv", "neither")
        path = files[0]
    count, angle = _array(path) if path.suffix == ".cpp" else _counts(path)
    if len(count) != _COUNTS or not np.array_equal(count, np.arange(_COUNTS)):
        raise _wrong(path, f"counts 0 to {_COUNTS - 1}", f"{len(count)} rows")
    turned = np.unwrap(angle * (2 * np.pi / _CENTIDEGREES)) * (_COUNTS / (2 * np.pi))
    learned = Track(count[::_EVERY_COUNT], turned[::_EVERY_COUNT])
    half = slice(_EVERY_COUNT // 2, None, _EVERY_COUNT)
    return [
        MeasuredSet("stepper encoder", (learned,), (Track(count[half], turned[half]),), mm_per_unit=_TURN_MM / _COUNTS)
    ]


def _counts(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return counts and angles [N] of a CSV."""
    table = _columns(path, ("index", "value"))
    count, angle = (np.array([_number(path, row[name]) for row in table]) for name in ("index", "value"))
    return count, angle


def _array(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return counts and angles [N] of the longest array in a C++ source, comments left out."""
    text = re.sub(
        r"/\*.*?\*/|//[^\n]*", "", read_text(path, wanted="a C++ source", todo="fetch it again"), flags=re.DOTALL
    )
    longest = max(re.findall(r"\{([^{}]*)\}", text), key=len, default="")
    angle = np.array([_number(path, word) for word in longest.split(",") if word.strip()])
    return np.arange(len(angle)), angle


def read_servo(path: Path) -> list[MeasuredSet]:
    """Return a set for each motor that moved in a servo's log: `target pos (N)` and `pos (N)`, settled rows only."""
    table = _columns(path, ())
    motors = [name[len("target pos (") : -1] for name in table[0] if name.startswith("target pos (")]
    sets = []
    for motor in motors:
        answered = [row for row in table if row[f"pos ({motor})"]]  # before the first answer a position is empty
        target, pos = (
            np.array([_number(path, row[f"{name} ({motor})"]) for row in answered]) for name in ("target pos", "pos")
        )
        fresh = np.diff(target, prepend=np.nan) != 0  # a new target
        since = np.arange(len(target)) - np.maximum.accumulate(np.where(fresh, np.arange(len(target)), 0))
        stands = np.diff(pos, prepend=np.nan) == 0  # some targets change before the servo is there
        settled = np.append(fresh[1:], True) & (since >= _SETTLED_ROWS) & stands
        if not settled.any() or np.ptp(target[settled]) == 0:
            continue
        track = Track(target[settled], pos[settled])
        if len(track.commanded) < _FEWEST:
            raise _wrong(path, f"{_FEWEST} settled rows of motor {motor}", f"{len(track.commanded)}")
        sets.append(MeasuredSet(f"servo {motor}", (track.part(0, 0.5),), (track.part(0.5, 1),)))
    if not sets:
        raise _wrong(path, "a motor that moved", "none")
    return sets


def read_damper(path: Path) -> list[MeasuredSet]:
    """Return the set of a friction damper's test: JSON with data [N, 3 or more], time, displacement, friction force."""
    text = read_text(path, wanted="a damper's JSON", todo="fetch it again")
    try:
        data = np.array(json.loads(text)["data"], float)
    except (ValueError, KeyError, TypeError, RecursionError):
        raise _wrong(path, "JSON with a matrix named data", "something else") from None
    if data.ndim != 2 or data.shape[1] < 3 or len(data) < 4 * _FEWEST * _EVERY_SAMPLE or not np.isfinite(data).all():
        raise _wrong(path, f"{4 * _FEWEST * _EVERY_SAMPLE} rows of time, displacement, force", f"{data.shape}")
    track = Track(data[::_EVERY_SAMPLE, 1], data[::_EVERY_SAMPLE, 2])
    return [MeasuredSet("friction damper", (track.part(0, 0.5),), (track.part(0.5, 1),))]


def read_tanks(path: Path) -> list[MeasuredSet]:
    """Return the set of the cascaded tanks: a MATLAB file with uEst, yEst, uVal, yVal."""
    u_est, y_est, u_val, y_val = _matlab(path, ("uEst", "yEst", "uVal", "yVal"))
    return [MeasuredSet("cascaded tanks", (Track(u_est, y_est),), (Track(u_val, y_val),))]


def read_bouc_wen(folder: Path) -> list[MeasuredSet]:
    """Return the set of the hysteretic benchmark: a folder of uval_multisine.mat and its three fellows."""
    multisine, sinesweep = (
        Track(_signal(folder, f"uval_{name}"), _signal(folder, f"yval_{name}")) for name in ("multisine", "sinesweep")
    )
    judged = (multisine.part(0.5, 1), sinesweep)
    return [MeasuredSet("Bouc-Wen benchmark", (multisine.part(0, 0.5),), judged)]


def read_dimensions(path: Path) -> list[MeasuredSet]:
    """Return a set for each axis of a table of dimensions; each is a way from its lower end to its upper."""
    table, sets = _columns(path, _DIMENSIONS), []
    for axis in dict.fromkeys(row["axis"] for row in table):
        rows = [[_number(path, row[name]) for name in _DIMENSIONS[1:]] for row in table if row["axis"] == axis]
        tracks = [Track(np.array([0.0, nominal]), np.array([0.0, measured])) for nominal, measured in rows]
        if len(tracks) < _FEWEST or min(nominal for nominal, _ in rows) <= 0:
            raise _wrong(path, f"{_FEWEST} positive dimensions of axis {axis}", f"{len(tracks)} lines")
        sets.append(MeasuredSet(f"dimensions {axis}", tuple(tracks[::2]), tuple(tracks[1::2]), "start", 1.0, False))
    return sets


def read_specimens(folder: Path) -> list[MeasuredSet]:
    """Return the set of scanned specimens: every length is a way from one end of it to the other."""
    table = _columns(folder / "nominal.csv", COLUMNS)
    tracks = []
    for row in table:
        found = measured_specimen(folder / row["file"], _number(folder / "nominal.csv", row["dpi"]))
        wanted = {name: _number(folder / "nominal.csv", row[name]) for name in found}
        tracks.append([Track(np.array([0.0, wanted[name]]), np.array([0.0, found[name]])) for name in found])
    if len(tracks) < _FEWEST_SPECIMENS:
        raise _wrong(folder, f"{_FEWEST_SPECIMENS} specimens", f"{len(tracks)}")
    learned, judged = (tuple(track for one in tracks[start::2] for track in one) for start in (0, 1))
    return [MeasuredSet("specimens", learned, judged, "start", 1.0, False)]


def _columns(path: Path, names: Sequence[str]) -> list[dict[str, str]]:
    """Return the rows of a CSV with these columns."""
    text = read_text(path, wanted="a CSV", todo="fetch it again")
    try:
        rows = list(csv.DictReader(text.splitlines(), strict=True))
    except csv.Error as error:
        raise _wrong(path, "a CSV", reason(error)) from None
    if missing := [name for name in names if rows and name not in rows[0]]:
        raise _wrong(path, f"a column {missing[0]}", "none of that name")
    if not rows:
        raise _wrong(path, "rows", "none")
    return rows


def _number(path: Path, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise _wrong(path, "numbers", repr(text))
    return value


def _signal(folder: Path, name: str) -> np.ndarray:
    return _matlab(folder / f"{name}.mat", (name,))[0]


def _matlab(path: Path, names: Sequence[str]) -> list[np.ndarray]:
    """Return signals of a MATLAB file [N] without gaps."""
    found = signals(path, names)
    if any(len(signal) < _FEWEST or not np.isfinite(signal).all() for signal in found):
        raise _wrong(path, f"{_FEWEST} finite numbers or more a signal", "others")
    return found


def _wrong(path: Path, wanted: str, came: str) -> InputError:
    return TraceError(path, wanted=wanted, came=came, todo="fetch it again, or take this set out of --sets")


# Where measured sets come from: licence, the command that fetches them, the file, and the split.
#
# The splits were fixed before any learner was judged on them; `tests/test_bench_measured.py` keeps their digest. Files
# are looked for below the folder that is given to `printmend bench measured`.

_NONLINEAR = (
    "pip install nonlinear_benchmarks && python -c 'import nonlinear_benchmarks as n;"
    " print(n.{call}(data_file_locations=True))'"
)


@dataclass(frozen=True)
class Source:
    """A file of measured data, or a folder, at ``place`` below the given folder."""

    name: str
    place: str
    licence: str
    origin: str
    fetch: str
    split: str
    read: Callable[[Path], list[MeasuredSet]]


SOURCES = (
    Source(
        "pulleys", "noncircular_pulleys_mocap", "MIT",
        "RenzoCab/Non-Circular-Pulleys: motion capture of a belt printer with printed non-circular pulleys",
        "git clone https://github.com/RenzoCab/Non-Circular-Pulleys noncircular_pulleys_mocap",
        "each shape and speed: the first traverse of either direction is learned from, the later ones are judged",
        read_pulleys,
    ),
    Source(
        "encoder", "stepper_encoder_lut", "CC-BY-SA-4.0",
        "Kaiwol1990/Mechaduino: the calibration of one real stepper motor's magnetic encoder",
        "git clone https://github.com/Kaiwol1990/Mechaduino stepper_encoder_lut"
        " && git -C stepper_encoder_lut checkout 6907156ce7fb9cb83bddf756bd1a21a9b9e1e544",
        "every 64th count is learned from, the counts half-way between are judged",
        read_encoder,
    ),
    Source(
        "servo", "servo/motor_telemetry_nocomp2.csv", "CC-BY-4.0",
        "B. Kotov: backlash of Feetech STS3215 servos over UART",
        "git clone https://github.com/roboninecom/Measuring-Backlash-in-Popular-UART-Servos servo"
        " && cp servo/logs/*.csv servo/",
        "settled rows of each motor that moved: the first half in time is learned from, the second is judged",
        read_servo,
    ),
    Source(
        "damper", "friction_damper/0.5Hz20lbtension.json", "CC-BY-SA-4.0",
        "D. Coble et al.: a banded rotary friction damper with backlash, force over displacement",
        "git clone https://github.com/ARTS-Laboratory/Dataset-Friction-Damper-with-Backlash friction_damper"
        " && cp friction_damper/data/dataset-1/'characterization datasets'/*.json friction_damper/",
        "every 8th sample of the first half is learned from, of the second half is judged",
        read_damper,
    ),
    Source(
        "tanks", "cascaded_tanks/dataBenchmark.mat", "see nonlinearbenchmark.org",
        "M. Schoukens et al.: cascaded tanks with overflow, nonlinearbenchmark.org",
        _NONLINEAR.format(call="Cascaded_Tanks"),
        "the benchmark's own: uEst and yEst are learned from, uVal and yVal are judged",
        read_tanks,
    ),
    Source(
        "bouc-wen", "bouc_wen", "see nonlinearbenchmark.org",
        "J. P. Noel and M. Schoukens: hysteretic benchmark with a dynamic nonlinearity, nonlinearbenchmark.org",
        _NONLINEAR.format(call="not_splitted_benchmarks.BoucWen"),
        "the first half of the multisine is learned from, its second half and the sine sweep are judged",
        read_bouc_wen,
    ),
    Source(
        "dimensions", "dimensions.csv", "as your table says",
        "a table of a part's dimensions, such as NIST's additive manufacturing test artifact (Moylan et al. 2014) or"
        " J. L. Messimer et al., J. Manuf. Mater. Process. 3 (2019) 6",
        "write a CSV of axis,nominal_mm,measured_mm, one line a measurement, from the published table",
        "of each axis every other line is learned from, beginning with the first; the others are judged",
        read_dimensions,
    ),
    Source(
        "specimens", "specimens", "as the article's archive says",
        "F. W. Baumann, J. R. Eichhoff and D. Roller (University of Stuttgart): Scanned Image Data from 3D-Printed"
        " Specimens Using Fused Deposition Modeling, Data 2 (2017)",
        "get the archive that the article names, put its PNG scans into specimens/ beside a nominal.csv of"
        " file,dpi,length_mm,width_mm,neck_mm, one line a scan",
        "every other scan is learned from, beginning with the first; the others are judged",
        read_specimens,
    ),
)  # fmt: skip


def source(name: str) -> Source:
    """Return the source of that name."""
    return next(item for item in SOURCES if item.name == name)


# A measured set laid along the x axis of a printer, so that a learner of printers can learn it.

_PRESET = "ender5"  # with pulleys of 20 teeth: that one turns by another length, the learner has to find
_SPAN_MM = 160.0  # to which inputs of another kind are stretched
_MARGIN_MM = 20.0  # of the axis beyond either end
_FEWEST_CORRELATED = 0.3  # below this correlation the spreads, not a line, say how an output is stretched


@dataclass(frozen=True, eq=False)
class Bench:
    """A printer whose x axis is long enough, and the line from the set's units to it: mm = shift + scale·value."""

    printer: Printer
    input_scale: float
    input_shift_mm: float
    output_scale: float
    output_shift_mm: float
    joined: bool

    def laid(self, track: Track) -> Track:
        """Return a track in mm of the axis, the run-up too."""
        commanded = self.input_shift_mm + self.input_scale * track.commanded
        measured = self.output_shift_mm + self.output_scale * track.measured
        return Track(commanded, measured, self.input_scale * track.run_up)

    def trace(self, tracks: tuple[Track, ...]) -> Trace:
        """Return the trace of tracks in the set's units; y rests in the middle of its axis."""
        middle = (self.printer.y.min_mm + self.printer.y.max_mm) / 2
        parts = []
        for number, track in enumerate(map(self.laid, tracks)):
            x, u = track.commanded, track.measured
            if track.run_up:
                x, u = np.concatenate([[x[0] + track.run_up], x]), np.concatenate([[np.nan], u])
            parts.append(np.stack([x, u, np.full(len(x), number)], axis=1))
        x, u, number = np.concatenate(parts).T
        y = np.full(len(x), middle)
        measured = np.stack([u, np.where(np.isnan(u), np.nan, y)], axis=1)
        return Trace(np.stack([x, y], axis=1), measured, layer=None if self.joined else number.astype(int))

    def missed(self, model: WorldModel, tracks: tuple[Track, ...], free: str) -> np.ndarray:
        """Return what a model did not foresee [N] of tracks in the set's units, less what is free, in mm."""
        return np.concatenate([self._missed(model, self.laid(track), free) for track in tracks])

    def _missed(self, model: WorldModel, track: Track, free: str) -> np.ndarray:
        pitch = self.printer.mm_per_step[0]
        places = np.rint(
            (np.append(track.commanded[:1] + track.run_up, track.commanded) - self.printer.x.min_mm) / pitch
        )
        y = round(self.printer.bed_steps[1] / 2)
        state, errors = model.start(np.array([places[0], y], np.int64)), []
        for step in np.diff(places).astype(np.int64):
            if step:
                state = model.advance(state, np.array([[step, 0]]))
            errors.append(state.position_steps[0, 0] - state.nominal_steps[0, 0])
        imagined = track.commanded + np.array(errors) * pitch
        known = np.isfinite(track.measured)
        return less_free(track, track.measured - imagined, free)[known]  # type: ignore[arg-type]


def bench_of(item: MeasuredSet) -> Bench:
    """Lay a set along an axis. Only what is learned from says how an output of another kind is stretched."""
    low, high = span((*item.learned, *item.judged))
    scale = item.mm_per_unit or _SPAN_MM / (high - low)
    printer = read_printer(_PRESET)
    turn = printer.x.mm_per_turn
    turns = np.ceil(((high - low) * scale + 2 * _MARGIN_MM) / turn)
    printer = replace(printer, x=replace(printer.x, min_mm=0.0, max_mm=float(turns * turn)))
    shift = float(turns * turn) / 2 - (low + high) / 2 * scale
    commanded = shift + scale * np.concatenate([track.commanded for track in item.learned])
    measured = np.concatenate([track.measured for track in item.learned])
    known = np.isfinite(measured)
    commanded, measured = commanded[known], measured[known]
    if item.mm_per_unit is not None:
        level = shift if item.free == "start" else float((commanded - scale * measured).mean())
        return Bench(printer, scale, shift, scale, level, item.joined)
    spread = float(measured.std()) or 1.0
    correlation = float(((commanded - commanded.mean()) * (measured - measured.mean())).mean()) / (
        commanded.std() * spread
    )
    slope = correlation if abs(correlation) >= _FEWEST_CORRELATED else float(np.copysign(1.0, correlation))
    output = float(commanded.std()) / (spread * slope)
    return Bench(printer, scale, shift, output, float(commanded.mean() - output * measured.mean()), item.joined)


TABLE, NAIVE = "measured", "naive"
_PARTS, _OFF_ROUND = 1e6, 0.3717  # of a span, in a digest; away from round numbers, which fall on either side
ROWS = (
    NAIVE, "affine", "backlash", "bilateral", "prandtl-ishlinskii", "bouc-wen", "gaussian-process",
    "printmend_lab.peers.narx:NARX", "printmend_lab.peers.network:TCN", "printmend_lab.peers.network:ENSEMBLE",
    "linear-axis", "knn-axis", "lightgbm-axis", "forest-axis", "printmend", "greybox", "prior", "hybrid", "meta",
)  # fmt: skip


@dataclass(frozen=True)
class MeasuredRow:
    """A learner, by name."""

    name: str

    @property
    def lesson(self) -> str:
        return self.name


def read_row(name: str) -> MeasuredRow:
    """Return the row of that name. Raise `ConfigError` for a learner that does not exist, or that needs the truth."""
    if name == ORACLE:
        raise InputError("--models", wanted="learners", came=ORACLE, todo="leave it out: nobody knows the truth here")
    check_model_name(name)
    return MeasuredRow(name)


@dataclass(frozen=True, eq=False)
class MeasuredStand:
    """A set laid along an axis."""

    item: MeasuredSet
    bench: Bench

    def measure(self, row: MeasuredRow) -> Trace:
        return self.bench.trace(self.item.learned)

    def fit(self, measured: Trace, row: MeasuredRow) -> WorldModel:
        return fit(row.name, measured, self.bench.printer, rng=np.random.default_rng(0))

    def judge(self, model: WorldModel, row: MeasuredRow) -> dict[str, Any]:
        missed = self.bench.missed(model, self.item.judged, self.item.free)
        plain = self.bench.missed(fit(NAIVE, self.bench.trace(self.item.learned), self.bench.printer,
                                      rng=np.random.default_rng(0)), self.item.judged, self.item.free)  # fmt: skip
        rms = [float(np.sqrt((values**2).mean())) for values in (missed, plain)]
        learned = sum(int(np.isfinite(track.measured).sum()) for track in self.item.learned)
        units, line = (value / abs(self.bench.output_scale) for value in rms)
        share = {"missed": units, "line": line, "share": rms[0] / rms[1]}
        return {**share, "learned": learned, "judged": len(missed)}


def set_up(case: Case) -> MeasuredStand:
    """Read the case's set."""
    (item,) = (one for one in source(case.family).read(Path(case.source)) if one.name == case.body)
    return MeasuredStand(item, bench_of(item))


def measured_cases(folder: Path, names: Sequence[str] = ()) -> tuple[list[Case], list[Source]]:
    """Return a case for every set that lies below ``folder``, and the sources that do not.

    ``names`` chooses among the sources. Raise `InputError` for a name that does not exist.
    """
    known = [item.name for item in SOURCES]
    if wrong := [name for name in names if name not in known]:
        raise InputError("--sets", wanted=f"names out of {', '.join(known)}", came=repr(wrong[0]), todo="correct it")
    cases, absent = [], []
    for item in SOURCES:
        if names and item.name not in names:
            continue
        path = folder / item.place
        if not path.exists():
            absent.append(item)
            continue
        place = str(path.absolute())
        cases += [
            Case(TABLE, one.name, content_digest(one), item.name, "", item.split, 0, "", source=place)
            for one in item.read(path)
        ]
    return cases, absent


def content_digest(item: MeasuredSet) -> str:
    """Return a SHA-256 of what is learned from and judged, to a millionth of each signal's span: the same on every
    machine, and for every form that the data come in."""
    total = hashlib.sha256(f"{item.name} {item.free} {item.mm_per_unit} {item.joined}".encode())
    for track in (*item.learned, *item.judged):
        for values in (track.commanded, track.measured):
            low, high = np.nanmin(values), np.nanmax(values)
            parts = np.nan_to_num((values - low) / ((high - low) or 1.0), nan=-1.0)
            total.update(np.floor(parts * _PARTS + _OFF_ROUND).astype(np.int64).tobytes())
    return total.hexdigest()


def measured_table(
    cases: Sequence[Case],
    rows: Sequence[str],
    out: Path,
    *,
    executor: Executor = HERE,
    tick: Callable[[str], None] = lambda name: None,
) -> list[Result]:
    """Judge every row on every set; keep results in ``out``/measured.jsonl."""
    for row in rows:
        read_row(row)
    return run(cases, list(dict.fromkeys(rows)), out, executor, tick=tick)


def measured_lines(results: Sequence[Result]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the header and a line for each learner: its share on each set, their geometric mean, and seconds a set."""
    sets = list(dict.fromkeys(item.case.body for item in results))
    header = ("learner", *sets, "all", "seconds")
    lines = []
    for name, items in grouped(results, lambda item: item.row).items():
        shares = {item.case.body: item.value("share") for item in items}
        cells = ["–" if (share := shares.get(body)) is None else f"{share:.3f}" for body in sets]
        good = [share for share in shares.values() if share is not None]
        mean = f"{np.exp(np.mean(np.log(good))):.3f}" if len(good) == len(sets) else "–"
        seconds = [value for item in items if (value := item.value("learn_s")) is not None]
        lines.append((name.rpartition(":")[2], *cells, mean, f"{np.mean(seconds):.1f}" if seconds else "–"))
    return header, lines
