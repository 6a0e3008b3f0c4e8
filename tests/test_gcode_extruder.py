"""Which word extrudes: E, or A as for Mach3 and Machinekit; and what is a move at all."""

from pathlib import Path

import numpy as np
import pytest

from printmend.errors import GcodeError
from printmend.gcode import kernels as k
from printmend.gcode.machine import initial_state
from printmend.gcode.read import interpret_text, read_gcode
from printmend.gcode.write import rewrite
from printmend.mend import check_gcode, mend_gcode
from printmend.plan import start
from tests.mending import BENT, PLAY, SQUARE, START, exactly

RING = [(100 + 20 * np.cos(t), 100 + 20 * np.sin(t)) for t in np.linspace(0.0, 6.0, 40)]
TOP = b"G28\nG90\nG92 A0\nG1 Z0.2 F600\nG0 X110 Y100 F6000\n"
HEATING = b"M104 S200\n"
SAYS = b"; gcode_flavor = %s\n"


def printing(per_move_mm: float) -> bytes:
    return b"".join(b"G1 X%.3f Y%.3f A%.4f\n" % (x, y, per_move_mm * (i + 1)) for i, (x, y) in enumerate(RING))


def rewritten(text: bytes, *, e_is_a: bool) -> bytes:
    state, planner = initial_state(BENT.printer), start(BENT)
    state.counts.e_is_a = e_is_a
    return b"".join(bytes(view) for view in rewrite([np.frombuffer(text, np.uint8)], state, planner.plan))


@pytest.mark.parametrize(
    "text",
    [
        SQUARE,
        SQUARE.replace(b"M83", b"M82").replace(b"E1\n", b"E2 S7\n"),
        START + b"G1 X80Y80E1F1800\ng1 x60 y60 e1\nG92 E0\nG1 E-1\nG2 X80 I10 E1\nY70 E1 ; inner\n",
    ],
)
def test_a_file_with_a_is_mended_as_the_same_with_e(text: bytes) -> None:
    with_a = text.replace(b"E", b"A").replace(b"e1", b"a1")
    wanted = rewritten(text, e_is_a=False)
    assert rewritten(with_a, e_is_a=True) == wanted.replace(b"E", b"A").replace(b"e1", b"a1").replace(b"e0", b"a0")


@pytest.mark.parametrize("name", [b"mach3", b"machinekit"])
def test_the_header_says_that_a_extrudes(name: bytes) -> None:
    program = read_gcode(SAYS % name + TOP + printing(0.1)[:300])
    assert program.moves.extruding.sum() > 5
    assert program.moves.extrusion_mm[1:].max() == pytest.approx(0.1)


def test_the_numbers_say_that_a_extrudes() -> None:
    assert read_gcode(HEATING + TOP + printing(0.1)).moves.extruding.sum() == len(RING)
    assert not read_gcode(TOP + printing(0.1)).moves.extruding.any(), "a mill heats nothing"
    assert not read_gcode(HEATING + TOP + printing(9.0)).moves.extruding.any(), "no filament is pushed as far"
    assert not read_gcode(HEATING + TOP + printing(-0.1)).moves.extruding.any()
    both = read_gcode(SAYS % b"mach3" + TOP + printing(0.1) + b"G1 X90 Y90 A5 E1\n")
    assert both.moves.extruding.sum() == 1, "where a move names E, E extrudes"


def test_a_file_with_a_is_mended_as_a_print(tmp_path: Path) -> None:
    source, output = tmp_path / "part.gcode", tmp_path / "out.gcode"
    source.write_bytes(HEATING + TOP + printing(0.1))
    done = mend_gcode(source, exactly(PLAY), output)
    assert done.prediction.after.rms_mm < 0.01 < done.prediction.before.rms_mm
    again = read_gcode(output).moves
    assert again.extrusion_mm.sum() == pytest.approx(0.1 * len(RING), abs=1e-4)


@pytest.mark.parametrize("letter", [b"A", b"C", b"U"])
def test_what_may_extrude_is_never_mended_as_travels(letter: bytes, tmp_path: Path) -> None:
    source, output = tmp_path / "part.gcode", tmp_path / "out.gcode"
    source.write_bytes(TOP.replace(b"G92 A0\n", b"") + printing(0.1).replace(b"A", letter))
    advice = "gcode_flavor = mach3" if letter == b"A" else "slice it for a firmware"
    with pytest.raises(GcodeError, match=f"moves that name {letter.decode()}; .*{advice}"):
        mend_gcode(source, exactly(PLAY), output, force=True)
    with pytest.raises(GcodeError, match="expected moves that extrude with E"):
        check_gcode(source, exactly(PLAY))
    assert not output.exists()


@pytest.mark.parametrize("line", [b"O1 X99 Y99", b"W1 X99 E1", b"D5 Y99 F20", b"S3 X1", b"P7 Z9"])
def test_unknown_commands_with_coordinates_are_no_moves(line: bytes) -> None:
    text = START + b"G1 X80 E1 F1800\n" + line + b"\nG1 X60 Y60 E1\n"
    records = interpret_text(np.frombuffer(text, np.uint8), initial_state(BENT.printer))
    at = {int(row["line"]): row for row in records}
    assert at[7]["kind"] == k.KIND_EVENT, "nobody knows what it does"
    assert not at[8]["flags"] & (k.FLAG_KNOWN_X0 | k.FLAG_KNOWN_Y0 | k.FLAG_KNOWN_Z0)
    assert line + b"\n" in rewritten(text, e_is_a=False)


def test_what_stands_behind_a_printing_progress_is_no_move() -> None:
    line = b"M73 P10 R5 G1 X99 Y99 E1\n"
    text = START + b"G1 X80 E1 F1800\n" + line + b"G1 X60 E1\n"
    moves = read_gcode(text).moves
    assert moves.end_mm[-1, 0] == 60.0
    assert moves.start_mm[-1, 0] == 80.0
    assert line in rewritten(text, e_is_a=False)
