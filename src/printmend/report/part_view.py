"""Show what an owner checks before printing: whether the part stays on the bed, where seams are, and how it looks.

Both files are read again, and the model prints one layer, as it is and mended.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from printmend.gcode.read import Moves, read_gcode, straightened
from printmend.machine import Mechanism
from printmend.machine.printing import print_from_home

MOST_BYTES = 80_000_000  # a larger file is not read again
_PITCH_MM = 0.4  # path length between two drawn places
_CHORD_MM = 0.002  # how far an arc's chords may lie from it
_SEAM_MM = 1.5  # a shorter move without plastic amid a path takes up slack
_BEFORE = 400  # moves printed before a layer, so that its play is engaged


@dataclass(frozen=True, eq=False)
class DrawnLayer:
    """A layer's beads, ``lines`` [K] of [N, 2] mm as printed, and the error of each [K] mm."""

    lines: Sequence[np.ndarray]
    off_mm: np.ndarray


@dataclass(frozen=True, eq=False)
class PartView:
    """The mended file beside its original.

    ``low_mm`` and ``high_mm`` [2] are the corners of all commanded moves. ``layer`` (from 0) is the drawn one;
    ``seams_mm`` [K, 2] are the places in it where the nozzle stops while a belt turns back.
    """

    low_mm: np.ndarray
    high_mm: np.ndarray
    layer: int
    z_mm: float
    before: DrawnLayer
    after: DrawnLayer
    seams_mm: np.ndarray


def look_at(
    source: Path, output: Path, mechanism: Mechanism, *, shift_mm: tuple[float, float] = (0.0, 0.0),
    doubt_mm: tuple[float, float] = (0.0, 0.0),
) -> PartView | None:  # fmt: skip
    """Return the view of a mended file; None if it is too large, prints nothing, or counts layers differently.

    ``shift_mm`` is the shift of the whole unmended print. The figures leave it out, because the print's place on the
    bed is unknown; the drawing leaves it out, too. ``doubt_mm`` is what else the figures contain, before and after.
    """
    if max(source.stat().st_size, output.stat().st_size) > MOST_BYTES:
        return None
    printer = mechanism.printer
    wanted, given = (straightened(read_gcode(path, printer=printer).moves, _CHORD_MM) for path in (source, output))
    if wanted.layer.max(initial=-1) != given.layer.max(initial=-1):
        return None  # with a bad screw or a rising path the two files count layers differently
    told = given.known[:, :2].all(axis=1)
    drawn = wanted.extruding & wanted.known[:, :2].all(axis=1) & (wanted.layer >= 0)
    if not drawn.any() or not told.any():
        return None
    layer = _fullest(wanted, drawn)
    mine = drawn & (wanted.layer == layer)
    tree = shapely.STRtree(shapely.linestrings(np.stack([wanted.start_mm[mine, :2], wanted.end_mm[mine, :2]], axis=1)))
    before, after = (_walked(moves, layer, mechanism) for moves in (wanted, given))
    ends = np.concatenate([given.start_mm[told], given.end_mm[told]])[:, :2]
    drawn_before = _printed(wanted, layer, before, tree, doubt_mm[0], shift_mm)
    drawn_after = _printed(given, layer, after, tree, doubt_mm[1])
    return PartView(
        ends.min(axis=0), ends.max(axis=0), layer,
        float(np.median(wanted.end_mm[mine, 2])), drawn_before, drawn_after, _new_seams(wanted, given, layer, after),
    )  # fmt: skip


def _fullest(moves: Moves, drawn: np.ndarray) -> int:
    """Return the layer with the longest path in the part's middle half: it shows most."""
    length = np.linalg.norm((moves.end_mm - moves.start_mm)[:, :2], axis=1) * drawn
    paths = np.bincount(moves.layer[drawn], weights=length[drawn])
    inner = slice(len(paths) // 4, max(len(paths) - len(paths) // 4, 1))
    return int(inner.start + np.argmax(paths[inner]))


@dataclass(frozen=True, eq=False)
class _Walk:
    """A layer's moves on the learned machine: ``of`` [N] is the move of each place, ``places`` [N, 3] its commanded and
    ``printed_mm`` [N, 2] its printed position."""

    of: np.ndarray
    places: np.ndarray
    printed_mm: np.ndarray


def _walked(moves: Moves, layer: int, mechanism: Mechanism) -> _Walk:
    """Print a layer of a file, and enough moves before it that its play is engaged."""
    mine = np.flatnonzero(moves.layer == layer)
    chosen = np.arange(max(mine[0] - _BEFORE, 0), mine[-1] + 1) if len(mine) else mine
    start, end = moves.start_mm[chosen], moves.end_mm[chosen]
    count = np.maximum(np.ceil(np.linalg.norm((end - start)[:, :2], axis=1) / _PITCH_MM), 1).astype(np.int64)
    of = np.repeat(np.arange(len(chosen)), count)
    step = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count) + 1
    places = start[of] + (step / count[of])[:, None] * (end - start)[of]
    printed = print_from_home(mechanism, places)[:, :2] if len(places) else places[:, :2]
    return _Walk(chosen[of], places, printed)


def _printed(
    moves: Moves, layer: int, walk: _Walk, wanted: shapely.STRtree, doubt_mm: float,
    shift_mm: tuple[float, float] = (0.0, 0.0),
) -> DrawnLayer:  # fmt: skip
    """Measure a printed layer's distance from the wanted lines, without the common shift but with the doubt."""
    if not len(walk.of):
        return DrawnLayer([], np.zeros(0))
    printed = walk.printed_mm - np.array(shift_mm)
    bead = (moves.extruding & (moves.layer == layer))[walk.of] & np.isfinite(printed).all(axis=1)
    bead[0] = False
    begin, last = np.flatnonzero(bead) - 1, np.flatnonzero(bead)
    points = shapely.points((printed[begin] + printed[last]) / 2)
    off = np.zeros(len(points))
    (at, _), found = wanted.query_nearest(points, return_distance=True, all_matches=False)
    off[at] = found
    return DrawnLayer(list(np.stack([printed[begin], printed[last]], axis=1)), np.hypot(off, doubt_mm))


def _new_seams(wanted: Moves, given: Moves, layer: int, walk: _Walk) -> np.ndarray:
    """Return the printed places [K, 2] of the stops that mending added to a layer; some slicers write stops, too."""
    old, stops = wanted.start_mm[_stops(wanted, layer), :2], _stops(given, layer)
    new = walk.printed_mm[np.searchsorted(walk.of, stops) - 1] if len(stops) else np.empty((0, 2))
    if not len(old) or not len(new):
        return new
    near, _ = shapely.STRtree(shapely.points(old)).query(shapely.points(new), predicate="dwithin", distance=_SEAM_MM)
    return np.delete(new, near, axis=0)


def _stops(moves: Moves, layer: int) -> np.ndarray:
    """Return the moves [K] of a layer in which the nozzle stands still amid a path, to take up slack."""
    extruding = moves.extruding & (moves.layer == layer)
    length = np.linalg.norm((moves.end_mm - moves.start_mm)[:, :2], axis=1)
    short = ~moves.extruding & (length > 0) & (length < _SEAM_MM) & (moves.extrusion_mm == 0)
    inside = np.zeros(len(moves), bool)
    inside[1:-1] = short[1:-1] & extruding[:-2] & extruding[2:]
    return np.flatnonzero(inside)
