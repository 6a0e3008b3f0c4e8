"""Find the walls of one layer of a file: bead sides with air beside them, whose printed place a scan can show.

Every wall place is a way-point of the motion: the rows of the trace are the commanded way-points since homing, with
further rows inserted on the layer's straight moves. A *wall place* is one side of a bead with air beside it.
"""

import math
import re
from dataclasses import dataclass

import cv2
import numpy as np

from printmend.errors import GcodeError
from printmend.gcode.read import Moves, Program, straightened
from printmend.messages import say, say_count
from printmend.path import Trace
from printmend.printer import Printer

STEP_MM = 1.2  # distance between the places of a wall
RASTER_MM = 0.06  # side of a pixel of the drawn layer
CHORD_MM = 0.02  # how far an arc's chords may lie from it
OPEN_MM = (0.15, 0.45, 0.8)  # distances from a bead at which there must be air beside it
GAP_MM = 0.5  # narrower gaps between beads close in print
BLOB_MM = 1.2  # length at the start and at the end of a path where a bead is too thick or too thin
CORNER_MM, CORNER_RAD = 0.9, 0.7  # a corner is where a path turns by more than this angle within this distance
FILAMENTS_MM = (1.75, 2.85)  # diameters, the likelier first
USUAL_BEAD_MM, BEAD_RANGE_MM = 0.45, (0.2, 1.6)  # a bead's width if the file's E gives none in the range
LEAST_PLACES = 60  # fewest visible wall places that can be measured
LEAST_PART_MM2 = 20.0  # a piece with a smaller area is no part
SKIRT_MM = 2.5  # width of the broadest skirt
_TYPE = re.compile(rb"^;[ \t]*(?:TYPE:|FEATURE:|FEATURE )[ \t]*([^\r\n]+)", re.MULTILINE | re.IGNORECASE)
_NO_PART = re.compile(r"skirt|brim|raft|support|custom|prime|purge|wipe|tower", re.IGNORECASE)
_NAMED = re.compile(r"skirt|brim|raft|support|tower")  # features that an owner can switch off
_RAFT_LAYER = re.compile(rb"^;LAYER:-\d", re.MULTILINE)


@dataclass(frozen=True, eq=False)
class Walls:
    """One layer as a scan may show it.

    ``commanded_mm`` [N, 2] are all way-points from homing to the layer's last wall, the first the home position;
    ``layer`` is the walls' layer, from 1. For each wall place: its ``row`` [S], in the order of motion; ``normal``
    [S, 2], the direction out of the plastic; ``half_mm`` [S], half the bead's width. ``plastic`` [H, W] bool is the
    layer seen from above at ``RASTER_MM`` a pixel. Its row 0 is at the lowest y, its first pixel's centre at
    ``corner_mm`` [2]. ``layers`` is the file's number of layers, ``tall_mm`` the print's height, and ``height_mm``
    this layer's height.
    """

    commanded_mm: np.ndarray
    homed: bool
    row: np.ndarray
    normal: np.ndarray
    half_mm: np.ndarray
    plastic: np.ndarray
    corner_mm: np.ndarray
    layer: int
    layers: int
    tall_mm: float
    height_mm: float = 0.2

    def trace(self, offset_mm: np.ndarray, sigma_mm: np.ndarray) -> Trace:
        """Return the motion's trace, given each wall place's measured offset [S] along its normal, NaN if not measured.

        A place with both sides in the open has two rows.
        """
        rows = np.sort(np.concatenate([np.arange(len(self.commanded_mm)), self.row[_second(self.row)]]))
        commanded = self.commanded_mm[rows]
        at = np.searchsorted(rows, self.row, side="left") + _second(self.row)
        normals, offsets, sigmas = (np.full(shape, np.nan) for shape in (commanded.shape, len(rows), len(rows)))
        seen = np.isfinite(offset_mm)
        normals[at[seen]], offsets[at[seen]], sigmas[at[seen]] = self.normal[seen], offset_mm[seen], sigma_mm[seen]
        return Trace(
            commanded, np.full(commanded.shape, np.nan), sigma_mm=sigmas, homed=self.homed, placed=False,
            normal=normals, offset_mm=offsets,
        )  # fmt: skip


def _second(row: np.ndarray) -> np.ndarray:
    """Mark the places [S] that share their row with the one before."""
    return np.concatenate([[False], row[1:] == row[:-1]])


