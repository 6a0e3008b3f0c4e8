"""Show a part in three dimensions: as intended, as this machine prints it, and mended; make thumbnails for lists.

The points are along the intended extruded path. The planner reports the pieces of each line, so the mended print is
known at the same points, and a page can draw anything between the three by moving points. `write_wanted` and
`write_mended` pack them as tables that a graphics card can use directly. For a large part, `coarse` keeps every n-th
layer, so that the page can show something before the whole part is drawn.
"""

import contextlib
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from printmend.effects.sized import Sized
from printmend.files import replacing
from printmend.gcode import kernels as k
from printmend.gcode.container import Part, open_gcode
from printmend.gcode.read import layers_of, starting_state
from printmend.gcode.write import Plan, follow
from printmend.machine import Mechanism
from printmend.machine.printing import print_from_home
from printmend.plan import layout
from printmend.printer import Printer
from printmend.promise.predict import best_shift
from printmend.studio import kernels
from printmend.twin.twin import moved_mm

# The slicer's printing time, and how many commands a second the printer must receive.

_SPENT = (  # PrusaSlicer and its family, Bambu and Orca, Cura
    re.compile(rb"estimated printing time \(normal mode\)[ \t]*=[ \t]*(\d[\dhmsd ]*)"),
    re.compile(rb"total estimated time:[ \t]*(\d[\dhmsd ]*)"),
    re.compile(rb"^;TIME:[ \t]*(?!6666\b)(\d+)[ \t\r]*$", re.MULTILINE),  # Cura's engine writes 6666 if unknown
)
_WORDS = (b"estimated printing time", b"total estimated time", b";TIME:")
_UNITS_S = {b"d": 86400.0, b"h": 3600.0, b"m": 60.0, b"s": 1.0, b"": 1.0}


def busiest(way_mm: np.ndarray, feed_mm_s: np.ndarray) -> int:
    """Return the largest number of moves [N, 3] mm at feeds [N] mm/s within one second, without acceleration times.
    Moves without a length or a feed take no time."""
    length_mm = np.linalg.norm(way_mm, axis=1)
    moving = (length_mm > 0) & (feed_mm_s > 0)
    ends = np.cumsum(length_mm[moving] / feed_mm_s[moving])
    within = np.searchsorted(ends, ends + 1.0) - np.arange(len(ends))
    return int(within.max(initial=0))


def slicer_s(*texts: bytes) -> float | None:
    """Return the printing time that the slicer states in pieces of the file (`Part.hints`), None if it states none."""
    for expression, word in zip(_SPENT, _WORDS, strict=True):
        for text in texts:
            if word in text and (found := expression.search(text)) is not None:
                return sum(int(count) * _UNITS_S[unit] for count, unit in re.findall(rb"(\d+)([dhms]?)", found[1]))
    return None


COARSE_LINES = 40_000  # about how many beads a large part's first picture has
MOST_POINTS = 600_000  # an ordinary computer's graphics card rotates so many points smoothly; 14 MB
ROW = 2048  # points in a row of a packed table
_BEADS_SHARE = 0.6  # share of the points that are ends of beads if every n-th layer is read; the rest lie between
_SMALL_BYTES = 1_500_000  # a smaller file, packed or not, has fewer beads than a picture may have
_PITCHES_MM = (0.8, 6.0)  # finest and coarsest distance between points on long lines
_BESIDE_END_SHARE = 1e-7  # share of a line: places this far before or after its end tell the two sides apart
NEAR = 3  # a printed point may belong to so many wanted segments to either side
_UNIT_MM = 0.002  # unit of the packed offsets: 16 bits reach 65 mm
_COLUMNS = [
    "x0", "y0", "z0", "x1", "y1", "z1", "c0", "c1", "advance", "flags", "layer", "turns", "kind", "plane", "feed"
]  # fmt: skip
Columns = dict[str, np.ndarray]
_BOTH_KNOWN = k.FLAG_KNOWN_X0 | k.FLAG_KNOWN_Y0 | k.FLAG_KNOWN_X1 | k.FLAG_KNOWN_Y1


