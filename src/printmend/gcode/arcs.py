"""Arcs as chords."""

from dataclasses import replace

import numpy as np

from printmend.errors import GcodeError
from printmend.gcode import kernels as k
from printmend.gcode.read import Moves
from printmend.messages import say

_MAX_CHORDS = 20_000_000  # a file of a few lines can ask for endless turns


def straightened(moves: Moves, tolerance_mm: float) -> Moves:
    """Return the moves with every arc replaced by chords that stay within ``tolerance_mm`` of it.

    Extrusion is split in proportion to the length; a helix rises linearly. Moves without arcs come back as they are.
    Raises GcodeError where that takes more than 20 million chords.
    """
    arcs = np.flatnonzero(moves.arcs)
    if len(arcs) == 0:
        return moves
    counts = np.ones(len(moves), np.int64)
    points: list[np.ndarray] = []
    room = _MAX_CHORDS
    for i in arcs:
        chord_points = arc_points(
            moves.start_mm[i], moves.end_mm[i], moves.center_mm[i], int(moves.plane[i]),
            bool(moves.kind[i] == k.KIND_CW), int(moves.turns[i]), tolerance_mm,
        )  # fmt: skip
        points.append(chord_points)
        counts[i] = len(chord_points)
        room -= len(chord_points)
        if room < 0:
            raise GcodeError(
                say("subject-arcs"), wanted=say("most-chords", _MAX_CHORDS), came=say("arcs-need-more"),
                todo=say("check-file-s-radii-turns"),
            )  # fmt: skip
    source = np.repeat(np.arange(len(moves)), counts)
    first = np.concatenate([[0], np.cumsum(counts)])
    end_mm, start_mm = moves.end_mm[source], moves.start_mm[source]
    for i, chord_points in zip(arcs, points, strict=True):
        end_mm[first[i] : first[i + 1]] = chord_points
        start_mm[first[i] + 1 : first[i + 1]] = chord_points[:-1]
    return replace(
        moves,
        line=moves.line[source],
        kind=np.full(len(source), k.KIND_LINEAR, moves.kind.dtype),
        start_mm=start_mm,
        end_mm=end_mm,
        known=moves.known[source],
        center_mm=np.full((len(source), 2), np.nan),
        plane=moves.plane[source],
        turns=np.zeros(len(source), moves.turns.dtype),
        extrusion_mm=moves.extrusion_mm[source] / counts[source],
        feed_mm_s=moves.feed_mm_s[source],
        extruding=moves.extruding[source],
        layer=moves.layer[source],
        home_index=first[moves.home_index],
        event_index=first[moves.event_index],
    )


def arc_points(
    start_mm: np.ndarray, end_mm: np.ndarray, center_mm: np.ndarray, plane: int, clockwise: bool, turns: int,
    tolerance_mm: float,
) -> np.ndarray:  # fmt: skip
    """Return the ends [n, 3] of the chords of one arc, the last of them exactly ``end_mm``."""
    size = k.arc_chords(*start_mm, *end_mm, *center_mm, plane, clockwise, turns, tolerance_mm, np.empty((0, 3)))
    points = np.empty((size, 3))
    k.arc_chords(*start_mm, *end_mm, *center_mm, plane, clockwise, turns, tolerance_mm, points)
    return points
