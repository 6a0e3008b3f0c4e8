"""One row for each thing that G-code keeps in mind: a snippet and where it leads (what rewriters trip over)."""

import numpy as np
import pytest

from printmend.gcode import kernels as k
from printmend.gcode.container import open_gcode
from printmend.gcode.machine import Flavour, detect_flavour, initial_state
from printmend.gcode.read import (
    _says_e_first,
    arc_points,
    e_warning,
    interpret_text,
    moves_of,
    read_gcode,
    starting_state,
    straightened,
)
from printmend.printer import read_printer


def records_of(text: str, flavour: Flavour = Flavour.UNKNOWN, printer: str | None = None) -> np.ndarray:
    state = initial_state(read_printer(printer) if printer else None, flavour)
    return interpret_text(np.frombuffer(text.encode(), np.uint8), state)


def place(text: str, **options) -> tuple[float, float, float]:
    last = records_of(text, **options)[-1]
    return tuple(round(float(last[name]), 9) for name in ("x1", "y1", "z1"))


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("G1 X10 Y20 Z3", (10, 20, 3)),
        ("G90\nG1 X10\nG91\nG1 X5 Y-2\nG90\nG1 Y7", (15, 7, 0)),
        ("G1 X10\nG92 X0\nG1 X5", (15, 0, 0)),  # G92 with one axis
        ("G1 X10 Y10\nG92\nG1 X5", (15, 10, 0)),  # bare: all zero on Klipper
        ("G1 X10 Y10\nG92 X0 Y0\nG28 X\nG1 X5 Y5", (5, 15, 0)),  # homing one axis forgets its shift only
        ("G20\nG1 X1 Y2\nG21\nG1 Y5", (25.4, 5, 0)),
        ("G1 X10\nG53 G1 X3\nG1 Y1", (3, 1, 0)),
        ("G10 L2 P2 X100 Y50\nG55\nG1 X1 Y1\nG54\nG1 X2", (2, 51, 0)),
        ("G10 L20 P1 X0\nG1 X5", (5, 0, 0)),
        ("G28\nG1 X10\nG10 L20 P2 X3\nG1 X11\nG55\nG1 X5", (12, 0, 0)),
        ("SET_GCODE_OFFSET X=1\nG1 X10\nSET_GCODE_OFFSET X_ADJUST=0.5\nG1 X10", (11.5, 0, 0)),
        ("G1 X10\nSET_GCODE_OFFSET X=2 MOVE=1\nG91\nG1 X1", (13, 0, 0)),
        ("G1 X10\nSAVE_GCODE_STATE NAME=s\nG91\nG1 X5\nRESTORE_GCODE_STATE NAME=s\nG1 X20", (20, 0, 0)),
        ("G1 X10\nSAVE_GCODE_STATE NAME=s\nG1 X50\nRESTORE_GCODE_STATE NAME=s MOVE=1", (10, 0, 0)),
        ("T0\nG10 P1 X2 Y-1\nT1\nG1 X10 Y10", (8, 11, 0)),  # RRF tool offset
        ("M218 T1 X5\nT1\nG1 X10", (5, 0, 0)),
        ("M206 X3\nG1 X10", (7, 0, 0)),
        ("G1 X5 Y5\nX6\nY7", (6, 7, 0)),  # no G word: the same motion again
        ("G1X10Y10\ng1 y5\nG01 X2", (2, 5, 0)),
        ("G 1 X10 Y10\nG 91\nG  0 Y5", (10, 15, 0)),
        ("G91 G1 X5\nG90 G1 Y5", (5, 5, 0)),  # several commands on a line
        ("G1 X5 G1 X9", (9, 0, 0)),
        ("G21 G90 G0 X4 Y4 Z4", (4, 4, 4)),
        ("N10 G1 X5*33\nN11 G1 Y2*1", (5, 2, 0)),
        ("G1 X5 ; G1 X9\nG1 Y2 (Y7) Z1", (5, 2, 1)),
        ("M117 G1 X99\nM118 X99\nG1 X1", (1, 0, 0)),
        ("; X5\n;X6\nG1 Y1", (0, 1, 0)),
        ("G2 X10 Y0 I5", (10, 0, 0)),
        ("G17\nG3 X10 R5\nG18 G2 X0 Z0 R5", (0, 0, 0)),
        ("G1 X1 Y1\r\nG1 X2\rG1 Y3\nG1 Z1", (2, 3, 1)),
        ("\ufeffG1 X5", (5, 0, 0)),
        ("G1 X5\0\0\nG1 Y\xe9 Z2", (5, 0, 0)),  # foreign bytes: nothing is read into them
        ("G80\nX9 Y9\nG1 X1", (1, 0, 0)),  # G80 ends the modal motion
        ("M84\nG1 X3 Y4", (3, 4, 0)),
        ("G5 X5 Y6 I1 J1 P2 Q2", (5, 6, 0)),
    ],
)
def test_where_the_machine_is(text, wanted):
    assert place(text) == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("text", "flavour", "wanted"),
    [
        ("M82\nG1 X1 E2\nG1 X2 E5", Flavour.UNKNOWN, [2, 3]),
        ("M83\nG1 X1 E2\nG1 X2 E5", Flavour.UNKNOWN, [2, 5]),
        ("M83\nG90\nG1 X1 E2\nG1 X2 E5", Flavour.MARLIN2, [2, 3]),  # G90 sets E too
        ("M83\nG90\nG1 X1 E2\nG1 X2 E5", Flavour.KLIPPER, [2, 5]),
        ("M82\nG91\nG1 X1 E2\nG1 X2 E5", Flavour.MARLIN2, [2, 5]),
        ("M82\nG91\nG1 X1 E2\nG1 X2 E5", Flavour.KLIPPER, [2, 5]),
        ("M82\nG91\nG1 X1 E2\nG1 X2 E5", Flavour.RRF, [2, 3]),
        ("M83\nG91\nG90\nG1 X1 E2\nG1 X2 E2", Flavour.PRUSA, [2, 2]),
        ("G1 X1 E5\nG92 E0\nG1 X2 E1", Flavour.UNKNOWN, [5, 1]),
        ("G92 E1\nG20\nG1 X1 E1", Flavour.UNKNOWN, [24.4]),
        ("M221 S50\nM83\nG1 X1 E2", Flavour.UNKNOWN, [1]),
        ("M200 D2\nM83\nG1 X1 E3.141592653589793", Flavour.UNKNOWN, [1]),  # cubic millimetres
        ("M83\nSAVE_GCODE_STATE\nM82\nRESTORE_GCODE_STATE\nG1 X1 E3\nG1 X2 E3", Flavour.KLIPPER, [3, 3]),
    ],
)
def test_how_much_filament_runs(text, flavour, wanted):
    records = records_of(text, flavour)
    assert records["advance"][records["kind"] == k.KIND_LINEAR] == pytest.approx(wanted)