@dataclass(frozen=True, eq=False)
class Lines:
    """L moves of the head: ``start_mm`` and ``end_mm`` [L, 3], ``center_mm`` [L, 2] (NaN for straight moves), ``turn``
    [L] (0 straight, −1 clockwise, 1 counter-clockwise) with ``turns`` [L] further circles. ``begin`` and ``end`` [L]
    are its place in the file: record 7 reaches from 7 to 8."""

    start_mm: np.ndarray
    end_mm: np.ndarray
    center_mm: np.ndarray
    turn: np.ndarray
    turns: np.ndarray
    begin: np.ndarray
    end: np.ndarray


@dataclass(frozen=True, eq=False)
class Scene:
    """Points [P] along the extruded path: ``wanted_mm`` [P, 3], and offsets ``raw_mm`` and ``mended_mm`` [P, 2] from
    these, each with its distance from the wanted path [P] mm. ``joined`` [P]: a bead leads on to the next point;
    ``width_mm`` and ``height_mm`` [P] are the bead's, ``layer`` [P] counts from 0. ``mended_mm`` is None before
    mending. A part with too many points has only every ``every``-th layer. ``raw_busiest`` and ``mended_busiest`` are
    the moves in the busiest second, once it is mended."""

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
    raw_busiest: int = 0
    mended_busiest: int = 0

    def rms_mm(self, error_mm: np.ndarray) -> float:
        """Return the RMS of an error [P] over the length of the path."""
        length = np.linalg.norm(np.diff(self.wanted_mm, axis=0), axis=1) * self.joined[:-1]
        square = (error_mm[:-1] ** 2 + error_mm[1:] ** 2) / 2
        return float(np.sqrt(np.average(square, weights=length))) if length.sum() else 0.0


