"""The start of a test print: the owner's own start code, ending at a home position that the plan relies on."""

import re
from pathlib import Path

from printmend.errors import GcodeError
from printmend.gcode.container import open_gcode
from printmend.messages import say
from printmend.printer import Printer
from printmend.printer.known import bare_name

# Where slicers say that the part begins: PrusaSlicer and its kin; Cura; Bambu; Simplify3D; KISSlicer, ideaMaker.
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
_MOST_LINES, MOST_PURGE = 1000, 40  # commands of a start, and how many of them may print


def start_from(path: Path, printer: Printer) -> tuple[str, tuple[str, ...]]:
    """Return the start lines of a sliced file that fit ``printer``, and words about those left out.

    These are all before its first layer, without comments; where no comment says where that begins, all before the
    moves that lead to its first printed line. Raises `GcodeError` where no first layer begins within the first thousand
    commands, or nothing homes before it.
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
        if len(printing) > MOST_PURGE:  # no purge line is as long, so the part has begun without a comment
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
    """Return the lines that another print on this printer may start with, and why the others may not."""
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
