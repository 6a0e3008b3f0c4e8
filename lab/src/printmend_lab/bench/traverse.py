"""Measured traverses: a carriage driven at constant speed over its bed and back, from files or motion capture.

The data are the authors' motion capture of a belt printer with printed non-circular pulleys. Each traverse is the
error of the carriage's position over the nominal travel since the traverse's first sample, detrended.
"""

import csv
import hashlib
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from printmend.errors import TraceError, reason
from printmend.path import frozen
from printmend_lab.dataset.bodies import digest

# Signals of a MATLAB file.

TODO = "fetch it again, or leave it out"


def signals(path: Path, names: Sequence[str] | None = None) -> list[np.ndarray]:
    """Return signals of numbers [N] by their names; without names the only one there is. NaN may be among them.

    Raise `TraceError` for a file that does not hold them.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        found = {name: value for name, value in loadmat(path, variable_names=names).items() if name[:2] != "__"}
    except (OSError, ValueError, NotImplementedError, TypeError, MatReadError) as error:
        raise TraceError(path, wanted="a MATLAB file before version 7.3", came=reason(error), todo=TODO) from None
    if names is None and len(found) != 1:
        raise TraceError(path, wanted="one signal", came=f"{len(found)}", todo=TODO)
    if missing := [name for name in names or () if name not in found]:
        raise TraceError(path, wanted=f"a variable {missing[0]}", came="none of that name", todo=TODO)
    every = [np.asarray(found[name]).reshape(-1) for name in names or found]
    if any(signal.dtype.kind not in "fiu" for signal in every):
        raise TraceError(path, wanted="numbers", came="something else", todo=TODO)
    return every


COLUMNS = ("pulley_shape", "nominal_speed_mm_s", "segment", "direction", "nominal_travel_mm", "position_error_mm")


@dataclass(frozen=True, eq=False)
class Traverse:
    """One traverse: ``travel_mm`` [N] from 0, ``error_mm`` [N]; ``direction`` is + or −1."""

    shape: str
    speed_mm_s: float
    segment: int
    direction: int
    travel_mm: np.ndarray
    error_mm: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "travel_mm", frozen(np.asarray(self.travel_mm, float)))
        object.__setattr__(self, "error_mm", frozen(np.asarray(self.error_mm, float)))

    @property
    def length_mm(self) -> float:
        return float(self.travel_mm[-1])


def read_traverses(path: str | Path) -> list[Traverse]:
    """Read every traverse of the CSV, in order. Raise `TraceError` for a missing column, a bad cell or no rows."""
    todo = "see the columns in printmend_lab.bench.traverse"
    rows: dict[tuple[str, float, int, int], list[tuple[float, float]]] = defaultdict(list)
    try:
        with open(path, newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            if missing := [name for name in COLUMNS if name not in (reader.fieldnames or ())]:
                raise TraceError(path, wanted=f"a column {missing[0]}", came="none of that name", todo=todo)
            for row in reader:
                try:
                    direction = {"+": 1, "-": -1}[row["direction"]]
                    key = (row["pulley_shape"], float(row["nominal_speed_mm_s"]), int(row["segment"]), direction)
                    rows[key].append((float(row["nominal_travel_mm"]), float(row["position_error_mm"])))
                except (KeyError, ValueError, TypeError) as error:
                    raise TraceError(
                        f"{path} line {reader.line_num}", wanted="numbers, and + or -", came=str(error), todo=todo
                    ) from None
    except (OSError, ValueError, csv.Error) as error:
        raise TraceError(path, wanted="a CSV of traverses", came=reason(error), todo="check the file") from None
    if not rows:
        raise TraceError(path, wanted="traverses", came="no rows", todo=todo)
    return [_traverse(path, key, np.array(points)) for key, points in rows.items()]


def _traverse(path: str | Path, key: tuple[str, float, int, int], points: np.ndarray) -> Traverse:
    shape, speed, segment, direction = key
    if len(points) < 8 or not np.isfinite(points).all() or (np.diff(points[:, 0]) <= 0).any():
        raise TraceError(
            f"{path} {shape} {speed:g} segment {segment}", wanted="8 samples or more, finite, travel increasing",
            came="others", todo="remove the segment",
        )  # fmt: skip
    return Traverse(shape, speed, segment, direction, points[:, 0], points[:, 1])


def middles_mm(traverses: Sequence[Traverse]) -> np.ndarray:
    """Return the travel [mm] from each traverse's first sample to the middle of the bed: the commanded geometry alone.

    Constant speed begins where the acceleration ends, after a way that grows with the speed, and ends as long before
    the turn: both ends of a full traverse are cut alike. One that was broken off (below 95 % of the longest, in either
    direction) starts where the nearest full one of its direction before it did, else the one after.
    """
    least = 0.95 * max(traverse.length_mm for traverse in traverses)
    middles = []
    for at, item in enumerate(traverses):
        full = [n for n, t in enumerate(traverses) if t.direction == item.direction and t.length_mm >= least]
        like = max((n for n in full if n <= at), default=min(full, default=at))
        middles.append(traverses[like].length_mm / 2)
    return np.array(middles)


def detrended(travel_mm: np.ndarray, error_mm: np.ndarray) -> np.ndarray:
    """Remove the least-squares line, as was done to the data: a prediction is compared after the same."""
    columns = np.stack([np.ones_like(travel_mm), travel_mm], axis=1)
    return error_mm - columns @ np.linalg.lstsq(columns, error_mm, rcond=None)[0]


# Cut traverses out of the authors' published motion capture, RenzoCab/Non-Circular-Pulleys.
#
# A file holds the carriage's speed in mm a frame, NaN where the camera lost the marker. Frames are integrated, cut
# where the carriage stands or turns, and freed of the ends, where it speeds up. What is left of a straight line over
# time is the error: at constant speed, time is the nominal travel. A file of a run has eighteen traverses: nine at the
# slowest speed, then nine at the speed in its name; the rapid ways between are left out.

_NAME = re.compile(r"SmoothPlot_([a-z]+)_allspeeds(?:/|__)dudt_[a-z]+_(\d+)\.mat$")
_WINDOW = 75  # frames over which the speed is smoothed to tell motion from standing
_MOVING = 0.2  # of the median speed of all moving frames, above which the carriage moves
_STANDING_MM, _RAPID_MM = 0.02, 0.12  # a frame: slower is standing; no traverse is faster than the latter
_FEWEST_FRAMES = 600
_END_MM = 10.0  # of a traverse that are left out at either end
_EVERY_MM = 0.5


def read_runs(path: Path) -> list[Traverse]:
    """Return the traverses of a folder of captures, or of a CSV of traverses."""
    return read_captures(path) if Path(path).is_dir() else read_traverses(path)


def runs_digest(path: Path) -> str:
    """Return a SHA-256 of what `read_runs` would read."""
    files = captures(path) if Path(path).is_dir() else [Path(path)]
    return digest(files[0]) if len(files) == 1 else hashlib.sha256("".join(map(digest, files)).encode()).hexdigest()


def captures(folder: Path) -> list[Path]:
    """Return the files of a clone of the authors' repository, or of a folder with them, that are runs over the bed."""
    return sorted(path for path in Path(folder).rglob("*dudt_*.mat") if _NAME.search(path.as_posix()))


