"""Write the G-code of a probe plan, from the owner's own start code to the last dot; estimate its time and plastic."""

import itertools
import math
import re
from pathlib import Path

import numpy as np

from printmend.errors import GcodeError
from printmend.gcode.container import open_gcode
from printmend.measure.plan import ProbePlan
from printmend.messages import say
from printmend.printer import Extruder, Printer
from printmend.printer.printer import bare_name
from printmend.probe.layout import strokes_of
from printmend.probe.paper import Paper

# A test print starts with the owner's own start code. It must end at the home position, on which the plan relies.

# Comments with which slicers begin the part: PrusaSlicer and its kin; Cura; Bambu; Simplify3D; KISSlicer, ideaMaker.
_FIRST_LAYER = re.compile(
    r"^;\s*(LAYER_CHANGE|LAYER:\s*(?:0|-\d)|CHANGE_LAYER|layer 1,|BEGIN_LAYER|AFTER_LAYER_CHANGE)", re.IGNORECASE
)
_HOME = re.compile(r"^\s*G0*28\b", re.IGNORECASE)
_MOVE_XY = re.compile(r"^\s*G0*[0-3]\b[^;]*\b[XY]", re.IGNORECASE)
_LEVELLED = re.compile(r"^\s*(G0*29\b|M0*420\b|G0*80\b)", re.IGNORECASE)
# Lines about the sliced part or its printer, which fit no other print or printer.
_OF_THE_PART = re.compile(r"^\s*(M0*486|M0*73|M0*555|EXCLUDE_OBJECT\w*|SET_PRINT_STATS_INFO)\b", re.IGNORECASE)
_CHECK = re.compile(r"^\s*M0*862\.(\d+)\b(?:.*?\bP\s*\"([^\"]+)\")?", re.IGNORECASE)
_AREA = re.compile(r"^\s*G0*29\b.*[XY]-?\d", re.IGNORECASE)
_MOVE = re.compile(r"^\s*G0*[0-3]\b", re.IGNORECASE)
_PRINTS = re.compile(r"^\s*G0*[1-3]\b(?=.*[XY]-?[\d.])(?=.*E[\d.])", re.IGNORECASE)
_PLACE = re.compile(r"([XY])\s*(-?\d+(?:\.\d*)?|-?\.\d+)", re.IGNORECASE)
_MOST_LINES, MOST_PURGE = 1000, 40  # most commands of a start, and how many of them may print


def start_from(path: Path, printer: Printer) -> tuple[str, tuple[str, ...]]:
    """Return the start lines of a sliced file that fit ``printer``, and words about those left out.

    These are all lines before its first layer, without comments. If no comment marks the first layer, they end before
    the moves that lead to the first printed line. Raises `GcodeError` if no first layer begins within the first
    thousand commands, or if nothing homes before it.
    """
    lines: list[str] = []
    printing: list[int] = []
    for line in _lines(path):
        if _FIRST_LAYER.match(line.strip()):
            break
        if code := line.partition(";")[0].strip():
            if _PRINTS.match(code):
                printing.append(len(lines))
            lines.append(code)
        if len(printing) > MOST_PURGE:  # no purge line is so long: the part has begun without a comment
            lines = _before_moves(lines[: printing[0]])
            break
        if len(lines) > _MOST_LINES:
            raise GcodeError(
                path,
                wanted=say("first-layer"),
                came=say("commands-without-one", _MOST_LINES),
                todo=say("give-file-printer-s-slicer-wrote"),
            )
    else:
        raise GcodeError(
            path,
            wanted=say("sliced-file-says-where-first-layer"),
            came=say("none"),
            todo=say("give-file-printer-s-slicer-wrote"),
        )
    lines, left = _fitting(lines, printer)
    return homed_start("\n".join(lines), subject=str(path)), left


def _before_moves(lines: list[str]) -> list[str]:
    """Return the lines without the moves at their end."""
    end = len(lines)
    while end and _MOVE.match(lines[end - 1]) and not _HOME.match(lines[end - 1]):
        end -= 1
    return lines[:end]