@pytest.mark.parametrize(("flavour", "wanted"), [(Flavour.KLIPPER, 12.0), (Flavour.MARLIN2, 2.0), (Flavour.RRF, 2.0)])
def test_a_bare_g92_is_the_firmwares_own(flavour, wanted):
    assert place("G1 X10\nG92\nG1 X2", flavour=flavour)[0] == wanted


def certain(record: np.void) -> str:
    """Return the axes whose place is certain after a record."""
    return "".join(axis for bit, axis in enumerate("XYZ") if record["flags"] >> (7 + bit) & 1)


OFFSETS = ["G92 Y{}", "M206 Y{}", "G10 L2 P1 Y{}", "G10 P1 Y{}\nT1", "M218 T1 Y{}\nT1", "SET_GCODE_OFFSET Y={}"]


@pytest.mark.parametrize("line", OFFSETS)
@pytest.mark.parametrize("value", ["{v}", "[v]", "#5", "", "1,5"])
def test_what_a_word_without_a_value_shifts_is_unknown(line, value):
    line = line.replace("{}", value)
    assert certain(records_of(f"G28\n{line}\nG1 X5 Y5 Z5")[-1]) == "XZ"
    assert certain(records_of(f"G28\nif a\n  {line.replace(chr(10), chr(10) + '  ')}\nG1 X5 Y5 Z5")[-1]) == "XZ"


