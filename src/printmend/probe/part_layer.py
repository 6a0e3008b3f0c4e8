"""Make a test print from a part's layer: its longest layer with marks along the way, or its first layer alone.

On the longest layer the nozzle follows the path without extruding. Marks lie on a lattice as in every probe, so that a
scan can identify them. Where the path passes a site, the nozzle goes there, leaves the dot, and returns to the path.

The first layer takes minutes and grams, and a scan of it is enough to learn from.
"""

import re

import numpy as np

from printmend.errors import GcodeError
from printmend.gcode.container import HINT_BYTES
from printmend.gcode.read import Program, straightened
from printmend.gcode.sliced import find_test_print, with_comment
from printmend.measure.plan import ProbePlan
from printmend.messages import say
from printmend.metrics.shape import nearest
from printmend.printer import Printer
from printmend.probe.gcode import cost
from printmend.probe.layout import EDGE_MM, MARKS, Layout, grid_of, mark_area_mm, pitch_for, plan_of
from printmend.provenance import sealed_test_print

CHORD_MM = 0.1  # how far an arc's chords may lie from it
SAMPLE_MM = 0.5  # longest path between two sampled points
MOST_MINUTES = 15.0  # longest time that the print may take
SHORTER = 0.85  # if it takes longer, this share of the path is kept, repeatedly
LEAST_MARKS = 16  # fewer marks cannot be identified in a scan


def longest_layer_mm(part: Program) -> np.ndarray:
    """Return the way-points [N, 2] of the layer whose extruded path is the longest, its travels included.

    Raises `GcodeError` for a part that extrudes nothing.
    """
    moves = straightened(part.moves, CHORD_MM)
    known = moves.known[:, :2].all(axis=1)
    length = np.where(known & moves.extruding, np.hypot(*(moves.end_mm - moves.start_mm)[:, :2].T), 0.0)
    printed = (moves.layer >= 0) & (length > 0)
    if not printed.any():
        raise GcodeError(part.name, wanted=say("part-printed"), came=say("no-extruding-move"), todo=say("check-file"))
    layer = int(np.argmax(np.bincount(moves.layer[printed], weights=length[printed])))
    rows = np.flatnonzero(known & (moves.layer == layer))
    inside = rows[(rows >= np.flatnonzero(printed & (moves.layer == layer))[0])]
    points = np.vstack([moves.start_mm[inside[0], :2], moves.end_mm[inside, :2]])
    moved = np.concatenate([[True], (np.diff(points, axis=0) != 0).any(axis=1)])
    return points[moved]


def layer_plan(printer: Printer, path_mm: np.ndarray, *, marks: int = MARKS) -> ProbePlan:
    """Return the plan that follows a layer's way-points [N, 2], cut short if it would take more than 15 minutes.

    Raises `GcodeError` if the layer is too small for marks.
    """
    low, high = np.array([printer.x.min_mm, printer.y.min_mm]), np.array([printer.x.max_mm, printer.y.max_mm])
    path_mm = np.clip(path_mm, low + EDGE_MM, high - EDGE_MM)
    plan = _marked(printer, path_mm, marks)
    while cost(plan)[0] > MOST_MINUTES:
        path_mm = path_mm[: int(SHORTER * len(path_mm))]
        plan = _marked(printer, path_mm, marks)
    return plan


def _marked(printer: Printer, path_mm: np.ndarray, marks: int) -> ProbePlan:
    bed_low, bed_high = mark_area_mm(printer)
    low, high = np.maximum(path_mm.min(axis=0), bed_low), np.minimum(path_mm.max(axis=0), bed_high)
    if (high - low <= 0).any():
        raise _too_small(0)
    grid = grid_of(printer, low, high, pitch_for(low, high, marks))
    samples, segment = _sampled(path_mm)
    distance, sample = nearest(samples, grid.place_mm)
    near = np.flatnonzero(distance <= grid.pitch_mm / np.sqrt(2))
    if len(near) < LEAST_MARKS:
        raise _too_small(len(near))
    near = near[np.argsort(sample[near], kind="stable")]
    points, rows, heading, done = [], [], [], 0
    for site in near:
        at = int(sample[site])
        points += [path_mm[k] for k in range(done, segment[at] + 1)]
        done = int(segment[at]) + 1
        points += [samples[at], grid.place_mm[site]]
        rows.append(len(points) - 1)
        heading.append(path_mm[done] - path_mm[done - 1])
        points.append(samples[at])
    points += list(path_mm[done:])
    layout = Layout(
        grid.pitch_mm, grid.angle_rad, grid.place_mm[near], grid.site[near], np.array(heading),
        np.arange(len(near)),
    )  # fmt: skip
    return plan_of(printer, layout, np.array(points), np.array(rows))


def _too_small(marks: int) -> GcodeError:
    return GcodeError(
        say("subject-longest-layer"),
        wanted=say("room-marks-along", LEAST_MARKS),
        came=say("room", marks),
        todo=say("terminal-use-design-optimal-fixed-which-go"),
    )


def _sampled(path_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points [S, 2] on the path, at most half a millimetre apart, and the move [S] that each is on."""
    moves = np.diff(path_mm, axis=0)
    count = np.maximum(np.ceil(np.hypot(*moves.T) / SAMPLE_MM), 1).astype(np.int64)
    segment = np.repeat(np.arange(len(moves)), count)
    share = (np.arange(len(segment)) - np.repeat(np.cumsum(count) - count, count)) / count[segment]
    return path_mm[segment] + share[:, None] * moves[segment], segment


STANDS_IN = "ender3"  # replaces an unknown printer: walls do not depend on it, only their history does
_HEAD = b"; printmend first layer: of a part, to be printed unmended, scanned and measured"
_ENDING = """\
; printmend: the rest of the part is left out
G91
G1 Z5 F600
G90
M104 S0
M140 S0
M107
"""
_CONFIG = re.compile(rb"^; (?:gcode_flavor|printer_model|printer_settings_id|filament_diameter)\b.*$", re.MULTILINE)


def first_layer(program: Program) -> bytes:
    """Return the G-code of a file up to the end of its first layer, with the heaters switched off after it.

    The slicer's notes about printer and firmware are kept. A comment at the top marks the file (`gcode.mark`). Raises
    `GcodeError` for a file that prints nothing, and for a test print of printmend's.
    """
    if (kind := find_test_print(program.text[:HINT_BYTES].tobytes())) is not None:
        raise GcodeError(
            program.name, wanted=say("file-part"), came=say("test-print-ours", kind),
            todo=say("name-part-test-print-measured"),
        )  # fmt: skip
    moves = program.moves
    printed = moves.extruding & (moves.layer >= 0)
    if not printed.any():
        raise GcodeError(
            program.name, wanted=say("part-printed"), came=say("no-extruding-move"), todo=say("check-file")
        )
    first = moves.layer[printed].min()
    last_line = int(moves.line[printed & (moves.layer == first)].max())
    ends = np.flatnonzero(program.text == ord("\n"))
    cut = int(ends[last_line]) + 1 if last_line < len(ends) else len(program.text)
    head, rest = program.text[:cut].tobytes(), program.text[cut:].tobytes()
    noted = b"".join(line + b"\n" for line in _CONFIG.findall(rest))
    head = with_comment(head, _HEAD)
    return sealed_test_print(head.rstrip(b"\n") + b"\n" + _ENDING.encode() + noted)
