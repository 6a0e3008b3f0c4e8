"""Bodies from any file as layers of lattice controls: polylines in mm become controls in {−1, 0, 1}² a tick."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from printmend.errors import GcodeError
from printmend.gcode.read import Moves, Program, read_gcode, straightened
from printmend.path import frozen
from printmend.printer import Printer
from printmend_lab.body.kernels import UNITS, count_bound, follow
from printmend_lab.body.slicer import slice_solid, slice_to
from printmend_lab.body.solid import MESH_SUFFIXES
from printmend_lab.path import Body, Layer

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


# A body from any file: a mesh is sliced first, G-code is taken as it is.

MIN_POINTS = 1000  # the paper, §V-C: a body with fewer is an erroneous translation


def load_body(
    path: str | Path,
    printer: Printer,
    *,
    unit: str | None = None,
    cache: Path | None = None,
    note: Callable[[str], None] = lambda text: None,
) -> Body:
    """Return the body in a mesh file (sliced with PrusaSlicer) or a G-code file as layers of lattice controls.

    ``unit`` (mm, cm, m, inch, foot, micron) is for meshes that name none. ``cache`` is a folder that keeps sliced
    G-code, so that a mesh is sliced once. ``note`` is called with one line about each change: a repair, a unit, a shift
    onto the bed. Raises MeshError, GcodeError or MissingToolError for anything that cannot become a body of
    `MIN_POINTS` points on this printer.
    """
    path = Path(path)
    source: str | bytes = str(path)
    if is_mesh(path):
        source = _sliced(path, printer, unit, cache, note)
    return body_of(source, printer, name=path.stem, note=note)


def is_mesh(path: Path) -> bool:
    """Tell a mesh from G-code by its name; a `.gcode.3mf` is a project that holds G-code."""
    return path.suffix.lower() in MESH_SUFFIXES and not path.name.lower().endswith(".gcode.3mf")


def body_of(
    gcode: str | bytes, printer: Printer, *, name: str, note: Callable[[str], None] = lambda text: None
) -> Body:
    """Return the body in a G-code file or its bytes; see `load_body`."""
    strokes = strokes_of(read_gcode(gcode, printer=printer))
    shift = place(strokes, printer, subject=name, note=note)
    body = Body(name, layers_of(strokes, printer, shift_steps=shift, subject=name))
    if body.transitions < MIN_POINTS:
        raise GcodeError(
            name, wanted=f"a body of at least {MIN_POINTS} points (steps of motion)", came=f"{body.transitions}",
            todo="check its size and unit: a circle 1 cm across has as many in three or four layers",
        )  # fmt: skip
    return body


def place(
    strokes: tuple[Stroke, ...], printer: Printer, *, subject: object, note: Callable[[str], None] = lambda text: None
) -> tuple[int, int]:
    """Return the shift [full steps] that brings the strokes onto the bed; zero if they are on it already.

    A file for another printer is moved to the middle of the bed by whole steps, along the axes on which it lies off the
    bed. Raises GcodeError if it is larger than the bed.
    """
    low = np.min([to_steps(stroke.points_mm, printer).min(axis=0) for stroke in strokes], axis=0)
    high = np.max([to_steps(stroke.points_mm, printer).max(axis=0) for stroke in strokes], axis=0)
    bed = np.array(printer.bed_steps)
    if not (high - low <= bed).all():
        size = (high - low) * printer.mm_per_step
        raise GcodeError(
            subject, wanted=f"motion within {printer.x.length_mm:g} × {printer.y.length_mm:g} mm ({printer.name})",
            came=f"{size[0]:.1f} × {size[1]:.1f} mm", todo="give a larger printer, or slice the body for this one",
        )  # fmt: skip
    # A place is on the bed if it rounds to a node of it.
    off = (low < -0.5) | (high >= bed + 0.5)
    shift = np.where(off, np.rint((bed - low - high) / 2), 0).astype(np.int64)
    if off.any():
        by = shift * printer.mm_per_step
        corners = [np.round(corner * printer.mm_per_step, 1).tolist() for corner in (low, high)]
        note(f"moved by {by[0]:+g}, {by[1]:+g} mm onto the bed: the file spans {corners[0]} to {corners[1]} mm")
    return int(shift[0]), int(shift[1])


def _sliced(
    path: Path, printer: Printer, unit: str | None, cache: Path | None, note: Callable[[str], None]
) -> str | bytes:
    from printmend_lab.body.mesh import read_solid  # meshes need a large library, G-code does not

    solid = read_solid(path, unit=unit)
    for text in solid.notes:
        note(text)
    return str(slice_to(solid, printer, cache)) if cache else slice_solid(solid, printer)


# A whole body as one path of three axes: its layers, and the moves in Z and across between them.


@dataclass(frozen=True, eq=False)
class SpacePath:
    """Lattice controls of three axes.

    ``start_steps`` [3] int64, ``controls`` [T, 3] int8 in {−1, 0, 1}: x and y in their full steps, z in its own.
    ``extruding`` [T] bool; ``layer`` [T] int64 is the place in ``body.layers`` of each tick, −1 between layers.
    """

    start_steps: np.ndarray
    controls: np.ndarray
    extruding: np.ndarray
    layer: np.ndarray

    def __post_init__(self) -> None:
        for name, dtype in (("start_steps", np.int64), ("controls", np.int8), ("extruding", bool), ("layer", np.int64)):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), dtype)))

    @property
    def nominal_steps(self) -> np.ndarray:
        """The nominal positions [T + 1, 3], the start included: the ideal print."""
        steps = np.concatenate([self.start_steps[None], self.controls.astype(np.int64)])
        return np.cumsum(steps, axis=0)


def space_path(body: Body, printer: Printer, *, hop_mm: float = 0.0) -> SpacePath:
    """Return the controls of a body of one layer or more, each at its ``z_mm``.

    After a layer the nozzle rises to ``hop_mm`` above the next layer, goes straight to where that layer starts, and
    comes down the hop. Only there Z turns back and its backlash shows.
    """
    heights = [round((layer.z_mm - printer.z.min_mm) / printer.z.mm_per_step) for layer in body.layers]
    hop = round(hop_mm / printer.z.mm_per_step)
    first = body.layers[0]
    pieces: list[tuple[np.ndarray, np.ndarray, int]] = []
    here, height = first.start_steps, heights[0]
    for place, (layer, wanted) in enumerate(zip(body.layers, heights, strict=True)):
        if place > 0:
            points = np.array([here, layer.start_steps], float)
            across = follow_polyline(points, np.zeros(1, bool), subject=body.name)[1]
            travel = [_lift(wanted + hop - height), _flat(across), _lift(-hop)]
            between = np.concatenate(travel)
            pieces.append((between, np.zeros(len(between), bool), -1))
            height = wanted
        pieces.append((_flat(layer.controls), layer.extruding, place))
        here = layer.nominal_steps[-1]
    controls, extruding, places = zip(*pieces, strict=True)
    return SpacePath(
        np.array([*first.start_steps, heights[0]]),
        np.concatenate(controls),
        np.concatenate(extruding),
        np.repeat(places, [len(piece) for piece in controls]),
    )


def _flat(controls: np.ndarray) -> np.ndarray:
    return np.concatenate([controls, np.zeros((len(controls), 1), np.int8)], axis=1)


def _lift(steps: int) -> np.ndarray:
    controls = np.zeros((abs(steps), 3), np.int8)
    controls[:, 2] = np.sign(steps)
    return controls