@pytest.mark.parametrize(
    ("line", "known"),
    [
        ("G1 X{v} Y5", "YZ"),
        ("G1 X5 {v}", ""),
        ("G1 X60,5 Y60 E1,5", "Z"),  # decimal commas
        ("G1 X6 0 Y60 E1", "Z"),
        ("G1 Z100, E4", "XY"),
        ("G1 X7Y8e+1", "Z"),
        ("(nested (deep) X3) Y9", "Z"),
        ("/G1 X60", "YZ"),
        ("{macro}", ""),
        ("G28 X{v}", ""),
        ("%", "XYZ"),
        ("M104 S{v}", "XYZ"),
    ],
)
def test_a_line_that_is_not_read_to_its_end_is_believed_in_no_part(line, known):
    assert certain(records_of(f"G28\nG1 X1 Y1 Z1\n{line}\nG1 F6000")[-1]) == known


@pytest.mark.parametrize(
    "lines", ["M218 T{v} Y5\nT1", "G10 P{v} Y5\nT1", "M218 T1 Y5\nT{v}", "G10 L{v} P9 Y5", "T?\nM218 Y5\nT2"]
)
def test_the_offset_of_a_tool_without_a_number_is_unknown(lines):
    assert certain(records_of(f"G28\n{lines}\nG1 X1 Y1 Z1")[-1]) == "XZ"
    assert certain(records_of("G28\nT?\nT{v}\nG1 X1 Y1 Z1")[-1]) == "XYZ"  # as long as none has any


@pytest.mark.parametrize(
    "line", ["G92 E{v}", "G1 X5 E{v}", "G1 X5 E", "G1 X5 E1,5", "{if a}G92 E0{endif}", "if a\n G92 E0", "if a\n G1 E5"]
)
def test_an_absolute_e_after_an_unknown_one_says_no_length(line):
    first, second = records_of(f"G28\nM82\n{line}\nG90\nM82\nG1 X7 Y7 F600 E4\nG1 X9 E6")[-2:]
    assert first["flags"] & k.FLAG_OPAQUE
    assert first["flags"] & k.FLAG_EXTRUDING
    assert (first["advance"], second["advance"]) == (0, 2)
    assert not second["flags"] & k.FLAG_OPAQUE


@pytest.mark.parametrize("line", ["G1 F{v}", "G1 X5 F1,5", "while a\n G1 F900", "G5 X5 I1 J1 P1 Q1 F{v}"])
def test_a_move_at_an_unknown_speed_is_not_written_again(line):
    first, second = records_of(f"G28\nG1 F600\n{line}\nG1 X7 Y7 E1\nG1 X9 E6 F600")[-2:]
    assert (first["feed"], second["feed"]) == (0, 600)
    assert first["flags"] & k.FLAG_OPAQUE
    assert not second["flags"] & k.FLAG_OPAQUE


BLOCK = "if iterations < 3\n  G91\n  M83\n  G20\nelse\n\tG1 X5\n; a comment\n\n\tG1 Y5\n"


def test_a_block_makes_unknown_what_it_could_set():
    """From its end on until it is said again: a mode by its command, a place by an absolute word."""
    rows = records_of(f"G28\nG90\nM82\n{BLOCK}G1 X7 E1\nG21\nG90\nG1 X8 Y8 E2\nM82\nG1 X9 E3\nG1 X10 E4", Flavour.RRF)
    first, second, third, fourth = rows[-4:]
    assert (certain(first), certain(second)) == ("Z", "XYZ")
    assert [bool(row["flags"] & k.FLAG_OPAQUE) for row in (first, second, third, fourth)] == [True, True, True, False]


