"""A part in three dimensions, three times at the same points: as wanted, as this machine prints it, and mended.

The points lie along the wanted extruded path. The planner says which pieces each line of the file becomes, so that the
mended print is known at the very points of the wanted one, and a page can draw anything between the three by moving
points. `write_scene` packs them as flat arrays that a graphics card takes as they are.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from printmend.files import replacing
from printmend.gcode import kernels as k
from printmend.gcode.container import open_gcode
from printmend.gcode.layers import layers_of
from printmend.gcode.read import starting_state
from printmend.gcode.write import follow
from printmend.invert import Planner, layout, start
from printmend.machine import Mechanism
from printmend.machine.printing import print_from_home
from printmend.studio import kernels

MOST_POINTS = 600_000  # what a graphics card of an ordinary computer turns without a jerk; 17 MB
_PITCHES_MM = (0.8, 6.0)  # between points on long lines: finest and coarsest
_SIDE = 1e-7  # of a line: this side of its end, or that
_NEAR = 3  # wanted segments to either side that a printed point may belong to
_UNIT_MM = 0.002  # of the packed offsets: 16 bits reach 65 mm
_COLUMNS = ["x0", "y0", "z0", "x1", "y1", "z1", "c0", "c1", "advance", "flags", "layer", "turns", "kind", "plane"]
_BOTH_KNOWN = k.FLAG_KNOWN_X0 | k.FLAG_KNOWN_Y0 | k.FLAG_KNOWN_X1 | k.FLAG_KNOWN_Y1


@dataclass(frozen=True, eq=False)
class Lines:
    """Moves of the head, L of them: ``start_mm`` and ``end_mm`` [L, 3], ``center_mm`` [L, 2] (NaN where straight),
    ``turn`` [L] 0 for straight ones, −1 clockwise, 1 counter-clockwise, with ``turns`` [L] further circles; ``begin``
    and ``end`` [L] say which part of the file each is: record 7 is what lies between 7 and 8."""

    start_mm: np.ndarray
    end_mm: np.ndarray
    center_mm: np.ndarray
    turn: np.ndarray
    turns: np.ndarray
    begin: np.ndarray
    end: np.ndarray


@dataclass(frozen=True, eq=False)
class Scene:
    """Points [P] along the extruded path: ``wanted_mm`` [P, 3], how far ``raw_mm`` and ``mended_mm`` [P, 2] lie from
    there, each with its distance from the wanted path [P] mm; ``joined`` [P]: a bead leads on to the next point;
    ``width_mm`` and ``height_mm`` [P] of the bead, ``layer`` [P] from 0. ``mended_mm`` is None before mending. Of parts
    with too many points only every ``every``-th layer is there."""

    wanted_mm: np.ndarray
    raw_mm: np.ndarray
    raw_error_mm: np.ndarray
    mended_mm: np.ndarray | None
    mended_error_mm: np.ndarray | None
    joined: np.ndarray
    width_mm: np.ndarray
    height_mm: np.ndarray
    layer: np.ndarray
    every: int

    def rms_mm(self, error_mm: np.ndarray) -> float:
        """Return the root mean square of an error [P] over the length of the path."""
        length = np.linalg.norm(np.diff(self.wanted_mm, axis=0), axis=1) * self.joined[:-1]
        square = (error_mm[:-1] ** 2 + error_mm[1:] ** 2) / 2
        return float(np.sqrt(np.average(square, weights=length))) if length.sum() else 0.0


class _Tap:
    """A planner that keeps what passes through it: motion records and the pieces that each becomes."""

    def __init__(self, planner: Planner | None) -> None:
        self._planner = planner
        self._records: list[np.ndarray] = []
        self._counts: list[np.ndarray] = []
        self._pieces: list[np.ndarray] = []

    def plan(self, records: np.ndarray, begin: int) -> tuple[int, np.ndarray, np.ndarray]:
        """Do as `Planner.plan`, without a planner nothing."""
        if self._planner is None:
            end, first, pieces = len(records), np.zeros(len(records) + 1, np.int64), np.empty(0, k.PIECE)
        else:
            end, first, pieces = self._planner.plan(records, begin)
        rows = records[begin:end]
        motion = np.isin(rows["kind"], (k.KIND_LINEAR, k.KIND_CW, k.KIND_CCW))
        count = np.diff(first[begin : end + 1])
        self._records.append(rows[motion][_COLUMNS].copy())
        self._counts.append(count[motion])
        self._pieces.append(pieces[first[begin] : first[end]][np.repeat(motion, count)].copy())
        return end, first, pieces

    def kept(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the records [R], how many pieces each became [R], and the pieces."""
        return np.concatenate(self._records), np.concatenate(self._counts), np.concatenate(self._pieces)


