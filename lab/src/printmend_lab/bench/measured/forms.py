"""Read each form of measured data, and split it."""

import csv
import json
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from printmend.errors import InputError, TraceError, reason
from printmend.files import read_text
from printmend_lab.bench.matlab import signals
from printmend_lab.bench.measured.specimens import COLUMNS, measured_specimen
from printmend_lab.bench.measured.tracks import MeasuredSet, Track
from printmend_lab.bench.real.mocap import read_runs
from printmend_lab.bench.real.traverse import middles_mm

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