@pytest.mark.parametrize(
    ("lines", "clear"),
    [
        ("/M106 S0", True), ("/G4 P5", True), ("/G1 X60", True), ("if a\n G90\n  G21", True),
        ("if a\n G91\n G90", True), ("{if a > 1}M106 S100{endif}", True), ("{% if a %}\nM117 x\n{% endif %}", True),
        ("{if a}G90{else}M106{endif}", True), ("{macro}\nG28\nM83\nG90", True), ("{macro}\nM83\nG90", False),
        ("/G91", False), ("{if a}G91{endif}", False), ("{if a}\nG91\n{else}\nG90\n{endif}", False),
        ("if a\n G91\n if b\n  G90", False), ("{if a}\n/M106", False), ("{if a}G1 X5 {b}{endif}", False),
    ],
)  # fmt: skip
def test_what_may_be_skipped_leaves_what_it_cannot_change(lines: str, clear: bool) -> None:
    row = records_of(f"G28\nG90\nM83\n{lines}\nG1 X7 Y5 Z1 E1 F600", Flavour.RRF)[-1]
    assert (certain(row) == "XYZ" and not row["flags"] & k.FLAG_OPAQUE) is clear
    assert clear or row["doubted"] >= 4


@pytest.mark.parametrize(
    ("flavour", "known"),
    [(Flavour.RRF, "XYZ"), (Flavour.UNKNOWN, "YZ"), (Flavour.MARLIN2, "YZ"), (Flavour.KLIPPER, "YZ")],
)
def test_what_m120_saves_m121_brings_back_or_nobody_knows(flavour, known):
    rows = records_of("G28\nM83\nG1 F600\nM120\nG91\nM120\nM82\nG1 F9\nM121\nM121\nG1 X5 E2\nG1 X9 E2", flavour)
    assert certain(rows[-1]) == known
    if known == "XYZ":
        assert (rows[-1]["x1"], rows[-1]["advance"], rows[-1]["feed"]) == (9, 2, 600)
    same = records_of("G28\nM121\nM120\nG91\nG90\nM121\nG1 X5 E2", flavour)  # nothing to bring back
    assert certain(same[-1]) == "XYZ"


@pytest.mark.parametrize(
    ("flavour", "words", "wanted"),
    [(Flavour.RRF, "P2", 1), (Flavour.MARLIN2, "P2", 2), (Flavour.MARLIN1, "P1", 1), (Flavour.UNKNOWN, "P1", 0)],
)
def test_an_arcs_further_turns_are_the_firmwares_own(flavour, words, wanted):
    assert records_of(f"G2 I5 {words}", flavour)[-1]["turns"] == wanted


def test_homing_goes_to_the_printers_home_and_makes_the_place_certain():
    records = records_of("G1 Y3\nG91\nG1 X1\nG28 X\nG1 X-5\nG28", printer="ender5")
    assert list(records["kind"]) == [1, 1, k.KIND_HOME, 1, k.KIND_HOME]
    assert list(records["axes"][records["kind"] == k.KIND_HOME]) == [1, 7]
    certain = [[bool(flags >> (7 + axis) & 1) for axis in range(3)] for flags in records["flags"]]
    assert certain == [[False, True, False]] * 2 + [[True, True, False]] * 2 + [[True] * 3]
    assert (records["x1"][3], records["y1"][3]) == (215.0, 3.0)
    assert (records["x1"][4], records["y1"][4], records["z1"][4]) == (220.0, 220.0, 0.0)