def _fitting(lines: list[str], printer: Printer) -> tuple[list[str], tuple[str, ...]]:
    """Return the lines with which another print on this printer may start, and why the others are left out."""
    kept, left, of_part, checks = [], [], [], []
    reach = {
        axis.name.upper(): (min(axis.min_mm, axis.home_mm), max(axis.max_mm, axis.home_mm)) for axis in printer.axes
    }
    relative = False
    for line in lines:
        if re.match(r"^\s*G0*9[01]\b", line, re.IGNORECASE):
            relative = "91" in line.split()[0]
        beyond = [] if relative or not _MOVE.match(line) else [
            say("start-beyond", line, axis, value, f"{reach[axis][0]:g}", f"{reach[axis][1]:g}")
            for axis, value in _PLACE.findall(line.upper())
            if not reach[axis][0] - 0.01 <= float(value) <= reach[axis][1] + 0.01
        ]  # fmt: skip
        if _OF_THE_PART.match(line):
            of_part.append(line.split()[0].upper())
        elif (check := _CHECK.match(line)) is not None:
            if check[1] == "3" and check[2] and bare_name(check[2]) not in bare_name(printer.name):
                left.append(say("start-other-model", line, printer.name))
            else:
                checks.append(line.split()[0].upper())
        elif _AREA.match(line):
            left.append(say("start-levels-part", line))
        elif beyond:
            left.append(beyond[0])
        else:
            kept.append(line)
    if checks:
        left.append(say("start-checks", ", ".join(dict.fromkeys(checks))))
    if of_part:
        left.append(say("start-of-part", ", ".join(dict.fromkeys(of_part))))
    return kept, tuple(dict.fromkeys(left))


def homed_start(text: str, *, subject: str) -> str:
    """Return start code that ends at the home position of X and Y, where the plan's motion begins.

    If it moves X or Y after homing (a purge line), it homes X and Y again at its end. It then switches bed levelling on
    again, which Marlin drops when homing. Raises `GcodeError` for start code that never homes.
    """
    lines = text.splitlines()
    homes = [number for number, line in enumerate(lines) if _HOME.match(line)]
    macro = any(re.match(r"^\s*(PRINT_START|START_PRINT)\b", line, re.IGNORECASE) for line in lines)
    if not homes and not macro:
        raise GcodeError(
            subject, wanted=say("start-code-homes-g28"), came=say("none"), todo=say("give-file-printer-s-slicer-wrote")
        )
    after = lines[homes[-1] + 1 :] if homes else []
    if macro or any(_MOVE_XY.match(line) for line in after):
        lines += ["G90", "G1 Z10 F600", "G28 X Y"]
        if any(_LEVELLED.match(line) for line in lines):
            lines.append("M420 S1")
    return "\n".join(lines) + "\n"


def _lines(path: Path) -> list[str]:
    """Return the lines of a file's first chunk, which is longer than any start code."""
    with open_gcode(path) as source:
        return bytes(next(source.parts[0].chunks(), b"")).decode("utf-8", "replace").splitlines()


LAYER_MM, HOP_MM = 0.24, 0.8
BEAD_MM = 0.8  # a bead's width
PAPER_MM = 0.1  # a sheet of 80 g/m²
FILAMENT_MM, PLA_G_PER_MM3 = 1.75, 1.24e-3
TRAVEL_MM_S, PURGE_MM_S, LIFT_MM_S, EXTRUDE_MM_S = 120.0, 20.0, 10.0, 2.0
# A dot uses 0.1 mm of filament, so each piece of filament is retracted many times. A longer retraction would grind it;
# a shorter one strings. A Bowden tube yields a millimetre or two before the pressure at the nozzle changes.
RETRACT_MM: dict[Extruder, float] = {"direct": 0.6, "bowden": 2.5}
RETRACT_MM_S = 30.0
# Threads of a net are thin and low; the dots of a net are made from higher up, so that they have room around them.
THREAD_MM, FRAME_BEAD_MM, NET_LAYER_MM, NET_DOT_Z_MM, NET_MM_S = 0.4, 0.8, 0.16, 0.3, 25.0
# The nozzle approaches each dot slowly: a fast axis coasts through the play of its belt, but a printing axis does not.
APPROACH_MM_S = 20.0
MOVING_MM_S, MOVING_BEAD_MM = 50.0, 0.6  # speed and width of the lines at speed: those of parts
ACCELERATION_MM_S2, LIFT_ACCELERATION_MM_S2 = 500.0, 100.0
PREAMBLE = """\
; printmend probe: {marks} dots on one layer, about {minutes:.0f} min and {grams:.1f} g
; Printed for: {printer}. Change the temperatures below for another material than PLA, and nothing after "dots".
"""
PAPER = """\
; Tape {sheet} of paper ({name}) flat onto the bed, {place}.
; The first layer is as much higher as paper is thick. The bed stays cold: on a warm one, paper dries and shrinks.
"""
PLAIN_START = """\
M140 S60
M104 S205
M190 S60
M109 S205
G28
"""
COLD_START = """\
M140 S0
M104 S205
M109 S205
G28
"""
DOTS = """\
; dots
G21
G90
M83
G92 E0
"""
CLOSING = """\
M104 S0
M140 S0
"""


