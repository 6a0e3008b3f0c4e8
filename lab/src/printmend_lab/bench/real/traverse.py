"""Measured traverses: a carriage driven at constant speed over its bed and back, again and again.

The data are the authors' motion capture of a belt printer with printed non-circular pulleys. Each traverse is the
error of the carriage's position over the nominal travel since the traverse's first sample, detrended.
"""

import csv
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from printmend.errors import TraceError, reason
from printmend.path import frozen

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
    todo = "see the columns in printmend_lab.bench.real.traverse"
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