@pytest.mark.parametrize(
    ("line", "event", "place_is_certain"),
    [
        ("TIMELAPSE_TAKE_FRAME", k.EVENT_MACRO, False),
        ("_MY_MACRO X=1", k.EVENT_MACRO, False),
        ("M98 P\"x.g\"", k.EVENT_MACRO, False),
        ("PAUSE", k.EVENT_PAUSE, True),
        ("M600", k.EVENT_PAUSE, True),
        ("M0", k.EVENT_PAUSE, True),
        ("@pause", k.EVENT_PAUSE, True),
        ("T1", k.EVENT_TOOL, True),
        ("G91\nT0", k.EVENT_TOOL, True),
        ("G91\nT1", k.EVENT_TOOL, False),
        ("M6 T1", k.EVENT_TOOL, False),
        ("EXCLUDE_OBJECT_START NAME=G1_part", k.EVENT_EXCLUDE, True),
        ("M486 S1", k.EVENT_EXCLUDE, True),
        ("@Object a.stl", k.EVENT_EXCLUDE, True),
        ("G29", k.EVENT_PROBE, False),
        ("G12", k.EVENT_UNKNOWN, False),
        ("G1 H1 X-200 F600", k.EVENT_UNKNOWN, False),  # RRF: until the end stop
        ("G81 X5 Y5 Z-2 R2", k.EVENT_UNKNOWN, False),
        ("{if layer == 3}G1 X5{endif}", k.EVENT_PLACEHOLDER, False),
        ("M84", k.EVENT_MOTORS_OFF, False),
        ("M18 X Y", k.EVENT_MOTORS_OFF, False),
    ],
)  # fmt: skip
def test_what_makes_the_place_uncertain(line, event, place_is_certain):
    record = records_of(f"G28\n{line}\n")[-1]
    assert (record["kind"], record["event"]) == (k.KIND_EVENT, event)
    assert bool(record["flags"] & k.FLAG_KNOWN_X1) == place_is_certain


@pytest.mark.parametrize(
    "line", ["M104 S200", "M106 S255", "G4 P500", "M73 P5 R10", "SET_PRESSURE_ADVANCE ADVANCE=0.05", "M84 S60", "M18 E",
             "EXCLUDE_OBJECT_DEFINE NAME=a", "M204 P500", "hello: world", "%", "M220 S100", "M900 K0.05",
             "@sound G1 X5", "; printing object a.stl id:0 copy 0", ";MESH:a.stl"]
)  # fmt: skip
def test_what_does_not_concern_motion_has_no_record(line):
    records = records_of(f"G28\n{line}\n")
    macro = records[1:]
    assert len(macro) == (1 if line == "hello: world" else 0)  # an unknown name may be a macro


@pytest.mark.parametrize(("line", "lost"), [("G1 X{x} Y5", "X"), ("G1 Z[layer_z]", "Z"), ("G1 X5 Y#3", "Y")])
def test_placeholders_lose_the_axis_they_name(line, lost):
    record = records_of(f"G28\n{line}\n")[-1]
    assert (record["kind"], record["event"]) == (k.KIND_EVENT, k.EVENT_PLACEHOLDER)
    assert record["flags"] & k.FLAG_OPAQUE
    assert [axis for n, axis in enumerate("XYZ") if not record["flags"] >> (7 + n) & 1] == [lost]


def test_a_new_zero_set_where_the_place_is_unknown_stays_unknown_until_homing():
    records = records_of("G92 X0\nG1 X5\nG28\nG1 X5")
    assert [bool(flags & k.FLAG_KNOWN_X1) for flags in records["flags"]] == [False, False, True, True]


def test_feed_is_modal_and_a_minute_has_60_seconds():
    moves = read_gcode(b"G1 X1\nG1 F1800\nG1 X2\nG0 X3 F600\nG1 X4\nG20\nG1 X5 F60\n").moves
    assert list(moves.feed_mm_s) == pytest.approx([0, 30, 10, 10, 25.4])


def test_the_firmware_is_read_from_slicers_comments():
    assert detect_flavour(b"; gcode_flavor = klipper\n") is Flavour.KLIPPER
    assert detect_flavour(b"", b"; gcode_flavor = marlin2\n") is Flavour.MARLIN2
    assert detect_flavour(b";FLAVOR:Marlin\nG28\n") is Flavour.MARLIN2
    assert detect_flavour(b"G28\n; nothing\n") is Flavour.UNKNOWN