def build_scene(
    source: Path, truth: Mechanism, *, plan: Mechanism | None, aligned: bool = False, most: int = MOST_POINTS
) -> Scene:
    """Print a G-code file on ``truth`` as it is and, unless ``plan`` is None, as mended for the machine ``plan``.

    Both machines are absolute, as those of a saved model. ``aligned`` lays either print where it fits the wanted one
    best, as someone does who holds a part in the hand. Raises `GcodeError` for what cannot be read.
    """
    tap = _Tap(None if plan is None else start(plan))
    with open_gcode(source) as file:
        part = file.parts[0]
        follow(part.chunks(), starting_state(part, printer=truth.printer), tap.plan)
    records, counts, pieces = tap.kept()
    drawn = (records["flags"] & k.FLAG_EXTRUDING != 0) & (records["flags"] & _BOTH_KNOWN == _BOTH_KNOWN)
    layer = layers_of(records["layer"].astype(np.int64), records["z0"], records["z1"], drawn)
    drawn &= layer >= 0
    lines = _source_lines(records)
    length, *_ = _lengths(lines)
    pitch_mm = float(np.clip(length[drawn].sum() / (0.6 * most), *_PITCHES_MM))
    points, at = _points(lines, np.where(drawn, pitch_mm, np.inf))
    record = np.clip(np.ceil(at).astype(np.int64) - 1, 0, max(len(records) - 1, 0))
    raw = print_from_home(truth, points)
    # a bead begins at a point that ends another line, or where the head jumped to
    bead_end = drawn[record] & (at > record)
    mended = None
    if plan is not None:
        told = _given_lines(lines, records, counts, pieces)
        given, given_at = _points(told, np.where(told.turn != 0, pitch_mm / 4, pitch_mm))
        result = print_from_home(truth, given)
        # slack is taken up between two lines: before a bead begins, after one ends
        look = at + np.where(bead_end, -_SIDE, _SIDE)
        mended = np.column_stack([np.interp(look, given_at, column) for column in result[:, :2].T])
    joined = np.append(bead_end[1:], False) & (np.append(at[1:], np.inf) - at <= 1.0)
    keep = bead_end | joined
    every = max(1, -(-int(keep.sum()) // most))
    of = layer[np.where(bead_end, record, np.minimum(record + 1, len(records) - 1))]
    keep &= of % every == 0
    wanted, joined = points[keep], joined[keep]
    joined &= np.append(of[keep][1:] == of[keep][:-1], False)
    offsets = [None if way is None else (way[:, :2] - points[:, :2])[keep] for way in (raw, mended)]
    if aligned:
        offsets = [None if off is None else off - off.mean(axis=0) for off in offsets]
    off, off_mended = offsets
    assert off is not None
    width, height = _bead(records, length, layer)
    which = np.where(bead_end, record, np.minimum(record + 1, len(records) - 1))[keep]
    return Scene(
        wanted, off, _distance(wanted, wanted[:, :2] + off, joined), off_mended,
        None if off_mended is None else _distance(wanted, wanted[:, :2] + off_mended, joined),
        joined, width[which], height[which], of[keep], every,
    )  # fmt: skip


def _source_lines(records: np.ndarray) -> Lines:
    start_mm = np.column_stack([records[name] for name in ("x0", "y0", "z0")])
    end_mm = np.column_stack([records[name] for name in ("x1", "y1", "z1")])
    turn = np.where(records["kind"] == k.KIND_CW, -1, np.where(records["kind"] == k.KIND_CCW, 1, 0))
    turn[records["plane"] != 0] = 0  # arcs that stand upright are drawn as chords
    number = np.arange(len(records), dtype=float)
    center = np.column_stack([records["c0"], records["c1"]])
    return Lines(start_mm, end_mm, center, turn, records["turns"].astype(np.int64), number, number + 1)


def _given_lines(lines: Lines, records: np.ndarray, counts: np.ndarray, pieces: np.ndarray) -> Lines:
    """Return what the head is told to do instead: the pieces, and as they are the records that have none."""
    rows = np.maximum(counts, 1)
    first = np.cumsum(rows) - rows
    of = np.repeat(np.arange(len(records)), rows)
    planned = np.repeat(counts > 0, rows)
    end_mm = lines.end_mm[of].copy()
    share = np.ones(len(of))
    center, turn = lines.center_mm[of].copy(), np.where(planned, 0, lines.turn[of])
    end_mm[planned] = np.column_stack([pieces[name] for name in ("x", "y", "z")])
    share[planned] = pieces["share"]
    arc = np.flatnonzero(planned)[pieces["kind"] == k.PIECE_ARC]
    center[arc] = np.column_stack([pieces["c0"], pieces["c1"]])[pieces["kind"] == k.PIECE_ARC]
    turn[arc] = lines.turn[of[arc]]
    total = np.cumsum(share)
    done = np.minimum(total - (total[first] - share[first])[of], 1.0)
    done[np.append(first[1:], len(of)) - 1] = 1.0
    begin = of + np.where(np.arange(len(of)) == first[of], 0.0, np.roll(done, 1))
    # where a record does not begin at the last one's end, the head went there by itself
    jumped = np.concatenate([[True], (lines.start_mm[1:] != lines.end_mm[:-1]).any(axis=1)])[: len(records)]
    # what moves neither X nor Y (retractions, lifts) leaves the head where mending had put it
    still = (~planned & (lines.start_mm[of, :2] == lines.end_mm[of, :2]).all(axis=1)) & ~jumped[of]
    end_mm[:, :2] = end_mm[np.maximum.accumulate(np.where(still, 0, np.arange(len(of)))), :2]
    start_mm = np.roll(end_mm, 1, axis=0)
    start_mm[first[jumped]] = lines.start_mm[jumped]
    return Lines(start_mm, end_mm, center, turn, lines.turns[of], begin, of + done)


def _points(lines: Lines, pitch_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points [N, 3] along lines, ends included and at most ``pitch_mm`` apart, and which part of the file
    each is [N]; where the head jumped, also its new place."""
    if not len(lines.begin):
        return np.empty((0, 3)), np.empty(0)
    length, sweep, radius = _lengths(lines)
    counts = np.maximum(np.ceil(length / pitch_mm), 1).astype(np.int64)
    jumped = np.concatenate([[True], (lines.start_mm[1:] != lines.end_mm[:-1]).any(axis=1)])
    rows = counts + jumped
    of = np.repeat(np.arange(len(counts)), rows)
    step = np.arange(len(of)) - np.repeat(np.cumsum(rows) - rows, rows) + np.where(jumped[of], 0, 1)
    share = step / counts[of]
    points = lines.start_mm[of] + share[:, None] * (lines.end_mm - lines.start_mm)[of]
    arcs = lines.turn[of] != 0
    line = of[arcs]
    angle = np.arctan2(*(lines.start_mm[line, :2] - lines.center_mm[line]).T[::-1]) + share[arcs] * sweep[line]
    ring = lines.center_mm[line] + radius[line, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    points[arcs, :2] = np.where((share[arcs] < 1)[:, None], ring, lines.end_mm[line, :2])
    return points, lines.begin[of] + share * (lines.end - lines.begin)[of]


def _lengths(lines: Lines) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the length [L] of each line, and the angle and radius of the arcs."""
    length = np.linalg.norm(lines.end_mm - lines.start_mm, axis=1)
    sweep, radius = np.zeros(len(length)), np.zeros(len(length))
    arcs = np.flatnonzero(lines.turn)
    first, last = (ends[arcs, :2] - lines.center_mm[arcs] for ends in (lines.start_mm, lines.end_mm))
    turned = lines.turn[arcs] * (np.arctan2(last[:, 1], last[:, 0]) - np.arctan2(first[:, 1], first[:, 0]))
    turned = np.mod(turned, 2 * np.pi)
    turned[turned < 1e-9] = 2 * np.pi
    sweep[arcs] = lines.turn[arcs] * (turned + 2 * np.pi * lines.turns[arcs])
    radius[arcs] = np.hypot(*first.T)
    length[arcs] = np.maximum(np.abs(sweep[arcs]) * radius[arcs], length[arcs])
    return length, sweep, radius


def _distance(wanted_mm: np.ndarray, printed_mm: np.ndarray, joined: np.ndarray) -> np.ndarray:
    """Return the distance [P] of each printed point from the wanted path around its own place on it."""
    out = np.empty(len(wanted_mm))
    kernels.distances(np.ascontiguousarray(wanted_mm[:, :2]), np.ascontiguousarray(printed_mm), joined, _NEAR, out)
    return out


def _bead(records: np.ndarray, length_mm: np.ndarray, layer: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return width and height [R] mm of each record's bead: a bar with round sides, of the filament's volume."""
    count = int(layer.max(initial=0)) + 1
    heights = np.full(count, np.nan)
    extruding = (records["flags"] & k.FLAG_EXTRUDING != 0) & (layer >= 0)
    top = np.full(count, -np.inf)
    np.maximum.at(top, layer[extruding], records["z1"][extruding])
    found = np.flatnonzero(np.isfinite(top))
    heights[found] = np.diff(top[found], prepend=0.0)
    usual = float(np.nanmedian(heights)) if len(found) else 0.2
    heights = np.where((heights > 0.02) & (heights < 1.0), heights, usual)
    height = np.clip(heights[np.maximum(layer, 0)], 0.05, 1.0)
    area = records["advance"] * layout.FILAMENT_AREA_MM2 / np.maximum(length_mm, 1e-6)
    return np.clip(area / height + height * (1 - np.pi / 4), 0.15, 1.5), height


def write_scene(path: Path, scene: Scene) -> dict[str, Any]:
    """Pack a scene into a file: a JSON head, then the arrays. Return the head."""
    count = len(scene.wanted_mm)
    layers, first = np.unique(scene.layer, return_index=True)
    low, high = (
        (scene.wanted_mm.min(axis=0), scene.wanted_mm.max(axis=0)) if count else (np.zeros(3), np.zeros(3))
    )  # fmt: skip
    head = {
        "points": count, "every": scene.every, "unit_mm": _UNIT_MM, "mended": scene.mended_mm is not None,
        "low_mm": np.round(low, 3).tolist(), "high_mm": np.round(high, 3).tolist(),
        "layers": [[int(number), int(at), round(float(scene.wanted_mm[at, 2]), 3)]
                   for number, at in zip(layers, first, strict=True)],
        "raw_p95_mm": _p95(scene.raw_error_mm), "mended_p95_mm": _p95(scene.mended_error_mm),
    }  # fmt: skip
    none = np.zeros((count, 2))
    mended, error = (none, none[:, 0]) if scene.mended_mm is None else (scene.mended_mm, scene.mended_error_mm)
    offsets = np.column_stack([scene.raw_mm, mended]) / _UNIT_MM
    errors = np.column_stack([scene.raw_error_mm, none[:, 0] if error is None else error]) * 1000
    marks = np.column_stack(
        [scene.joined, np.rint(scene.width_mm * 100), np.rint(scene.height_mm * 100), np.zeros(count)]
    )
    text = json.dumps(head).encode()
    text += b" " * (-(4 + len(text)) % 4)
    with replacing(path, "wb") as file:
        file.write(len(text).to_bytes(4, "little") + text)
        file.write(scene.wanted_mm.astype("<f4").tobytes())
        file.write(np.clip(np.rint(offsets), -32767, 32767).astype("<i2").tobytes())
        file.write(np.clip(np.rint(errors), 0, 65535).astype("<u2").tobytes())
        file.write(np.clip(marks, 0, 255).astype("u1").tobytes())
    return head


def _p95(error_mm: np.ndarray | None) -> float | None:
    return None if error_mm is None or not len(error_mm) else round(float(np.quantile(error_mm, 0.95)), 4)