def read_walls(program: Program, printer: Printer, *, layer: int = 1) -> Walls:
    """Return the walls of a layer of a file, counted from 1.

    Raises `GcodeError` for a layer that the file does not have, that is only a raft, brim or skirt, or whose walls are
    too short to measure.
    """
    moves = straightened(program.moves, CHORD_MM)
    index, layers, has_skirt = _layer_of(program, moves, layer)
    path, part_of, homed = _waypoints(moves, printer, moves.extruding & (moves.layer == index))
    printed = np.flatnonzero(moves.extruding & (moves.layer == index) & (part_of >= 0))
    start, end = np.array(moves.start_mm[printed, :2]), np.array(moves.end_mm[printed, :2])
    length = np.hypot(*(end - start).T)
    long = length > 1e-6
    printed, start, end, length = printed[long], start[long], end[long], length[long]
    high = _height(moves, index)
    width = _widths(moves, printed, length, high)
    plastic, corner = _drawn(start, end, width)
    plastic = _parts(plastic, has_skirt=has_skirt)
    place = _places(printed, start, end, length)
    half = width[place.move] / 2
    keep, normals = [], []
    for side in (1.0, -1.0):
        out = np.stack([-place.along[:, 1], place.along[:, 0]], axis=1) * side
        normals.append(out)
        keep.append(place.straight & _open(plastic, corner, place.at_mm, out, half))
    either = keep[0] | keep[1]
    if either.sum() < LEAST_PLACES:
        raise GcodeError(
            program.name, wanted=say("layer-walls-scan-can-show", layer), came=say("hardly-any"),
            todo=say("choose-part-least-30-mm-outline"),
        )  # fmt: skip
    commanded, rows = _with_places(path, part_of, printed, place, either)
    commanded = commanded[: rows.max() + 1]  # the layers above do not matter
    both = [np.flatnonzero(one[either]) for one in keep]
    order = np.argsort(np.concatenate(both), kind="stable")
    which = np.concatenate(both)[order]
    left = np.repeat([True, False], [len(one) for one in both])[order]
    normal = np.where(left[:, None], normals[0][either][which], normals[1][either][which])
    tall = float(moves.end_mm[moves.extruding & (moves.layer >= 0), 2].max())
    return Walls(commanded, homed, rows[which], normal, half[either][which], plastic, corner, layer, layers, tall, high)


def _layer_of(program: Program, moves: Moves, layer: int) -> tuple[int, int, bool]:
    """Return the layer's own number, the number of layers, and whether the slicer marks a skirt. Raises `GcodeError`
    if the layer holds no part."""
    numbers = np.unique(moves.layer[moves.extruding & (moves.layer >= 0)])
    if not 1 <= layer <= len(numbers):
        raise GcodeError(
            program.name,
            wanted=say("layer", layer),
            came=say_count("so-many-layers", len(numbers)),
            todo=say("say-another-layer"),
        )
    index = int(numbers[layer - 1])
    lines = moves.line[moves.layer == index]
    ends = np.flatnonzero(program.text == ord("\n"))
    first = int(ends[lines.min() - 1]) if 0 < lines.min() <= len(ends) else 0
    last = int(ends[lines.max()]) if lines.max() < len(ends) else len(program.text)
    ahead = program.text[max(0, first - 400) : last].tobytes()
    kinds = [kind.decode("utf-8", "replace").strip() for kind in _TYPE.findall(ahead)]
    raft = layer == 1 and _RAFT_LAYER.search(program.text[: last + 1].tobytes()) is not None
    said = [kind for kind in kinds if kind.lower() != "custom"]  # any program may label its lines so
    if raft or (said and all(_NO_PART.search(kind) for kind in kinds)):
        came = say("a-raft") if raft else ", ".join(sorted(set(kinds))).lower()
        named = sorted(set(_NAMED.findall(came)))
        raise GcodeError(
            program.name, wanted=say("part-in-layer", layer), came=say("only", came),
            todo=say("slice-without-scan-name-higher-layer", " / ".join(named) or came),
        )  # fmt: skip
    return index, len(numbers), any("skirt" in kind.lower() for kind in kinds)