def test_relative_extrusion_that_a_macro_switched_on_is_found_in_the_numbers():
    line = "".join(f"G1 X{i % 20} Y{i % 7} E0.0{1 + i % 3}\n" for i in range(100))
    moves = read_gcode(("START_PRINT\nG28\n" + line).encode()).moves
    assert moves.extrusion_mm.min() > 0
    absolute = "".join(f"G1 X{i % 20} Y{i % 7} E{i / 50:.3f}\n" for i in range(100))
    assert read_gcode(("START_PRINT\nG28\n" + absolute).encode()).moves.extrusion_mm.sum() == pytest.approx(1.98)


RELATIVE = "".join(f"G1 X{i % 20} Y{i % 7} E0.0{1 + i % 3}\n" for i in range(40))
ABSOLUTE = "".join(f"G1 X{i % 20} Y{i % 7} E{i / 5:.3f}\n" for i in range(40))
LONG = "".join(f"G1 X{i % 20} Y{i % 7} E{i / 50:.3f}\n" for i in range(600))  # beside which the rest is little
RAISED = "".join(f"G1 X{(-1) ** i} E{0.4 * i:.1f}\n" for i in range(40))
RELATIVE_STEPS = "".join(f"G1 X{(-1) ** i} E{0.01 * i:.2f}\n" for i in range(30))  # as good as lengths of each
# Both name their E on travels, too: every third and every fifth pushes nothing.
RELATIVE_TRAVELS = "".join(f"G1 X{i % 20} Y{i % 7} E0.0{i % 3}\n" for i in range(60))
ABSOLUTE_TRAVELS = "".join(f"G1 X{i % 20} Y{i % 7} E{(i - i // 5) / 50:.3f}\n" for i in range(60))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("START_PRINT\nG28\n" + RELATIVE, "before it sets M82 or M83. Its numbers look like relative E"),
        ("G28\nG90\n" + RELATIVE, "numbers look like relative E"),
        (";FLAVOR:Marlin\nG28\nG90\n" + RELATIVE, "numbers look like relative E"),
        ("G28\nM83\n" + RELATIVE, None),
        ("G28\nM83\nG90\n" + RELATIVE, None),
        ("G28\nM82\n" + ABSOLUTE, None),
        ("G28\n" + ABSOLUTE, None),
        ("G28\n" + ABSOLUTE_TRAVELS, None),
        ("G28\n" + RELATIVE_TRAVELS, "numbers look like relative E"),
        ("; gcode_flavor = marlin2\nG28\nM83\nG90\n" + RELATIVE, "G91 makes E relative too"),
        ("G28\nM83\nG90\n" + ABSOLUTE, "G90 and G91 set E too"),
        ("G28\nM82\n" + LONG + "G91\nM82\nG92 E0\n" + RAISED, "G90 and G91 set E too"),
        ("G28\nM82\n" + LONG + "G91\nG1 Z5 E-1\nG90\n" + LONG, None),
        ("G28\nM83\nG91\nG1 Z5\nG90\n" + RELATIVE, None),
        ("G28\nM83\n" + RELATIVE + "G5 X30 Y9 I9 J9 P-9 Q9 E1\nG91\nG1 Z5\nG90\n", None),
        ("G28\nM82\n" + LONG + "G91\nM82\nG92 E0\n" + RELATIVE_STEPS, "Printing moves concerned: 28"),
    ],
)
def test_e_that_a_firmware_may_read_otherwise_is_said(text, said, tmp_path):
    (tmp_path / "part.gcode").write_text(text)
    with open_gcode(tmp_path / "part.gcode") as file:
        warning = e_warning(starting_state(file.parts[0]))
    assert warning is None if said is None else said in warning


def test_where_arcs_count_their_centres_from_is_no_matter_of_g90() -> None:
    moves = read_gcode(b"G28\nG91\nG90.1\nG1 X10 F600\nG1 X10\nG90\nG91.1\nG1 X5\n").moves
    assert moves.end_mm[:, 0].tolist() == [10.0, 20.0, 5.0]


