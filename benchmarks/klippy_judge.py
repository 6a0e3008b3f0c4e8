"""Where the plastic lands when Klipper's planner drives a broken printer, how long it takes, and where it stops.

Both files go through the planner (klippy_run.py), the steps of both through the true printer (true_printer.py). What
is wanted is the original as the planner understands it on a healthy machine; a sample is a step of the extruder that
pushes new plastic. Nothing of printmend reads, mends or predicts here; a `Printer` is its plain numbers.
"""

import re
from dataclasses import dataclass

import numpy as np

from klippy_run import E_MM_PER_STEP, Planned, at_time
from printmend.printer import Printer
from true_printer import TruePrinter

STOP_MM_S = 1.0
"""Slower than this while it prints, the nozzle stops."""
CORNER_MM_S = 6.0
"""Slower than this it stands nearly still: Klipper passes a right angle at 5 mm/s."""
_SAME_PLACE_MM = 0.1  # where plastic goes on less than this from where it ended there was no travel
_AROUND_MM = 0.05  # filament, some 1.5 mm of path: a sample belongs to the wanted path within this much of it
_EPS_MM = 1e-6


@dataclass(frozen=True)
class Judged:
    """The figures of one file on one printer: distances [mm] of the samples from the wanted path, time [s], stops."""

    rms_mm: float
    p95_mm: float
    max_mm: float
    height_max_mm: float
    job_s: float
    stops: int
    corners: int
    moves: int
    samples: int


@dataclass(frozen=True, eq=False)
class Wanted:
    """The path on which plastic should lie: segments [S] in their order, and how much filament is used at each end."""

    start_mm: np.ndarray
    end_mm: np.ndarray
    z_mm: np.ndarray
    filament_mm: np.ndarray


def wanted_path(original: Planned) -> Wanted:
    """Return where the original lays plastic on a healthy machine."""
    index, till = deposits(original)
    return Wanted(original.start_mm[index, :2], original.end_mm[index, :2], original.end_mm[index, 2], till)


def deposits(planned: Planned) -> tuple[np.ndarray, np.ndarray]:
    """Return the moves that push new plastic and how much filament has been pushed at their ends.

    What a retraction drew back is not new plastic when it comes again.
    """
    e = planned.end_mm[:, 3]
    most = np.maximum.accumulate(e)
    index = np.flatnonzero(e > np.concatenate([[planned.start_mm[0, 3]], most[:-1]]) + _EPS_MM)
    return index, e[index]


def samples(planned: Planned) -> tuple[np.ndarray, np.ndarray]:
    """Return the times [N] at which plastic lands, and the filament pushed by then [mm]."""
    time, e = planned.steps["e"]
    most = np.maximum.accumulate(np.concatenate([[0.0], e]))
    new = e > most[:-1] + _EPS_MM
    return time[new], e[new] - E_MM_PER_STEP / 2


class Track:
    """The nozzle of a printer, true or (None) healthy, under the steps of a planned file."""

    def __init__(self, planned: Planned, printer: Printer, true: TruePrinter | None = None) -> None:
        home_mm, corexy = [axis.home_mm for axis in printer.axes], printer.kinematics == "corexy"
        names = ("a", "b") if corexy else ("x", "y")
        home = (home_mm[0] + home_mm[1], home_mm[0] - home_mm[1]) if corexy else home_mm[:2]
        self._times = [planned.steps[name][0] for name in names]
        ways = [np.concatenate([[at], planned.steps[name][1]]) for at, name in zip(home, names, strict=True)]
        self._belts = ways if true is None else true.belts((ways[0][1:], ways[1][1:]))
        # The same without micro-steps, as fine as which the nozzle may creep: where each of the planner's moves ends.
        x, y = planned.end_mm[:, 0], planned.end_mm[:, 1]
        ends = (x + y, x - y) if corexy else (x, y)
        self._ends = (
            [np.concatenate([[at], way]) for at, way in zip(home, ends, strict=True)] if true is None
            else true.belts(ends)
        )  # fmt: skip
        self._z_times, z = planned.steps["z"]
        self._heights, self._push = (
            (np.concatenate([[home_mm[2]], z]), np.zeros((len(z) + 1, 2))) if true is None else true.heights(z)
        )
        self._true, self._corexy = true, corexy

    def at(self, time_s: np.ndarray) -> np.ndarray:
        """Return the nozzle's places [T, 3] at given times."""
        belts = np.stack(
            [at_time(t, way[1:], way[0], time_s) for t, way in zip(self._times, self._belts, strict=True)], axis=1
        )
        index = np.searchsorted(self._z_times, time_s, side="right")
        return np.column_stack([self._framed(belts) + self._push[index], self._heights[index]])

    def smooth_at(self, time_s: np.ndarray) -> np.ndarray:
        """Return the nozzle's places [T, 2] at given times, as if each motor went evenly from one step to the next."""
        belts = [
            np.interp(time_s, t, way[1:]) if len(t) else np.full(len(time_s), way[0])
            for t, way in zip(self._times, self._belts, strict=True)
        ]
        index = np.searchsorted(self._z_times, time_s, side="right")
        return self._framed(np.stack(belts, axis=1)) + self._push[index]

    def ends(self) -> np.ndarray:
        """Return the nozzle's places [1 + M, 2] at home and at the end of each move, were there no micro-steps."""
        return self._framed(np.stack(self._ends, axis=1))

    def _framed(self, belts: np.ndarray) -> np.ndarray:
        if self._true is not None:
            return self._true.framed(belts)
        return np.stack([belts.sum(axis=1) / 2, (belts[:, 0] - belts[:, 1]) / 2], axis=1) if self._corexy else belts