def _waypoints(moves: Moves, printer: Printer, printed: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
    """Return the way-points [N, 2] since the last homing of X and Y that a ``printed`` [M] move follows, the way-point
    [M] at each move's end (−1 if unknown or earlier), and whether the first way-point is the home position."""
    home = np.array(printer.home_mm)
    first = 0
    for index, axes in zip(moves.home_index, moves.home_axes, strict=True):
        at = moves.start_mm[index, :2] if index < len(moves) else home
        if axes[:2].any() and np.array_equal(at, home) and printed[index:].any():
            first = int(index)
    known = moves.known[:, :2].all(axis=1) & (np.arange(len(moves)) >= first)
    moved = known & (moves.end_mm[:, :2] != moves.start_mm[:, :2]).any(axis=1)
    if not moved.any():
        raise GcodeError("G-code", wanted=say("moves-from-known-place"), came=say("none"), todo=say("home-g28-first"))
    start, end = moves.start_mm[moved, :2], moves.end_mm[moved, :2]
    jumps = (start != np.vstack([home, end[:-1]])).any(axis=1)  # a macro went there
    ends = np.cumsum(1 + jumps)
    points, row_of = np.empty((1 + ends[-1], 2)), np.full(len(moves), -1)
    points[0], points[ends], points[ends[jumps] - 1] = home, end, start[jumps]
    row_of[moved] = ends
    return points, row_of, True


def _height(moves: Moves, index: int) -> float:
    """Return the height [mm] of a layer, 0.2 if the file does not show it."""
    z = np.array([np.median(moves.end_mm[moves.extruding & (moves.layer == one), 2]) for one in (index, index - 1)
                  if (moves.extruding & (moves.layer == one)).any()])  # fmt: skip
    height = float(z[0] - z[1]) if len(z) > 1 else float(z[0])
    return height if 0.05 <= height <= 1.0 else 0.2


def _widths(moves: Moves, printed: np.ndarray, length_mm: np.ndarray, height_mm: float) -> np.ndarray:
    """Return the widths [M] of beads, whose sections are rectangles with round ends, as slicers compute them."""
    for filament in FILAMENTS_MM:
        area = moves.extrusion_mm[printed] * math.pi * filament**2 / 4 / length_mm
        width = area / height_mm + height_mm * (1 - math.pi / 4)
        if filament == FILAMENTS_MM[-1] or BEAD_RANGE_MM[0] < np.median(width) < BEAD_RANGE_MM[1]:
            break
    if not BEAD_RANGE_MM[0] < np.median(width) < BEAD_RANGE_MM[1]:
        return np.full(len(width), USUAL_BEAD_MM)
    return np.clip(width, *BEAD_RANGE_MM)


def _drawn(start: np.ndarray, end: np.ndarray, width: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Draw beads: return their plastic [H, W] and the place [2] mm of its first pixel."""
    margin = 3.0
    corner = np.minimum(start.min(axis=0), end.min(axis=0)) - margin
    size = np.ceil((np.maximum(start.max(axis=0), end.max(axis=0)) + margin - corner) / RASTER_MM).astype(int)
    plastic = np.zeros((size[1], size[0]), np.uint8)
    fine = 16.0  # OpenCV draws in sixteenths of a pixel with shift=4
    a, b = (np.rint((points - corner) / RASTER_MM * fine).astype(int) for points in (start, end))
    thick = np.maximum(np.rint(width / RASTER_MM).astype(int), 1)
    for one, other, wide in zip(a.tolist(), b.tolist(), thick.tolist(), strict=True):
        cv2.line(plastic, one, other, 1, wide, cv2.LINE_8, 4)
    closing = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (round(GAP_MM / RASTER_MM) | 1,) * 2)
    return cv2.morphologyEx(plastic, cv2.MORPH_CLOSE, closing).astype(bool), corner


def _parts(plastic: np.ndarray, *, has_skirt: bool) -> np.ndarray:
    """Return the plastic without skirts and purge lines: pieces that surround others, or are very small.

    A skirt around a small part has a larger area than the part. So if the layer has a skirt, any piece that surrounds
    another and is as thin as a skirt counts as one.
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats(plastic.astype(np.uint8), connectivity=8)
    areas = stats[:, cv2.CC_STAT_AREA] * RASTER_MM**2
    keep, skirts = np.zeros(count, bool), np.zeros(count, bool)
    filled = {}
    for one in range(1, count):
        outline, _ = cv2.findContours((labels == one).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        filled[one] = max(outline, key=len)
    for one in range(1, count):
        around = sum(
            areas[other] for other in range(1, count) if other != one
            and cv2.pointPolygonTest(filled[one], tuple(map(float, filled[other][0, 0])), False) > 0
        )  # fmt: skip
        wide_mm = areas[one] / (cv2.arcLength(filled[one], True) * RASTER_MM)
        skirts[one] = around >= areas[one] / 2 or (has_skirt and around > 0 and wide_mm < SKIRT_MM)
        keep[one] = areas[one] >= LEAST_PART_MM2 and not skirts[one]
    if not keep.any():
        keep[1:] = ~skirts[1:]
    return keep[labels]


@dataclass(frozen=True, eq=False)
class _Places:
    """Places on printed moves: the ``move`` [S] of each, its ``share`` [S] of the way, ``at_mm`` and the direction
    ``along`` [S, 2]; ``straight`` [S] is False near corners and ends."""

    move: np.ndarray
    share: np.ndarray
    at_mm: np.ndarray
    along: np.ndarray
    straight: np.ndarray


def _places(printed: np.ndarray, start: np.ndarray, end: np.ndarray, length: np.ndarray) -> _Places:
    """Return places every `STEP_MM` along each unbroken path, and mark those that are neither corners nor ends."""
    broken = np.concatenate([[True], (start[1:] != end[:-1]).any(axis=1) | (np.diff(printed) > 1)])
    path = np.cumsum(broken) - 1
    travelled = np.concatenate([[0.0], np.cumsum(length)])
    begin = travelled[:-1][broken]
    finish = np.append(begin[1:], travelled[-1])
    at = np.concatenate([
        np.arange(low + STEP_MM / 2, high, STEP_MM) for low, high in zip(begin, finish, strict=True)
    ])  # fmt: skip
    move = np.clip(np.searchsorted(travelled, at, side="right") - 1, 0, len(length) - 1)
    low, high = begin[path[move]], finish[path[move]]

    def point(where: np.ndarray) -> np.ndarray:
        where = np.clip(where, low, high)
        k = np.clip(np.searchsorted(travelled, where, side="right") - 1, 0, len(length) - 1)
        k = np.where(path[k] == path[move], k, move)
        share = np.clip((where - travelled[k]) / length[k], 0.0, 1.0)[:, None]
        return start[k] + share * (end[k] - start[k])

    here = point(at)
    ahead, behind = point(at + CORNER_MM) - here, here - point(at - CORNER_MM)
    turn = np.abs(np.arctan2(ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0], (ahead * behind).sum(axis=1)))
    along = point(at + STEP_MM / 2) - point(at - STEP_MM / 2)
    along /= np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    straight = (turn < CORNER_RAD) & (at - low > BLOB_MM) & (high - at > BLOB_MM)
    return _Places(move, (at - travelled[move]) / length[move], here, along, straight)


def _open(
    plastic: np.ndarray, corner: np.ndarray, at_mm: np.ndarray, out: np.ndarray, half_mm: np.ndarray
) -> np.ndarray:
    """Mark the places [S] with plastic inside their bead and only air along ``out`` [S, 2]."""

    def there(reach_mm: np.ndarray) -> np.ndarray:
        pixel = np.rint((at_mm + reach_mm[:, None] * out - corner) / RASTER_MM).astype(int)
        pixel = np.clip(pixel, 0, np.array(plastic.shape[::-1]) - 1)
        return plastic[pixel[:, 1], pixel[:, 0]]

    opened = there(0.5 * half_mm)
    for reach in OPEN_MM:
        opened &= ~there(half_mm + reach)
    return opened


def _with_places(
    path: np.ndarray, row_of: np.ndarray, printed: np.ndarray, place: _Places, wanted: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Insert the wanted places into the way-points; return these and the row [S] of each place."""
    move, share, at = place.move[wanted], place.share[wanted], place.at_mm[wanted]
    key = row_of[printed[move]] - 1 + np.clip(share, 1e-6, 1 - 1e-6)
    order = np.argsort(np.concatenate([np.arange(len(path)), key]), kind="stable")
    rows = np.empty(len(order), np.int64)
    rows[order] = np.arange(len(order))
    return np.concatenate([path, at])[order], rows[len(path) :]
