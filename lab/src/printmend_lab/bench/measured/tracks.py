"""A measured set as tracks: what was commanded, what was measured; some to learn from, the others to be judged."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from printmend.path import frozen

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