@pytest.mark.parametrize(
    ("text", "radius", "length"),
    [
        ("G2 X10 Y0 I5 J0", 5, np.pi * 5),
        ("G3 X10 Y0 I5 J0", 5, np.pi * 5),
        ("G3 X0 Y0 I5 J0", 5, 2 * np.pi * 5),  # full circle
        ("G2 I5 P3", 5, 6 * np.pi * 5),
        ("G2 X5 Y5 R5", 5, np.pi * 2.5),
        ("G2 X5 Y5 R-5", 5, np.pi * 7.5),  # the long way round
        ("G18\nG2 X10 I5", 5, np.pi * 5),
        ("G19\nG3 Y10 J5", 5, np.pi * 5),
        ("G90.1\nG2 X10 Y0 I5 J0", 5, np.pi * 5),
    ],
)
def test_arcs_have_their_radius_and_length(text, radius, length):
    moves = read_gcode(text.encode()).moves
    fine = straightened(moves, 1e-5)
    points = np.vstack([fine.start_mm[:1], fine.end_mm])
    centre = moves.center_mm[0]
    plane = points[:, [[0, 1], [2, 0], [1, 2]][moves.plane[0]]]
    assert np.hypot(*(plane - centre).T) == pytest.approx(radius, abs=1e-9)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(length, rel=1e-5)


def test_a_helix_rises_linearly_and_splits_its_filament():
    moves = read_gcode(b"G28\nM83\nG3 X0 Y0 Z4 I5 E8 F600\n").moves
    fine = straightened(moves, 0.01)
    assert np.diff(fine.end_mm[:, 2]) == pytest.approx(4 / len(fine))
    assert fine.extrusion_mm == pytest.approx(8 / len(fine))
    assert (fine.end_mm[:-1] == fine.start_mm[1:]).all()
    assert len(straightened(moves, 0.1)) < len(fine)


@pytest.mark.parametrize("tolerance_mm", [0.1, 0.01, 0.001])
def test_chords_stay_within_the_tolerance(tolerance_mm):
    start, end, centre = np.array([10.0, 0, 0]), np.array([0.0, 10, 0]), np.zeros(2)
    points = np.vstack([start, arc_points(start, end, centre, 0, False, 0, tolerance_mm)])
    middle = (points[1:] + points[:-1])[:, :2] / 2
    sagitta = 10 - np.hypot(*middle.T)
    assert (sagitta <= tolerance_mm + 1e-12).all()
    assert sagitta.max() > tolerance_mm / 4  # and no more chords than that needs


def layers(text: str) -> list[int]:
    return list(read_gcode(text.encode()).moves.layer)


def test_layers_by_comments_z_and_hops():
    square = "G1 X1 E1\nG1 X2 E2\n"
    by_comment = f"G28\nG1 X0\n;LAYER_CHANGE\nG1 Z.2\n{square};LAYER_CHANGE\nG1 Z.4\nG92 E0\n{square}"
    assert layers(by_comment) == [-1, 0, 0, 0, 1, 1, 1]
    cura = f";LAYER_COUNT:2\n;Layer height: 0.2\n;LAYER:0\nG1 Z.2\n{square};LAYER:1\nG92 E0\nG1 Z.4\n{square}"
    assert layers(cura) == [0, 0, 0, 1, 1, 1]
    by_height = "M83\nG1 Z.2\nG1 X1 E1\nG1 Z2\nG1 X5\nG1 Z.2\nG1 X6 E1\nG1 Z.4\nG1 X7 E1\n"
    assert layers(by_height) == [0, 0, 0, 0, 0, 0, 1, 1]
    vase = "M83\nG1 Z.2\n" + "".join(f"G1 X{i % 9} Z{0.2 + i / 500:.4f} E1\n" for i in range(200))
    assert 2 <= max(layers(vase)) + 1 <= 9