class Tap:
    """Record a planner's output: the number of pieces for each motion of a file, and the pieces.

    ``there`` says which of the file's motions to record, as in `Motion`.
    """

    def __init__(self, there: np.ndarray | None = None) -> None:
        self._name: str | None = None
        self._there, self._at = there, 0
        self._counts: list[np.ndarray] = [np.empty(0, np.int64)]
        self._pieces: list[np.ndarray] = [np.empty(0, k.PIECE)]

    @property
    def seen(self) -> bool:
        """Whether anything was planned."""
        return self._name is not None

    def watch(self, part: Part, plan: Plan) -> Plan:
        """Record the planning of a file's first program; `mend_gcode` calls this."""
        if self._name not in (None, part.name):
            return plan
        self._name = part.name
        return self.over(plan)

    def over(self, plan: Plan) -> Plan:
        """Return a plan that does the same as ``plan``, and is recorded."""

        def noticed(records: np.ndarray, begin: int) -> tuple[int, np.ndarray, np.ndarray]:
            end, first, pieces = plan(records, begin)
            motion = _motion(records[begin:end])
            if self._there is not None:
                passed = np.flatnonzero(motion)
                motion[passed] = self._there[self._at : self._at + len(passed)]
                self._at += len(passed)
            count = np.diff(first[begin : end + 1])
            self._counts.append(count[motion])
            self._pieces.append(pieces[first[begin] : first[end]][np.repeat(motion, count)])
            return end, first, pieces

        return noticed

    def taken(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the number of pieces for each motion [R], and the pieces; forget both."""
        taken = np.concatenate(self._counts), np.concatenate(self._pieces)
        self._counts, self._pieces = [taken[0][:0]], [taken[1][:0]]
        return taken


@dataclass(frozen=True, eq=False)
class Motion:
    """The motions of a file: columns of their ``records`` [R] with their ``lines``, ``length_mm`` and ``layer``;
    ``drawn`` [R] marks those that lay a bead; ``height_mm`` is each layer's. Only every ``every``-th layer is included;
    ``there`` marks the included motions among all of the file, None for all."""

    records: Columns
    lines: Lines
    length_mm: np.ndarray
    layer: np.ndarray
    drawn: np.ndarray
    height_mm: np.ndarray
    every: int = 1
    there: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Drawing:
    """A file's ``motion``, and points along it: ``points_mm`` [N, 3] with their places ``at`` [N] in the file.
    ``bead_end`` [N] marks ends of beads, ``keep`` [N] the shown points. The shown points [P] have a ``record``,
    ``joined`` and ``layer``. Points are ``pitch_mm`` apart; every ``every``-th layer is shown."""

    motion: Motion
    points_mm: np.ndarray
    at: np.ndarray
    bead_end: np.ndarray
    record: np.ndarray
    keep: np.ndarray
    joined: np.ndarray
    layer: np.ndarray
    pitch_mm: float
    every: int


def read_drawing(source: Path, printer: Printer, *, most: int = MOST_POINTS) -> Drawing:
    """Read a file's first part and lay points along its extruded path. Raises `GcodeError` if it cannot be read."""
    return lay_points(read_motion(source, printer, most=most), most=most)


def read_motion(source: Path, printer: Printer, *, most: int = MOST_POINTS) -> Motion:
    """Read the motions of a file's first part; of a file with more than ``most`` beads, only every n-th layer.

    Such a file is read twice, because all of it would fill the memory. Raises `GcodeError` if it cannot be read.
    """
    if source.stat().st_size < _SMALL_BYTES:
        return _whole(_read(source, printer, _COLUMNS))
    seen = _read(source, printer, ["z0", "z1", "flags", "layer"])
    drawn, layer = _drawn(seen)
    height_mm = _heights(seen, layer)
    beads = int(np.count_nonzero(drawn))
    del seen
    if beads <= most:
        return _whole(_read(source, printer, _COLUMNS))
    every = math.ceil(beads / (_BEADS_SHARE * most))
    there = (layer % every == 0) | (layer == layer.max(initial=0)) | (layer < 0)
    records = _read(source, printer, _COLUMNS, there)
    lines = _source_lines(records)
    return Motion(records, lines, _lengths(lines)[0], layer[there], drawn[there], height_mm, every, there)


def _read(source: Path, printer: Printer, names: list[str], there: np.ndarray | None = None) -> Columns:
    """Read columns of the motions in a file's first part: of all, or of those marked in ``there``."""
    parts, at = [{name: np.empty(0, k.RECORD[name]) for name in names}], 0

    def keep_records(records: np.ndarray, begin: int) -> tuple[int, np.ndarray, np.ndarray]:
        nonlocal at
        motion = _motion(records[begin:])
        if there is not None:
            passed = np.flatnonzero(motion)
            motion[passed] = there[at : at + len(passed)]
            at += len(passed)
        parts.append({name: records[name][begin:][motion] for name in names})
        return len(records), np.zeros(len(records) + 1, np.int64), np.empty(0, k.PIECE)

    with open_gcode(source) as file:
        part = file.parts[0]
        follow(part.chunks(), starting_state(part, printer=printer), keep_records)
    return {name: np.concatenate([one[name] for one in parts]) for name in names}


def _drawn(records: Columns) -> tuple[np.ndarray, np.ndarray]:
    """Return which motions [R] lay a bead, and the layer [R] of each."""
    drawn = (records["flags"] & k.FLAG_EXTRUDING != 0) & (records["flags"] & _BOTH_KNOWN == _BOTH_KNOWN)
    layer = layers_of(records["layer"].astype(np.int64), records["z0"], records["z1"], drawn)
    return drawn & (layer >= 0), layer


def _whole(records: Columns) -> Motion:
    drawn, layer = _drawn(records)
    lines = _source_lines(records)
    return Motion(records, lines, _lengths(lines)[0], layer, drawn, _heights(records, layer))


def coarse(motion: Motion) -> Motion | None:
    """Return every n-th layer of a large part, including the lowest and the highest; None for a part that needs no
    coarse picture."""
    every = int(np.count_nonzero(motion.drawn)) // COARSE_LINES
    if every < 2:
        return None
    number = motion.layer // motion.every
    mine = (motion.layer >= 0) & ((number % every == 0) | (motion.layer == motion.layer.max()))
    if mine[motion.drawn].all():  # a part with a single layer
        return None
    records = {name: column[mine] for name, column in motion.records.items()}
    return Motion(
        records, _source_lines(records), motion.length_mm[mine], motion.layer[mine], motion.drawn[mine],
        motion.height_mm, every * motion.every,
    )  # fmt: skip


def lay_points(motion: Motion, *, most: int = MOST_POINTS) -> Drawing:
    """Lay points along the extruded path; if these were more than ``most``, show only every n-th layer."""
    lines, length, layer, drawn = motion.lines, motion.length_mm, motion.layer, motion.drawn
    ends = np.count_nonzero(drawn) + np.count_nonzero(drawn[1:] & ~drawn[:-1])  # a row of beads has one more
    pitch_mm = float(np.clip(length[drawn].sum() / max(most - ends, 1), *_PITCHES_MM))
    points, at = _points(lines, np.where(drawn, pitch_mm, np.inf))
    record = np.clip(np.ceil(at).astype(np.int64) - 1, 0, max(len(length) - 1, 0))
    # a bead begins at the end of another line, or at a place to which the head jumped
    bead_end = drawn[record] & (at > record)
    joined = np.append(bead_end[1:], False)[: len(at)] & (np.append(at[1:], np.inf)[: len(at)] - at <= 1.0)
    keep = bead_end | joined
    every = max(1, -(-int(keep.sum()) // most))
    which = np.where(bead_end, record, np.minimum(record + 1, len(length) - 1))
    of = layer[which]
    keep &= of // motion.every % every == 0
    joined = joined[keep] & np.append(of[keep][1:] == of[keep][:-1], False)[: int(keep.sum())]
    return Drawing(motion, points, at, bead_end, which[keep], keep, joined, of[keep], pitch_mm, every * motion.every)


def as_printed(drawing: Drawing, truth: Mechanism, *, aligned: bool = False, along: Sequence[Sized] = ()) -> Scene:
    """Print a file as it is on ``truth``; ``along`` are effects along the path that no mechanism holds."""
    off = _off_mm(_printed_mm(truth, drawing.points_mm, along), drawing, aligned)
    wanted = drawing.points_mm[drawing.keep]
    width, height = _bead(drawing.motion)
    return Scene(
        wanted, off, _distance(wanted, wanted[:, :2] + off, drawing.joined), None, None, drawing.joined,
        width[drawing.record], height[drawing.record], drawing.layer, drawing.every,
    )  # fmt: skip


def _printed_mm(truth: Mechanism, points_mm: np.ndarray, along: Sequence[Sized]) -> np.ndarray:
    """Return where a machine prints commanded places [N, 3] mm in the plane [N, 2], one after the other from home."""
    printed = print_from_home(truth, points_mm)[:, :2]
    if not along:
        return printed
    path_mm = np.concatenate([[truth.printer.home_mm], points_mm[:, :2]])
    return np.asarray(printed + moved_mm(truth, along, path_mm, from_home=True)[1:])


def as_mended(
    scene: Scene, drawing: Drawing, truth: Mechanism, tap: Tap, *, aligned: bool = False, along: Sequence[Sized] = ()
) -> Scene:
    """Add to a scene how ``truth`` prints the same file mended; ``tap`` has seen it planned."""
    counts, pieces = tap.taken()
    lines, feed = drawing.motion.lines, drawing.motion.records["feed"]
    told = _given_lines(lines, counts, pieces)
    paces = busiest(lines.end_mm - lines.start_mm, feed / 60), _busiest_told(told, feed, counts, pieces)
    given, given_at = _points(told, np.where(told.turn != 0, drawing.pitch_mm / 4, drawing.pitch_mm))
    del told, counts, pieces  # for a large file they take as much memory as the rest
    result = _printed_mm(truth, given, along)
    # slack is taken up between two lines: before a bead begins, or after one ends
    look = drawing.at + np.where(drawing.bead_end, -_BESIDE_END_SHARE, _BESIDE_END_SHARE)
    off = _off_mm(np.column_stack([np.interp(look, given_at, column) for column in result.T]), drawing, aligned)
    error = _distance(scene.wanted_mm, scene.wanted_mm[:, :2] + off, drawing.joined)
    return replace(scene, mended_mm=off, mended_error_mm=error, raw_busiest=paces[0], mended_busiest=paces[1])


def _busiest_told(told: Lines, feed_mm_min: np.ndarray, counts: np.ndarray, pieces: np.ndarray) -> int:
    """Return the moves in the busiest second, after pieces [K] replaced lines (``counts`` [L] each) at feeds [L]."""
    rows = np.maximum(counts, 1)
    feed, of_piece = np.repeat(feed_mm_min, rows), np.repeat(counts > 0, rows)
    feed[of_piece] = np.where(pieces["feed"] > 0, pieces["feed"], feed[of_piece])
    return busiest(told.end_mm - told.start_mm, feed / 60)


def _motion(records: np.ndarray) -> np.ndarray:
    """Return which records are motion."""
    kind = records["kind"]
    return (kind == k.KIND_LINEAR) | (kind == k.KIND_CW) | (kind == k.KIND_CCW)


def _off_mm(printed_mm: np.ndarray, drawing: Drawing, aligned: bool) -> np.ndarray:
    """Return the offsets of printed points from the drawn ones [mm]; ``aligned`` moves the whole part to its best fit.

    A prediction counts the errors of a shape from the same fit, so that colours and figures agree.
    """
    off = (printed_mm - drawing.points_mm[:, :2])[drawing.keep]
    if not aligned:
        return off
    begin = np.flatnonzero(drawing.joined[:-1])
    wanted = drawing.points_mm[drawing.keep][:, :2]
    way = wanted[begin + 1] - wanted[begin]
    length = np.hypot(*way.T)
    begin, way, length = (each[length > 0] for each in (begin, way, length))
    if not len(begin):
        return off
    tangent = way / length[:, None]
    middle = (off[begin] + off[begin + 1]) / 2
    to_left = tangent[:, 0] * middle[:, 1] - tangent[:, 1] * middle[:, 0]
    return off - best_shift(tangent, to_left, length)


def _source_lines(records: Columns) -> Lines:
    """Return the moves that a file's records tell."""
    start_mm = np.column_stack([records[name] for name in ("x0", "y0", "z0")])
    end_mm = np.column_stack([records[name] for name in ("x1", "y1", "z1")])
    turn = np.where(records["kind"] == k.KIND_CW, -1, np.where(records["kind"] == k.KIND_CCW, 1, 0))
    turn[records["plane"] != 0] = 0  # arcs that stand upright are drawn as chords
    number = np.arange(len(turn), dtype=float)
    center = np.column_stack([records["c0"], records["c1"]])
    return Lines(start_mm, end_mm, center, turn, records["turns"].astype(np.int64), number, number + 1)


def _given_lines(lines: Lines, counts: np.ndarray, pieces: np.ndarray) -> Lines:
    """Return the mended moves of the head: the pieces, and unchanged lines without pieces."""
    count = len(lines.begin)
    rows = np.maximum(counts, 1)
    first = np.cumsum(rows) - rows
    of = np.repeat(np.arange(count), rows)
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
    # if a record does not begin at the last one's end, the head went there by itself
    jumped = np.concatenate([[True], (lines.start_mm[1:] != lines.end_mm[:-1]).any(axis=1)])[:count]
    # records that move neither X nor Y (retractions, lifts) leave the head where mending put it
    still = (~planned & (lines.start_mm[of, :2] == lines.end_mm[of, :2]).all(axis=1)) & ~jumped[of]
    end_mm[:, :2] = end_mm[np.maximum.accumulate(np.where(still, 0, np.arange(len(of)))), :2]
    start_mm = np.roll(end_mm, 1, axis=0)
    start_mm[first[jumped]] = lines.start_mm[jumped]
    return Lines(start_mm, end_mm, center, turn, lines.turns[of], begin, of + done)


def _points(lines: Lines, pitch_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points [N, 3] along lines, ends included and at most ``pitch_mm`` apart, and each one's place in the file
    [N]; after a jump of the head, also its new place."""
    if not len(lines.begin):
        return np.empty((0, 3)), np.empty(0)
    length, sweep, radius = _lengths(lines)
    counts = np.maximum(np.ceil(length / pitch_mm), 1).astype(np.int64)
    jumped = np.concatenate([[True], (lines.start_mm[1:] != lines.end_mm[:-1]).any(axis=1)])
    rows = int((counts + jumped).sum())
    points, at = np.empty((rows, 3)), np.empty(rows)
    kernels.points(
        lines.start_mm, lines.end_mm, lines.center_mm, lines.turn, sweep, radius, lines.begin, lines.end, counts,
        jumped, points, at,
    )  # fmt: skip
    return points, at


def _lengths(lines: Lines) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the length [L] of each line, and the angle and radius of the arcs."""
    way = lines.end_mm - lines.start_mm
    length = np.sqrt(np.einsum("ij,ij->i", way, way))
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
    kernels.distances(np.ascontiguousarray(wanted_mm[:, :2]), np.ascontiguousarray(printed_mm), joined, NEAR, out)
    return out


def _heights(records: Columns, layer: np.ndarray) -> np.ndarray:
    """Return the height of each layer's beads, mm."""
    count = int(layer.max(initial=0)) + 1
    heights = np.full(count, np.nan)
    extruding = (records["flags"] & k.FLAG_EXTRUDING != 0) & (layer >= 0)
    top = np.full(count, -np.inf)
    np.maximum.at(top, layer[extruding], records["z1"][extruding])
    found = np.flatnonzero(np.isfinite(top))
    heights[found] = np.diff(top[found], prepend=0.0)
    usual = float(np.nanmedian(heights)) if len(found) else 0.2
    return np.clip(np.where((heights > 0.02) & (heights < 1.0), heights, usual), 0.05, 1.0)


def _bead(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return width and height [R] mm of each record's bead: a bar with round sides and the filament's volume."""
    height = motion.height_mm[np.maximum(motion.layer, 0)]
    area = motion.records["advance"] * layout.FILAMENT_AREA_MM2 / np.maximum(motion.length_mm, 1e-6)
    return np.clip(area / height + height * (1 - np.pi / 4), 0.15, 1.5), height


def write_wanted(path: Path, scene: Scene) -> dict[str, Any]:
    """Pack the wanted and the unmended print; return the head.

    The file is the head's length (4 bytes), the head in JSON, and two tables of four 16-bit numbers for each point,
    padded to whole rows of `ROW` points for the graphics card. The first table has x, y, z in steps of ``step_mm`` from
    ``low_mm``, and bits for joined (1), width (8) and height (7) in 0.01 mm. The second is like `write_mended`'s.
    """
    count = len(scene.wanted_mm)
    layers, first = np.unique(scene.layer, return_index=True)
    none = np.zeros(3)
    low, high = (scene.wanted_mm.min(axis=0), scene.wanted_mm.max(axis=0)) if count else (none, none)
    step = np.maximum(high - low, 1e-3) / 65535
    head = {
        "points": count, "every": scene.every, "unit_mm": _UNIT_MM, "row": ROW,
        "low_mm": low.tolist(), "high_mm": high.tolist(), "step_mm": step.tolist(),
        "p95_mm": _p95_mm(scene.raw_error_mm),
        "layers": [[int(number), int(at), round(float(scene.wanted_mm[at, 2]), 3)]
                   for number, at in zip(layers, first, strict=True)],
    }  # fmt: skip
    table = np.empty((count, 4), "<u2")
    table[:, :3] = np.rint((scene.wanted_mm - low) / step)
    width, height = np.rint(scene.width_mm * 100), np.rint(scene.height_mm * 100)
    table[:, 3] = scene.joined + 2 * np.clip(width, 0, 255) + 512 * np.clip(height, 0, 127)
    _write(path, head, [table, _packed_offsets(scene.raw_mm, scene.raw_error_mm)])
    return head


def write_mended(path: Path, scene: Scene) -> None:
    """Pack the mended print, to be shown over `write_wanted`'s.

    Each point has four 16-bit numbers: its offset from the wanted place along x and y, in units of ``unit_mm``, its
    distance from the wanted path in µm, and 0.
    """
    assert scene.mended_mm is not None
    assert scene.mended_error_mm is not None
    head = {"points": len(scene.wanted_mm), "row": ROW, "p95_mm": _p95_mm(scene.mended_error_mm)}
    _write(path, head, [_packed_offsets(scene.mended_mm, scene.mended_error_mm)])


def _packed_offsets(off_mm: np.ndarray, error_mm: np.ndarray) -> np.ndarray:
    """Return offsets in units of `_UNIT_MM` and errors in micrometres, as the page reads them."""
    table = np.zeros((len(off_mm), 4), "<i2")
    table[:, :2] = np.clip(np.rint(off_mm / _UNIT_MM), -32767, 32767)
    table[:, 2] = np.clip(np.rint(error_mm * 1000), 0, 32767)
    return table


def _write(path: Path, head: dict[str, Any], tables: list[np.ndarray]) -> None:
    """Write a packed file: the length of its head, the head in JSON, the tables in whole rows."""
    text = json.dumps(head).encode()
    text += b" " * (-(4 + len(text)) % 4)
    with replacing(path, "wb") as file:
        file.write(len(text).to_bytes(4, "little") + text)
        for table in tables:
            file.write(table.tobytes())
            file.write(bytes(-len(table) % ROW * table.itemsize * 4))


def _p95_mm(error_mm: np.ndarray) -> float | None:
    """Return the 95th percentile of errors, None if there are none."""
    return round(float(np.quantile(error_mm, 0.95)), 4) if len(error_mm) else None


# Small pictures for lists: the lines of a part's longest layer from above, or a smaller copy of a scan or photo.

_MOST_POINTS = 1500
_PHOTO_PX = 320  # longer side of a small picture of a photo
_SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}" fill="none" stroke="#0f9d90" stroke-width="1.3" '
    'stroke-linejoin="round"><path vector-effect="non-scaling-stroke" d="{path}"/></svg>\n'
)


def write_thumb(path: Path, scene: Scene) -> None:
    """Write the layer with the longest path as a picture of lines; write nothing for an empty part."""
    if not len(scene.layer):
        return
    length = np.append(np.hypot(*np.diff(scene.wanted_mm[:, :2], axis=0).T), 0.0) * scene.joined
    of_layer = np.bincount(scene.layer, weights=length)
    points, joined = _thinned(
        scene.wanted_mm[scene.layer == of_layer.argmax(), :2], scene.joined[scene.layer == of_layer.argmax()]
    )
    low, high = points.min(axis=0), points.max(axis=0)
    pad = 0.04 * max(*(high - low), 1.0)
    box = f"{low[0] - pad:.2f} {-high[1] - pad:.2f} {high[0] - low[0] + 2 * pad:.2f} {high[1] - low[1] + 2 * pad:.2f}"
    begun = np.append(True, ~joined[:-1])
    drawn = "".join(f"{'M' if begins else 'L'}{x:.1f} {-y:.1f}" for (x, y), begins in zip(points, begun, strict=True))
    with replacing(path) as file:
        file.write(_SVG.format(box=box, path=drawn))


def write_photo(path: Path, source: Path) -> bool:
    """Write a smaller, upright copy of a scan or photo; return False if it is no image, or too large to be one."""
    from PIL import Image, ImageOps

    from printmend.measure.image import MOST_PIXELS

    with (
        contextlib.suppress(OSError, SyntaxError, ValueError, Image.DecompressionBombError),
        Image.open(source) as image,
    ):
        if image.width * image.height <= MOST_PIXELS:
            image.draft("RGB", (_PHOTO_PX, _PHOTO_PX))  # decodes JPEG at a smaller size
            small = ImageOps.exif_transpose(image).convert("RGB")
            small.thumbnail((_PHOTO_PX, _PHOTO_PX))
            with replacing(path, "wb") as file:
                small.save(file, "JPEG", quality=80)
            return True
    return False


def _thinned(points: np.ndarray, joined: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return about `_MOST_POINTS` of the points; the ends of each bead stay."""
    every = max(1, len(points) // _MOST_POINTS)
    ends = ~joined | np.append(True, ~joined[:-1])
    keep = ends | (np.arange(len(points)) % every == 0)
    return points[keep], joined[keep]
