"""How even the bead is: plastic per mm of true path, with Klipper's pressure advance on.

The nozzle gives what the extruder's motor feeds with a lag, q′ = (e − q)/τ: pressure has to build up. Pressure advance
drives the motor ahead, e + τ e′, smoothed over 40 ms, so that what comes out follows what was commanded as far as that
does not jump. Where a file changes the extrusion of a line, or stops for a crossing, the bead swells or thins. It is
held in bins of true path against what the original file wants there; the ends of lines are left out.
"""

import numpy as np
from scipy.signal import lfilter

from klippy_judge import Track, Wanted
from klippy_run import Planned, at_time

ADVANCE_S = 0.05
"""The lag of the nozzle, and the pressure advance that Klipper is set to."""
ADVANCED = f"SET_PRESSURE_ADVANCE ADVANCE={ADVANCE_S:g} SMOOTH_TIME=0.04\n".encode()
_BIN_MM = 0.8  # two widths of a line
_ENDS_MM = 2.0  # at both ends of a line, where the slicer starts and stops the flow
_TICK_S = 0.0005
_STANDS_MM = 0.1  # a move without plastic during which the nozzle goes less is a crossing, no travel


def bead_deviation(planned: Planned, track: Track, wanted: Wanted) -> float:
    """Return the 95th percentile, by length of path, of how far the bead is from what is wanted, as a share of it."""
    time = np.arange(planned.start_s[0], planned.end_s[-1], _TICK_S)
    fed = at_time(*planned.steps["e"], 0.0, time)
    gain = 1.0 - np.exp(-_TICK_S / ADVANCE_S)
    given = lfilter([gain], [1.0, gain - 1.0], fed)
    told = commanded_mm(planned, time)
    gone = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(track.at(time)[:, :2], axis=0).T))])
    length = np.linalg.norm(wanted.end_mm - wanted.start_mm, axis=1)
    filament = np.concatenate([[wanted.filament_mm[0] - 1e-3], wanted.filament_mm])
    along = np.interp(told, filament, np.concatenate([[0.0], np.cumsum(length)]))
    off, weight = [], []
    for first, last in _lines(planned, time, gone):
        edges = np.arange(gone[first] + _ENDS_MM, gone[last] - _ENDS_MM, _BIN_MM)
        at = np.searchsorted(gone[first : last + 1], edges) + first
        if len(at) < 2:
            continue
        path, plastic = np.diff(gone[at]), np.diff(given[at])
        rate = np.diff(told[at]) / np.maximum(np.diff(along[at]), 1e-9)
        kept = (np.diff(along[at]) > _BIN_MM / 2) & (path > _BIN_MM / 2) & (rate > 1e-4)
        off.append(np.abs(plastic / path / np.maximum(rate, 1e-9) - 1.0)[kept])
        weight.append(path[kept])
    if not off:
        return float("nan")  # no line is long enough
    found, weights = np.concatenate(off), np.concatenate(weight)
    order = np.argsort(found)
    share = np.cumsum(weights[order]) / weights.sum()
    return float(found[order[np.searchsorted(share, 0.95)]])


def commanded_mm(planned: Planned, time_s: np.ndarray) -> np.ndarray:
    """Return how much filament the file has commanded at given times [T], without pressure advance."""
    index = np.clip(np.searchsorted(planned.start_s, time_s, side="right") - 1, 0, len(planned.moves) - 1)
    speeding, cruising, braking, begin, top, end = planned.moves[index, 1:7].T
    since = time_s - planned.start_s[index]
    up, level, down = (
        np.clip(since, 0.0, speeding), np.clip(since - speeding, 0.0, cruising),
        np.clip(since - speeding - cruising, 0.0, braking),
    )  # fmt: skip

    def ramp(now: np.ndarray, whole: np.ndarray, start: np.ndarray, to: np.ndarray) -> np.ndarray:
        return start * now + (to - start) * now**2 / np.maximum(2 * whole, 1e-12)

    way = ramp(up, speeding, begin, top) + top * level + ramp(down, braking, top, end)
    whole = (begin + top) / 2 * speeding + top * cruising + (top + end) / 2 * braking
    e0, e1 = planned.start_mm[index, 3], planned.end_mm[index, 3]
    return e0 + (e1 - e0) * np.minimum(way / np.maximum(whole, 1e-12), 1.0)


def _lines(planned: Planned, time_s: np.ndarray, gone_mm: np.ndarray) -> list[tuple[int, int]]:
    """Return the first and the last tick of each printed line: moves that push plastic, and crossings amid them."""
    ticks = np.searchsorted(time_s, np.append(planned.start_s, planned.end_s[-1]))
    ticks = np.minimum(ticks, len(time_s) - 1)
    pushes = planned.end_mm[:, 3] > planned.start_mm[:, 3] + 1e-6
    way = np.linalg.norm((planned.end_mm - planned.start_mm)[:, :3], axis=1)
    prints = pushes & (way > 1e-6)
    stands = ~pushes & (planned.end_mm[:, 3] == planned.start_mm[:, 3]) & (np.diff(gone_mm[ticks]) < _STANDS_MM)
    inside = prints | stands
    changes = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    return [(int(ticks[a]), int(ticks[b])) for a, b in zip(changes[::2], changes[1::2], strict=True)]