def distances_mm(wanted: Wanted, places_mm: np.ndarray, filament_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how far samples [N, 3] are from the wanted path where about as much filament was pushed, and in height."""
    first = np.searchsorted(wanted.filament_mm, filament_mm - _AROUND_MM)
    last = np.minimum(np.searchsorted(wanted.filament_mm, filament_mm + _AROUND_MM), len(wanted.filament_mm) - 1)
    here = np.minimum(np.searchsorted(wanted.filament_mm, filament_mm), len(wanted.filament_mm) - 1)
    best = np.full(len(places_mm), np.inf)
    way = wanted.end_mm - wanted.start_mm
    square = np.maximum((way**2).sum(axis=1), 1e-18)
    for k in range(int((last - first).max(initial=-1)) + 1):
        rows = np.flatnonzero(first + k <= last)
        segment = first[rows] + k
        from_start = places_mm[rows, :2] - wanted.start_mm[segment]
        share = np.clip((from_start * way[segment]).sum(axis=1) / square[segment], 0.0, 1.0)
        off = np.linalg.norm(from_start - share[:, None] * way[segment], axis=1)
        best[rows] = np.minimum(best[rows], off)
    return best, np.abs(places_mm[:, 2] - wanted.z_mm[here])


def slowest_mm_s(planned: Planned, track: Track) -> np.ndarray:
    """Return the nozzle's slowest speed [mm/s] from each move that prints to the next; infinite across a travel.

    Slow is the planner's speed where two moves meet, or a nozzle that does not move while the motors do: slack taken up
    between the two, or inside one of them.
    """
    index, _ = deposits(planned)
    commanded = np.linalg.norm(planned.end_mm[:, :3] - planned.start_mm[:, :3], axis=1)
    index = index[commanded[index] > 0]
    if len(index) < 2:
        return np.empty(0)
    before, after = index[:-1], index[1:]
    places_mm = track.ends()
    starts, ends = places_mm[index], places_mm[index + 1]
    jump = np.linalg.norm(starts[1:] - ends[:-1], axis=1)
    pause = planned.start_s[after] - planned.end_s[before]
    speed = np.minimum(planned.moves[before, 6], planned.moves[after, 4])
    between = np.minimum.reduceat(planned.moves[:, [4, 6]].min(axis=1), np.stack([before + 1, after], axis=1).ravel())[
        ::2
    ]
    speed = np.where(after > before + 1, np.minimum(speed, between), speed)
    speed = np.where(pause > 1e-6, np.minimum(speed, jump / np.maximum(pause, 1e-6)), speed)
    duration = planned.moves[index, 1:4].sum(axis=1)
    itself = np.linalg.norm(ends - starts, axis=1) / np.maximum(duration, 1e-9)
    itself[commanded[index] < _SAME_PLACE_MM] = np.inf  # shorter ones are a few micro-steps
    return np.where(jump < _SAME_PLACE_MM, np.minimum(speed, np.minimum(itself[:-1], itself[1:])), np.inf)


def places(speed_mm_s: np.ndarray, below_mm_s: float) -> int:
    """Count the places where the speed falls below a limit; neighbours are one place."""
    slow = speed_mm_s < below_mm_s
    return int((np.diff(slow.astype(int), prepend=0) > 0).sum())


def judge(planned: Planned, wanted: Wanted, track: Track, path: Track, gcode: bytes) -> Judged:
    """Return the figures of a file whose plan is ``planned`` on the printer of ``track``.

    ``path`` is where the nozzle is meant to be, which tells stops from travels: the healthy track for an original.
    """
    time, filament = samples(planned)
    speed = slowest_mm_s(planned, path)
    off, height = distances_mm(wanted, track.at(time), filament)
    commands = len(_MOTION.findall(gcode))
    return Judged(
        float(np.sqrt((off**2).mean())), float(np.quantile(off, 0.95)), float(off.max()), float(height.max()),
        planned.job_s, places(speed, STOP_MM_S), places(speed, CORNER_MM_S), commands, len(off),
    )  # fmt: skip


def judge_both(
    original: Planned, corrected: Planned, printer: Printer, true: TruePrinter, text: bytes, mended: bytes
) -> tuple[Judged, Judged, tuple[str, ...]]:
    """Return the figures of a file and of its corrected form on one broken printer, and what only the second complains.

    Both are held against the path that the original draws on a healthy ``printer``.
    """
    wanted, track = wanted_path(original), Track(corrected, printer, true)
    before = judge(original, wanted, Track(original, printer, true), Track(original, printer), text)
    after = judge(corrected, wanted, track, track, mended)
    return before, after, tuple(sorted(set(corrected.complaints) - set(original.complaints)))


_MOTION = re.compile(rb"^\s*G0?[0-3](?![0-9])", re.MULTILINE | re.IGNORECASE)
