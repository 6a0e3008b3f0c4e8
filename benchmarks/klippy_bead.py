"""How even the bead is: plastic per mm of true path, with Klipper's pressure advance and input shaper on.

The nozzle gives what the extruder's motor feeds with a lag, q′ = (e − q)/τ: pressure has to build up. Pressure advance
drives the motor ahead, e + τ e′, smoothed over 40 ms, so that what comes out follows what was commanded as far as that
does not jump. Where a file changes the extrusion of a line, or stops for a crossing, the bead swells or thins. It is
held in bins of true path against what the original file wants there; the ends of lines are left out. The shaper (MZV,
40 Hz) rounds corners and crossings off.

On walls along an axis a ripple of that motor is no error of place: the nozzle goes faster and slower than it should.
There the bead is judged by the RMS of its deviation, in shorter bins.
"""

import numpy as np
from scipy.signal import lfilter

from klippy_judge import Track, Wanted
from klippy_run import Planned

ADVANCE_S = 0.05
"""The lag of the nozzle, and the pressure advance that Klipper is set to."""
ADVANCED = f"SET_PRESSURE_ADVANCE ADVANCE={ADVANCE_S:g} SMOOTH_TIME=0.04\n".encode()
SHAPED = "[input_shaper]\nshaper_freq_x: 40\nshaper_freq_y: 40\nshaper_type: mzv\n"
"""Lines of Klipper's configuration that turn its shaper on."""
_BIN_MM = 0.8  # two widths of a line
_WALL_BIN_MM = 0.4  # a quarter and less of the period of a belt's teeth
_ALONG_AN_AXIS = 0.03  # the sine of the angle to it, at the most
_ENDS_MM = 2.0  # at both ends of a line, where the slicer starts and stops the flow
_CORNER_MM = 15.0  # at both ends of a wall: there the nozzle brakes, and its pressure settles
_TICK_S = 0.0005
_STANDS_MM = 0.1  # a move without plastic during which the nozzle goes less is a crossing, no travel


def bead_deviation(planned: Planned, track: Track, wanted: Wanted) -> float:
    """Return the 95th percentile, by length of path, of how far the bead is from what is wanted, as a share of it."""
    off, weight, _ = _bins(planned, track, wanted, _BIN_MM)
    if not len(off):
        return float("nan")  # no line is long enough
    order = np.argsort(np.abs(off))
    share = np.cumsum(weight[order]) / weight.sum()
    return float(np.abs(off)[order[np.searchsorted(share, 0.95)]])


def wall_deviation(planned: Planned, track: Track, wanted: Wanted) -> float:
    """Return the RMS of how far the bead is from what is wanted on lines along an axis, as a share of it."""
    off, weight, straight = _bins(planned, track, wanted, _WALL_BIN_MM)
    if not straight.any():
        return float("nan")
    return float(np.sqrt(np.average(off[straight] ** 2, weights=weight[straight])))


def _bins(planned: Planned, track: Track, wanted: Wanted, bin_mm: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return for each bin of a printed line how far the bead is from what is wanted, as a share of it [N], the bin's
    length [mm], and whether its line goes along an axis."""
    time = np.arange(planned.start_s[0], planned.end_s[-1], _TICK_S)
    fed = np.interp(time, *planned.steps["e"]) if len(planned.steps["e"][0]) else np.zeros(len(time))
    gain = 1.0 - np.exp(-_TICK_S / ADVANCE_S)
    given = lfilter([gain], [1.0, gain - 1.0], fed)
    told = commanded_mm(planned, time)
    gone = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(track.smooth_at(time), axis=0).T))])
    way = wanted.end_mm - wanted.start_mm
    length = np.linalg.norm(way, axis=1)
    filament = np.concatenate([[wanted.filament_mm[0] - 1e-3], wanted.filament_mm])
    ends = np.concatenate([[0.0], np.cumsum(length)])
    along = np.interp(told, filament, ends)
    straight = np.abs(way).min(axis=1) <= _ALONG_AN_AXIS * np.maximum(length, 1e-9)
    off, weight, on_axis = [np.empty(0)], [np.empty(0)], [np.empty(0, bool)]
    for first, last in _lines(planned, time, gone):
        edges = np.arange(gone[first] + _ENDS_MM, gone[last] - _ENDS_MM, bin_mm)
        at = np.searchsorted(gone[first : last + 1], edges) + first
        if len(at) < 2:
            continue
        path, plastic = np.diff(gone[at]), np.diff(given[at])
        rate = np.diff(told[at]) / np.maximum(np.diff(along[at]), 1e-9)
        kept = (np.diff(along[at]) > bin_mm / 2) & (path > bin_mm / 2) & (rate > 1e-4)
        segment = np.minimum(np.searchsorted(wanted.filament_mm, told[at]), len(straight) - 1)
        off.append((plastic / path / np.maximum(rate, 1e-9) - 1.0)[kept])
        weight.append(path[kept])
        inside = np.minimum(along[at] - ends[segment], ends[segment + 1] - along[at]) > _CORNER_MM
        on_axis.append((inside[:-1] & inside[1:] & straight[segment[1:]])[kept])
    return np.concatenate(off), np.concatenate(weight), np.concatenate(on_axis)


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
