"""G-code moves become layers of lattice controls: polylines in mm become controls in {−1, 0, 1}² a tick."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from printmend.errors import GcodeError
from printmend.gcode.arcs import straightened
from printmend.gcode.read import Moves, Program
from printmend.path import frozen
from printmend.printer import Printer
from printmend_lab.body.kernels import UNITS, count_bound, follow
from printmend_lab.path import Layer

MAX_TICKS = 200_000_000  # of one body: 400 MB of controls
_MAX_STEPS = 1 << 16  # from the corner of the bed: products of two places in `UNITS` still fit into 64 bits


def to_steps(xy_mm: np.ndarray, printer: Printer) -> np.ndarray:
    """Map bed coordinates [..., 2] in mm to full steps from the bed's lower corner, unrounded."""
    corner = np.array([printer.x.min_mm, printer.y.min_mm])
    return (np.asarray(xy_mm, float) - corner) / np.array(printer.mm_per_step)


def follow_polyline(
    points_steps: np.ndarray, drawing: np.ndarray, *, subject: object = "path", room: int = MAX_TICKS
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (start [2], controls [T, 2] int8, extruding [T]) along way-points [M + 1, 2] in steps.

    ``drawing`` [M] says which segments extrude; each tick carries the flag of its segment. Every visited node is within
    half a step (Euclidean) of that segment, consecutive nodes are 8-neighbours, and no error is carried from one
    segment to the next: see `body.kernels.follow`. Raises GcodeError for places beyond any printer, and if more than
    ``room`` ticks may be needed.
    """
    points_steps = np.asarray(points_steps, float)
    if not (np.abs(points_steps) < _MAX_STEPS).all():
        raise GcodeError(
            subject, wanted=f"coordinates within {_MAX_STEPS} steps of the bed", came="NaN or places beyond",
            todo="check the file's units and offsets",
        )  # fmt: skip
    points = np.rint(points_steps * UNITS).astype(np.int64)
    bound = int(count_bound(points))
    if bound > room:
        raise GcodeError(
            subject, wanted=f"at most {MAX_TICKS} steps of motion", came="more",
            todo="check the file's units, or split it",
        )  # fmt: skip
    controls, extruding = np.empty((bound, 2), np.int8), np.empty(bound, bool)
    ticks, x, y = follow(points, np.ascontiguousarray(drawing, bool), controls, extruding)
    if ticks < 0:  # too small for the lattice: it stays at the node of its first point
        return (points[0] + UNITS // 2) // UNITS, controls[:0], extruding[:0]
    return np.array([x, y], np.int64), controls[:ticks].copy(), extruding[:ticks].copy()


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
        _stroke(moves, first, extruding[first:last], int(layer[first]))
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
    """Return the strokes as lattice controls, shifted by whole steps; layers too small for one step are left out.

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


def _stroke(moves: Moves, first: int, extruding: np.ndarray, index: int) -> Stroke:
    """Build the stroke of the moves from ``first`` on; ``extruding`` says which of them extrude."""
    printing = first + np.flatnonzero(extruding)
    z_mm = float(moves.end_mm[printing[0], 2])
    rows = np.arange(printing[0], printing[-1] + 1)
    start, end = moves.start_mm[rows, :2], moves.end_mm[rows, :2]
    drawing = extruding[rows - first]
    # A move that does not begin at the last one's end (homing, a restored position) follows a travel to its start.
    jumped = np.flatnonzero((start[1:] != end[:-1]).any(axis=1)) + 1
    points = np.insert(end, jumped, start[jumped], axis=0)
    drawing = np.insert(drawing, jumped, False)
    points = np.vstack([start[:1], points])
    moved = (points[1:] != points[:-1]).any(axis=1)
    return Stroke(index, z_mm, points[np.concatenate([[True], moved])], drawing[moved])
