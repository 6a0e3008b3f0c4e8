"""Print G-code on the twin: return what a measurement of the print would give."""

from pathlib import Path

import numpy as np

from printmend.errors import GcodeError, InputError
from printmend.gcode.read import Program, read_gcode, straightened
from printmend.machine.mechanism import Mechanism
from printmend.measure.plan import ProbePlan
from printmend.messages import say
from printmend.path import Origin, Trace
from printmend.twin.twin import Twin

_CHORD_MM, _FINE_CHORD_MM = 0.01, 0.005  # error of an arc's chords: for a trace, and point by point
_PITCH_MM = 0.3  # distance of points along a move that is followed finely
_SAME_MM = 0.01  # way-points that differ by less are the same: the file's resolution
_MENDED_MM = 5.0  # no mended dot is commanded farther than this from its wanted place


def print_gcode(
    program: Program | str | Path, twin: Twin, *, noise_mm: float = 0.0, rng: np.random.Generator | None = None
) -> Trace:
    """Print a G-code file on the twin and measure it with normal noise of ``noise_mm`` on each coordinate.

    The trace has one row for each way-point since the last homing of X and Y, the first being the home position. Chords
    of arcs are way-points. On a machine with a bad Z screw heights are measured too, and a move of Z alone is a
    way-point. A file that never homes is printed as if it had just been homed. A `Program` must have been read with the
    twin's printer. ``rng`` draws the noise; without it every run draws the same. Raises `GcodeError` if the file never
    says where the head is.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    if not isinstance(program, Program):
        program = read_gcode(program, printer=twin.printer)
    moves = straightened(program.moves, _CHORD_MM)
    home = np.array(twin.printer.home_mm)
    start = 0
    for index, axes in zip(moves.home_index, moves.home_axes, strict=True):
        at = moves.start_mm[index, :2] if index < len(moves) else home
        if axes[:2].any() and np.array_equal(at, home):
            start = int(index)
    known = np.asarray(moves.known[:, :2].all(axis=1) & (np.arange(len(moves)) >= start))
    begins, ends, layers = moves.start_mm[known], moves.end_mm[known], moves.layer[known]
    path = np.concatenate([home[None], ends[:, :2]])
    # If a move does not begin at the last one's end, the head went there by itself: one axis homed, or a macro ran.
    jumped = (path[:-1] != begins[:, :2]).any(axis=1)
    rows = np.sort(np.concatenate([np.flatnonzero(jumped) - 0.5, np.arange(len(ends))]))
    at = np.ceil(rows).astype(np.int64)
    places = np.where((rows == at)[:, None], ends[at], begins[at])
    path = np.concatenate([home[None], places[:, :2]])
    moved = np.concatenate([[True], (np.diff(path, axis=0) != 0).any(axis=1)])
    screw = isinstance(twin.mechanism, Mechanism) and twin.mechanism.screw is not None
    if screw and moved.any():  # after going up and down again, the nut ends on the other flank of the thread
        rose = np.diff(places[:, 2], prepend=np.nan)
        moved[1:] |= np.isfinite(rose) & (rose != 0)
    if moved.sum() < 2:
        raise GcodeError(
            program.name, wanted=say("moves-from-known-place"), came=say("none"), todo=say("home-g28-first")
        )
    waypoints, places, at = path[moved], places[moved[1:]], at[moved[1:]]
    z_mm, layer = places[:, 2], layers[at]
    home_z_mm = twin.printer.z.home_mm
    heights_mm = np.concatenate([[home_z_mm], np.where(np.isnan(z_mm), home_z_mm, z_mm)])
    printed = twin.seen(np.column_stack([waypoints, heights_mm]))
    measured = printed[:, :2]
    if noise_mm > 0:
        measured = measured + rng.normal(0.0, noise_mm, measured.shape)
    z_measured_mm = None
    if screw:
        z_measured_mm = printed[:, 2] + (rng.normal(0.0, noise_mm, len(printed)) if noise_mm > 0 else 0.0)
    return Trace(
        commanded_mm=waypoints,
        measured_mm=measured,
        z_mm=np.concatenate([[home_z_mm] if screw else z_mm[:1], z_mm]),
        layer=np.concatenate([[-1], layer]),
        homed=True,
        z_measured_mm=z_measured_mm,
        origin=Origin(twin.printer.name, twin.printer.kinematics),
    )


def follow_finely(program: Program, twin: Twin) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Print a program on the twin, point by point along every move. It must home once, before it extrudes.

    Returns the wanted points [N, 2] mm, where the machine put them [N, 2] mm, and for each segment between them whether
    it extrudes [N − 1] and its layer [N − 1].
    """
    moves = straightened(program.moves, _FINE_CHORD_MM)
    known = moves.known[:, :2].all(axis=1)
    ends, extruding, layer = moves.end_mm[known, :2], moves.extruding[known], moves.layer[known]
    corners = np.concatenate([[twin.printer.home_mm], ends])
    counts = np.maximum(1, np.ceil(np.linalg.norm(np.diff(corners, axis=0), axis=1) / _PITCH_MM)).astype(int)
    source = np.repeat(np.arange(len(ends)), counts)
    last = np.cumsum(counts)
    share = (np.arange(len(source)) + 1 - np.repeat(last - counts, counts)) / counts[source]
    points = corners[source] + share[:, None] * (ends - corners[:-1])[source]
    points[last - 1] = ends  # exactly, without rounding
    wanted = np.concatenate([corners[:1], points])
    return wanted, twin.follow(wanted), extruding[source], layer[source]


