"""How a test print starts: as its owner's own prints do, and at a home position that the plan can rely on."""

import re
from pathlib import Path

from printmend.errors import GcodeError
from printmend.gcode.container import open_gcode

# Where slicers say that the part begins: PrusaSlicer and its kin; Cura; Bambu; Simplify3D; KISSlicer, ideaMaker.
_FIRST_LAYER = re.compile(
    r"^;\s*(LAYER_CHANGE|LAYER:\s*0|CHANGE_LAYER|layer 1,|BEGIN_LAYER|AFTER_LAYER_CHANGE)", re.IGNORECASE
)
_HOME = re.compile(r"^\s*G0*28\b", re.IGNORECASE)
_MOVE_XY = re.compile(r"^\s*G0*[0-3]\b[^;]*\b[XY]", re.IGNORECASE)
_LEVELLED = re.compile(r"^\s*(G0*29\b|M0*420\b|G0*80\b)", re.IGNORECASE)
_MOST_LINES = 1000
_TODO = "give a file that this printer's slicer wrote"


def start_from(path: Path) -> str:
    """Return the lines with which a sliced file starts: all before its first layer, its comments left out.

    Raises `GcodeError` where no first layer begins within the first thousand commands, or nothing homes before it.
    """
    lines: list[str] = []
    for line in _lines(path):
        if _FIRST_LAYER.match(line.strip()):
            break
        if code := line.partition(";")[0].strip():
            lines.append(code)
        if len(lines) > _MOST_LINES:
            raise GcodeError(path, wanted="a first layer", came=f"{_MOST_LINES} commands without one", todo=_TODO)
    else:
        raise GcodeError(path, wanted="a sliced file that says where its first layer begins", came="none", todo=_TODO)
    return homed_start("\n".join(lines), subject=str(path))


def homed_start(text: str, *, subject: str) -> str:
    """Return start code that ends at the home position of X and Y, where the plan's motion begins.

    Where it moves X or Y after homing (a purge line), it homes X and Y again at its end, and switches the levelling
    back on that it had made: Marlin forgets it when homing. Raises `GcodeError` for start code that never homes.
    """
    lines = text.splitlines()
    homes = [number for number, line in enumerate(lines) if _HOME.match(line)]
    macro = any(re.match(r"^\s*(PRINT_START|START_PRINT)\b", line, re.IGNORECASE) for line in lines)
    if not homes and not macro:
        raise GcodeError(subject, wanted="start code that homes (G28)", came="none", todo=_TODO)
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