def read_captures(folder: Path) -> list[Traverse]:
    """Return all traverses of all runs in ``folder``. Raise `TraceError` where there are none."""
    files = captures(folder)
    if not files:
        raise TraceError(
            folder, wanted="files SmoothPlot_SHAPE_allspeeds/dudt_SHAPE_SPEED.mat", came="none",
            todo="clone RenzoCab/Non-Circular-Pulleys there",
        )  # fmt: skip
    return list(_cut_all(tuple((path, path.stat().st_mtime_ns) for path in files)))


@lru_cache(maxsize=2)
def _cut_all(files: tuple[tuple[Path, int], ...]) -> tuple[Traverse, ...]:
    """Return the traverses of files, each with when it was changed; kept, because every case asks for them."""
    found: list[Traverse] = []
    for path, _ in files:
        name = _NAME.search(path.as_posix())
        assert name is not None
        found += cut(_speeds(path), name[1], float(name[2]))
    return tuple(found)


def cut(speed_mm: np.ndarray, shape: str, speed_mm_s: float) -> list[Traverse]:
    """Cut the carriage's speed [N], mm a frame, into traverses."""
    frame, known = np.arange(len(speed_mm)), np.isfinite(speed_mm)
    speed = np.interp(frame, frame[known], speed_mm[known])
    place = np.concatenate([[0.0], np.cumsum(speed)])
    smooth = np.zeros(len(speed))
    half = _WINDOW // 2
    smooth[half : len(speed) - half] = (place[_WINDOW:] - place[:-_WINDOW]) / _WINDOW
    moving = np.abs(smooth) > _STANDING_MM
    usual = float(np.median(np.abs(smooth[moving]))) if moving.any() else np.inf
    way = np.sign(smooth) * (np.abs(smooth) > _MOVING * usual)
    ends = np.flatnonzero(np.diff(way, prepend=0, append=0))
    found: list[Traverse] = []
    for start, end in pairwise(ends):
        if not way[start] or end - start < _FEWEST_FRAMES:
            continue
        direction = int(way[start])
        travelled = direction * (place[start : end + 1] - place[start])
        if travelled[-1] < 4 * _END_MM or travelled[-1] / (end - start) > _RAPID_MM:
            continue
        inside = np.flatnonzero((travelled >= _END_MM) & (travelled <= travelled[-1] - _END_MM))
        inner = travelled[inside[0] : inside[-1] + 1]
        nominal = np.arange(len(inner)) * (inner[-1] - inner[0]) / (len(inner) - 1)
        travel = np.arange(0.0, nominal[-1], _EVERY_MM)
        error = np.interp(travel, nominal, inner - inner[0] - nominal)
        found.append(Traverse(shape, speed_mm_s, len(found), direction, travel, detrended(travel, error)))
    return found


def _speeds(path: Path) -> np.ndarray:
    """Return the only signal of a file [N]."""
    (speeds,) = signals(path)
    if np.isfinite(speeds).sum() < _FEWEST_FRAMES:
        raise TraceError(path, wanted=f"{_FEWEST_FRAMES} speeds a frame", came="fewer", todo="fetch it again")
    return speeds