def print_first_layer(program: Program, twin: Twin) -> list[np.ndarray]:
    """Print a part on the twin; return the strokes [K × [N, 2]] mm of its first layer where an instrument sees them."""
    wanted, printed, extruding, layer = follow_finely(program, twin)
    printed = printed + twin.misread_mm(wanted)
    drawn = extruding & (layer == layer[extruding & (layer >= 0)].min(initial=np.iinfo(layer.dtype).max))
    if not drawn.any():
        raise GcodeError(
            program.name, wanted=say("part-printed"), came=say("no-extruding-move"), todo=say("check-file")
        )
    cuts = np.flatnonzero(np.diff(np.concatenate([[False], drawn, [False]]).astype(int)))
    return [printed[first : last + 1] for first, last in zip(cuts[::2], cuts[1::2], strict=True)]


def print_line(program: Program, twin: Twin, plan: ProbePlan) -> np.ndarray | None:
    """Return where the lines at speed of a probe land [N, 2] mm, None for a plan without any."""
    return print_first_layer(program, twin)[-1] if plan.moving else None


def print_dots(program: Program, twin: Twin, plan: ProbePlan) -> np.ndarray:
    """Print a probe, as written or mended, on the twin; return where its dots land [M, 2].

    Raises `InputError` for a file that is not this plan's.
    """
    trace = print_gcode(program, twin)
    if len(trace) == len(plan.waypoints_mm) and np.abs(trace.commanded_mm - plan.waypoints_mm).max() <= _SAME_MM:
        return trace.measured_mm[plan.rows]
    # a mended file has other way-points; a dot is extruded at rest, at the last way-point
    moves = program.moves
    standing = (moves.start_mm[:, :2] == moves.end_mm[:, :2]).all(axis=1)
    rests = np.flatnonzero(standing & (moves.extrusion_mm > 0) & moves.known[:, :2].all(axis=1))
    path = moves.end_mm[rests, :2]
    fresh = np.append(True, (path[1:] != path[:-1]).any(axis=1))[: len(path)]
    rests, path = rests[fresh], path[fresh]
    if plan.moving:  # the lines at speed come last, and may begin with an extrusion at rest
        rests, path = rests[: len(plan)], path[: len(plan)]
    if len(path) != len(plan) or np.abs(path - plan.marks_mm).max() > _MENDED_MM:
        raise InputError(
            say("subject-printed-file"), wanted=say("probe-plan-dots-what-mend-made", len(plan)),
            came=say("file-dots-others", len(path)),
            todo=say("terminal-print-g-code-was-written-together"),
        )  # fmt: skip
    commanded = np.concatenate([[twin.printer.home_mm], moves.end_mm[: rests[-1] + 1, :2]])
    known = np.append(True, moves.known[: rests[-1] + 1, :2].all(axis=1))
    return np.asarray(twin.seen(commanded[known])[np.cumsum(known)[rests + 1] - 1, :2])