def test_moves_carry_homing_and_events_between_them():
    moves = read_gcode(b"G28\nG1 X1\nPAUSE\nG1 X2\nG28 X Y\n").moves
    assert list(moves.home_index) == [0, 2]
    assert moves.home_axes.tolist() == [[True] * 3, [True, True, False]]
    assert (list(moves.event_index), list(moves.event)) == ([1], [k.EVENT_PAUSE])
    assert moves_of(np.empty(0, k.RECORD)).line.shape == (0,)
    with pytest.raises(ValueError, match="read-only"):
        moves.end_mm[0] = 0


@pytest.mark.parametrize(
    ("line", "flavour", "known"),
    [
        ("G28 O", Flavour.MARLIN2, True),  # all is known: Marlin stays where it is
        ("G28 O", Flavour.UNKNOWN, False),
        ("G61 XY S1", Flavour.UNKNOWN, False),  # a stored place
        ("G61", Flavour.UNKNOWN, True),  # LinuxCNC's exact path
        ("G1 R2 X5 Y5", Flavour.RRF, False),
        ("BED_MESH_PROFILE LOAD=a", Flavour.KLIPPER, True),
    ],
)
def test_places_that_the_firmware_chooses(line: str, flavour: Flavour, known: bool) -> None:
    state = initial_state(flavour=flavour)
    rows = interpret_text(np.frombuffer(f"G28\nG1 X10 Y20\n{line}\nG92 E0\n".encode(), np.uint8), state)
    assert bool(rows[-1]["flags"] & k.FLAG_KNOWN_X0) == known
    assert not known or (rows[-1]["x0"], rows[-1]["y0"]) == (10, 20)


def test_a_mended_file_is_read_as_the_file_was(tmp_path):
    """M82 within G91: what E means is guessed from the numbers, and cutting lines changes the numbers."""
    from printmend.gcode.read import guessed_e_rule
    from printmend.gcode.sliced import marked

    path, again = tmp_path / "part.gcode", tmp_path / "mended.gcode"
    path.write_text("G28\nG91\nM82\n" + "".join(f"G1 X{1 + i % 3} E{i}\n" for i in range(15)))
    with open_gcode(path) as file:
        state = starting_state(file.parts[0])
        rule = guessed_e_rule(file.parts[0], state)
        again.write_bytes(b"".join(bytes(c) for c in marked(file.parts[0].chunks(), "f" * 16, rule)))
    more = "".join(f"G1 X1 E{i}\n" for i in range(15, 40))
    again.write_text(again.read_text() + more)
    with open_gcode(again) as file:
        assert starting_state(file.parts[0]).counts.tobytes() == state.counts.tobytes()
    again.write_text(path.read_text() + more)  # without the mark another rule explains these numbers better
    with open_gcode(again) as file:
        assert starting_state(file.parts[0]).counts.tobytes() != state.counts.tobytes()
    path.write_text("G28\nM83\nG1 X10 E1\n")
    with open_gcode(path) as file:
        assert guessed_e_rule(file.parts[0], state) is None


def test_equal_e_words_without_m83_are_read_as_relative(tmp_path):
    path = tmp_path / "part.gcode"
    path.write_text("G28\nG1 E1\n" + "".join(f"G1 X{10 * (i % 2)} Y{i} E1\n" for i in range(30)))
    with open_gcode(path) as file:
        assert "Its numbers look like relative E" in e_warning(starting_state(file.parts[0]))


def test_a_file_that_says_first_how_its_e_is_meant_is_not_guessed_at():
    """All rules read it alike: M82 or M83 stand at its top, no comment says so, and no G90 or G91 comes after them."""
    part = b"G1 X1 Y1 E1\n" * 200
    for start, said in (
        (b"G90\nM83\n", True), (b"G91\nG1 Z5\nG90\nM82\n", True), (b"M83\nG90\n", False), (b"G91\nM83\n", False),
        (b"G90\n; M83\n", False), (b"G90 ; not M82\nM82 ; after G90\n", True), (part + b"M83\n", False),
        (b"G90\nM82\n;" + b"M83" * 340_000 + b"\n" + part, True),  # a long comment costs no more than its bytes
    ):  # fmt: skip
        assert _says_e_first(start + part) is said, start[:40]
