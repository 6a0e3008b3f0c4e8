"""The first layer of a part as a print of its own. It takes minutes and grams, and a scan of it is enough to learn
from."""

import re

import numpy as np

from printmend.errors import GcodeError
from printmend.gcode.container import HINT_BYTES
from printmend.gcode.mark import find_test_print, with_comment
from printmend.gcode.read import Program
from printmend.messages import say
from printmend.provenance import sealed_test_print

STANDS_IN = "ender3"  # stands in for an unknown printer: walls do not depend on it, only their history does
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
