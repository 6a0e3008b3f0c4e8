"""Measured traverses: a carriage driven at constant speed over its bed and back, again and again.

The data are the authors' motion capture of a belt printer with printed non-circular pulleys. Each traverse is the
error of the carriage's position over the nominal travel since the traverse's first sample, detrended.
"""

import csv
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from printmend.errors import TraceError
from printmend.path import frozen

COLUMNS = ("pulley_shape", "nominal_speed_mm_s", "segment", "direction", "nominal_travel_mm", "position_error_mm")


@dataclass(frozen=True, eq=False)
class Traverse:
    """One traverse: ``travel_mm`` [N] from 0, ``error_mm`` [N]; ``direction`` is + or −1.

    ``recording`` counts the recordings of a file: the carriage alternates between its directions, and where it does
    not the recording was interrupted and the carriage brought back.
    """

    shape: str
    speed_mm_s: float
    segment: int
    direction: int
    recording: int
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
    todo = "see the columns in printmend.bench.traverse"
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
        came = getattr(error, "strerror", None) or str(error)
        raise TraceError(path, wanted="a CSV of traverses", came=came, todo="check the file") from None
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
    # The first recording drives + on even segments; an odd + means that the count has slipped by one.
    recording = 0 if (segment % 2 == 0) == (direction > 0) else 1
    return Traverse(shape, speed, segment, direction, recording, points[:, 0], points[:, 1])


def starts_mm(traverses: list[Traverse]) -> np.ndarray:
    """Return where each traverse of one direction starts, relative to the first [mm]: the commanded geometry alone.

    Constant speed begins where the acceleration ends, after a way that grows with the speed, and ends as long before
    the turn. Both ends of a full traverse are cut alike, so traverses of unequal length share their middle. One that
    was broken off (below 95 % of the longest) starts where the nearest full one before it did, else the one after.
    """
    lengths = np.array([traverse.length_mm for traverse in traverses])
    full = np.flatnonzero(lengths >= 0.95 * lengths.max())
    before = np.searchsorted(full, np.arange(len(lengths)), side="right") - 1
    starts = (lengths.max() - lengths[full[np.maximum(before, 0)]]) / 2
    return starts - starts[0]


def detrended(travel_mm: np.ndarray, error_mm: np.ndarray) -> np.ndarray:
    """Remove the least-squares line, as was done to the data: a prediction is compared after the same."""
    columns = np.stack([np.ones_like(travel_mm), travel_mm], axis=1)
    return error_mm - columns @ np.linalg.lstsq(columns, error_mm, rcond=None)[0]
