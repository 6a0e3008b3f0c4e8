"""Cut traverses out of the authors' published motion capture, RenzoCab/Non-Circular-Pulleys.

A file holds the carriage's speed in mm a frame, NaN where the camera lost the marker. Frames are integrated, cut where
the carriage stands or turns, and freed of the ends, where it speeds up. What is left of a straight line over time is
the error: at constant speed, time is the nominal travel. A file of a run has eighteen traverses: nine at the slowest
speed, then nine at the speed in its name; the rapid ways between are left out.
"""

import hashlib
import re
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from printmend.errors import TraceError
from printmend_lab.bench.matlab import signals
from printmend_lab.bench.real.traverse import Traverse, detrended, read_traverses
from printmend_lab.dataset.bodies import digest

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