def filament_mm(volume_mm3: float) -> float:
    """Return the length of filament that holds ``volume_mm3``."""
    return volume_mm3 / (math.pi * FILAMENT_MM**2 / 4)


def dot_mm3(diameter_mm: float, layer_mm: float = LAYER_MM) -> float:
    """Return the volume of a dot: a disc as thick as the layer."""
    return math.pi * diameter_mm**2 / 4 * layer_mm


def net_strokes(plan: ProbePlan) -> list[tuple[np.ndarray, float]]:
    """Return the way-points [N, 2] of each stroke of a plan's net, and its plastic per length [mm³/mm]."""
    beads = [FRAME_BEAD_MM, *([THREAD_MM] * len(strokes_of(plan)))]
    strokes = [plan.waypoints_mm[first : last + 1] for first, last in strokes_of(plan)]
    return [(points, bead * NET_LAYER_MM) for points, bead in zip(strokes, beads, strict=False)]


def probe_gcode(
    plan: ProbePlan,
    *,
    extruder: Extruder = "bowden",
    start_gcode: str = "",
    paper: Paper | None = None,
    sheet: str = "",
) -> str:
    """Return the file that prints ``plan``: after its start code, every way-point is the end of one G0 or G1, in order.

    ``extruder`` sets how far the filament is retracted between dots. ``start_gcode`` replaces the plain heating and
    homing; it must home, and end at the home position (`homed_start` ensures that). ``paper`` is the sheet on the bed
    that takes the dots; ``sheet`` says which of several it is.
    """
    layer_mm = NET_DOT_Z_MM if plan.net else LAYER_MM
    first_mm = layer_mm + (0.0 if paper is None else PAPER_MM)
    points = plan.waypoints_mm
    dots = {int(row): float(diameter) for row, diameter in zip(plan.rows, plan.diameter_mm, strict=True)}
    minutes, grams = cost(plan)
    head = PREAMBLE.format(marks=len(plan), minutes=minutes, grams=grams, printer=plan.printer)
    taped = "" if paper is None else PAPER.format(sheet=sheet or "a sheet", name=paper.name, place=paper.place)
    lines = [head, taped, start_gcode or (COLD_START if paper else PLAIN_START), DOTS]
    lift, drop = f"G1 Z{HOP_MM + first_mm:g} F{LIFT_MM_S * 60:g}\n", f"G1 Z{first_mm:g} F{LIFT_MM_S * 60:g}\n"
    back_mm, back_feed = RETRACT_MM[extruder], f"F{RETRACT_MM_S * 60:g}"
    retract, restore = f"G1 E-{back_mm:g} {back_feed}\n", f"G1 E{back_mm:g} {back_feed}\n"
    purge = filament_mm(float(np.hypot(*(points[2] - points[1]))) * BEAD_MM * LAYER_MM)
    lines += [
        lift,
        f"G0 {xy_words(points[1])} F{TRAVEL_MM_S * 60:g}\n",
        drop,
        f"G1 {xy_words(points[2])} E{purge:.5f} F{PURGE_MM_S * 60:g}\n",
        retract,
        lift,
    ]
    for stroke, mm3_per_mm in net_strokes(plan):
        low = f"G1 Z{NET_LAYER_MM:g} F{LIFT_MM_S * 60:g}\n"
        lines += [f"G0 {xy_words(stroke[0])} F{TRAVEL_MM_S * 60:g}\n", low, restore]
        for start, end in itertools.pairwise(stroke):
            length = filament_mm(math.dist(start, end) * mm3_per_mm)
            lines.append(f"G1 {xy_words(end)} E{length:.5f} F{NET_MM_S * 60:g}\n")
        lines += [retract, lift]
    feed_mm_s = 0.0
    for row in range(max(3, plan.net), plan.moving or len(points)):
        wanted_mm_s = APPROACH_MM_S if row in dots else TRAVEL_MM_S
        feed = f" F{wanted_mm_s * 60:g}" if wanted_mm_s != feed_mm_s else ""
        lines.append(f"G0 {xy_words(points[row])}{feed}\n")
        feed_mm_s = wanted_mm_s
        if row in dots:
            extrude = f"G1 E{filament_mm(dot_mm3(dots[row], layer_mm)):.5f} F{EXTRUDE_MM_S * 60:g}\n"
            lines += [drop, restore, extrude, retract, lift]
            feed_mm_s = 0.0
    if plan.moving:
        lines += [f"G0 {xy_words(points[plan.moving])} F{TRAVEL_MM_S * 60:g}\n", drop, restore]
        for start, end in itertools.pairwise(points[plan.moving :]):
            length = filament_mm(math.dist(start, end) * MOVING_BEAD_MM * layer_mm)
            lines.append(f"G1 {xy_words(end)} E{length:.5f} F{MOVING_MM_S * 60:g}\n")
        lines += [retract, lift]
    lines += [f"G1 Z10 F{LIFT_MM_S * 60:g}\n", CLOSING]
    return "".join(lines)


