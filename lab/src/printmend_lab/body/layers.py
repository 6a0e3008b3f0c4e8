"""G-code moves become layers of lattice controls."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from printmend.errors import GcodeError
from printmend.gcode.arcs import straightened
from printmend.gcode.read import Moves, Program
from printmend.path import Layer, frozen
from printmend.printer import Printer
from printmend_lab.body.lattice import MAX_TICKS, follow_polyline, to_steps

_CHORD_MM = 0.002  # a hundredth of a step of the usual printers


@dataclass(frozen=True, eq=False)
class Stroke:
    """One layer's path over the bed: way-points ``points_mm`` [M + 1, 2]; ``drawing`` [M] says which segments extrude.

    It begins with the layer's first extruding move and ends with its last; the travels between are in it.
    """

    index: int
    z_mm: float
    points_mm: np.ndarray
    drawing: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "points_mm", frozen(self.points_mm))
        object.__setattr__(self, "drawing", frozen(self.drawing))


def strokes_of(program: Program) -> tuple[Stroke, ...]:
    """Return the path of every layer that extrudes. A program that never extrudes (a plotter's, a mill's) is one
    layer in which every move draws.

    Raises GcodeError where nothing moves over the bed.
    """
    moves = straightened(program.moves, _CHORD_MM)
    extruding, layer = moves.extruding, moves.layer
    if not extruding.any():
        extruding, layer = np.ones(len(moves), bool), np.zeros(len(moves), np.int64)
    # Layers are numbered in the order of the file, so each is one run of moves.
    bounds = [*np.flatnonzero(np.diff(layer, prepend=-2)).tolist(), len(layer)]
    strokes = [
        _stroke(moves, first, last, extruding[first:last], int(layer[first]))
        for first, last in pairwise(bounds)
        if layer[first] >= 0 and extruding[first:last].any()
    ]
    moving = tuple(stroke for stroke in strokes if len(stroke.drawing))
    if not moving:
        raise GcodeError(
            program.name, wanted="G-code with motion over the bed", came="none in X or Y", todo="give a sliced file"
        )
    return moving


def layers_of(
    strokes: tuple[Stroke, ...], printer: Printer, *, shift_steps: tuple[int, int] = (0, 0), subject: object = "path"
) -> tuple[Layer, ...]:
    """Return the strokes as lattice controls, moved by whole steps; layers too small for one step are left out.

    Raises GcodeError above `MAX_TICKS` steps of motion.
    """
    layers: list[Layer] = []
    room = MAX_TICKS
    for stroke in strokes:
        points = to_steps(stroke.points_mm, printer) + np.asarray(shift_steps)
        start, controls, extruding = follow_polyline(points, stroke.drawing, subject=subject, room=room)
        room -= len(controls)
        if extruding.any():
            layers.append(Layer(stroke.index, stroke.z_mm, start, controls, extruding))
    return tuple(layers)


def _stroke(moves: Moves, first: int, last: int, extruding: np.ndarray, index: int) -> Stroke:
    """Build the stroke of moves first…last − 1; ``extruding`` belongs to them."""
    printing = first + np.flatnonzero(extruding)
    z_mm = float(moves.end_mm[printing[0], 2])
    rows = np.arange(printing[0], printing[-1] + 1)
    start, end = moves.start_mm[rows, :2], moves.end_mm[rows, :2]
    drawing = extruding[rows - first]
    # Where a move does not begin at the last one's end (homing, a restored position) the carriage went there: a travel.
    jumped = np.flatnonzero((start[1:] != end[:-1]).any(axis=1)) + 1
    points = np.insert(end, jumped, start[jumped], axis=0)
    drawing = np.insert(drawing, jumped, False)
    points = np.vstack([start[:1], points])
    moved = (points[1:] != points[:-1]).any(axis=1)
    return Stroke(index, z_mm, points[np.concatenate([[True], moved])], drawing[moved])