def cost(plan: ProbePlan) -> tuple[float, float]:
    """Return the estimated printing time [min] after heating, and the mass of plastic [g], for all sheets together."""
    if len(plan.sheets) > 1:
        minutes, grams = zip(*map(cost, plan.sheets), strict=True)
        return sum(minutes), sum(grams)
    points = plan.waypoints_mm
    seconds = travel_s(points) + approach_s(points, plan.rows)
    volumes = [dot_mm3(diameter, NET_DOT_Z_MM if plan.net else LAYER_MM) for diameter in plan.diameter_mm]
    dot_s = 2 * move_s(HOP_MM, LIFT_MM_S, LIFT_ACCELERATION_MM_S2) + 2 * RETRACT_MM["bowden"] / RETRACT_MM_S
    seconds += len(plan) * dot_s + sum(filament_mm(volume) / EXTRUDE_MM_S for volume in volumes)
    purge = float(np.hypot(*(points[2] - points[1])))
    seconds += purge / PURGE_MM_S
    if plan.moving:
        drawn = float(np.hypot(*np.diff(points[plan.moving :], axis=0).T).sum())
        volumes.append(drawn * MOVING_BEAD_MM * LAYER_MM)
        seconds += dot_s
    for stroke, mm3_per_mm in net_strokes(plan):
        drawn = float(np.hypot(*np.diff(stroke, axis=0).T).sum())
        volumes.append(drawn * mm3_per_mm)
        seconds += drawn * (1 / NET_MM_S - 1 / TRAVEL_MM_S) + dot_s
    return seconds / 60, (sum(volumes) + purge * BEAD_MM * LAYER_MM) * PLA_G_PER_MM3


def travel_s(points_mm: np.ndarray) -> float:
    """Return the time of the moves through way-points [N, 2]. Collinear moves run through; turns are stops."""
    moves = np.diff(points_mm, axis=0)
    length = np.hypot(moves[:, 0], moves[:, 1])
    moves, length = moves[length > 0], length[length > 0]
    unit = moves / length[:, None]
    stops = np.flatnonzero((unit[1:] * unit[:-1]).sum(axis=1) < 0.999) + 1
    runs = np.add.reduceat(length, np.concatenate([[0], stops]))
    return sum(move_s(run, TRAVEL_MM_S, ACCELERATION_MM_S2) for run in runs)


def approach_s(points_mm: np.ndarray, rows: np.ndarray) -> float:
    """Return how much longer the slow moves to the way-points ``rows`` [M] take than fast ones."""
    length_mm = np.hypot(*(points_mm[rows] - points_mm[rows - 1]).T)
    return float(length_mm.sum() * (1 / APPROACH_MM_S - 1 / TRAVEL_MM_S))


def move_s(length_mm: float, speed_mm_s: float, acceleration_mm_s2: float) -> float:
    """Return the time of a move from rest to rest with a trapezoidal speed."""
    ramp_mm = speed_mm_s**2 / acceleration_mm_s2
    if length_mm < ramp_mm:
        return 2 * math.sqrt(length_mm / acceleration_mm_s2)
    return length_mm / speed_mm_s + speed_mm_s / acceleration_mm_s2


def xy_words(point: np.ndarray) -> str:
    """Return the words X and Y of a point, to 10 nm."""
    x, y = (f"{value:.5f}".rstrip("0").rstrip(".") for value in point)
    return f"X{x} Y{y}".replace("-0 ", "0 ")
