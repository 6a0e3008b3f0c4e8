"""Every state of a machine that a rewriter must follow: modes, units, offsets, homing, and what makes it uncertain."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from printmend.gcode.machine import Flavour, initial_state
from printmend.gcode.read import interpret_text
from printmend.gcode.write import rewrite
from printmend.machine import Mechanism
from printmend.plan import start
from printmend.printer import Printer
from printmend_lab.sampling import families, sample
from tests import naive_mend
from tests.mending import BENT, COREXY, ENDER3, PLAY, SQUARE, START, Judged, judge, mended, tolerance_mm

MODELS = pytest.mark.parametrize("mechanism", [PLAY, BENT], ids=["play", "bent"])


def right(judged: Judged) -> None:
    assert naive_mend.rms(judged.before) > 0.1
    assert judged.rms_mm <= 0.006
    assert judged.after.max() <= 0.012
    wanted = sum(move.filament for move in judged.wanted)
    assert sum(move.filament for move in judged.given) == pytest.approx(wanted, abs=1e-4)


@MODELS
def test_relative_moves(mechanism) -> None:
    text = (
        START
        + b"G91\nG1 X20 E1 F1800\nG1 Y20 E1\nG1 X-7.3 Y-3 E1\nG0 X5 F6000\nG1 X3 Y-9 E1 F1800\nG90\nG1 X60 Y60 E1\n"
    )
    right(judge(text, mechanism))


def test_relative_moves_do_not_add_up_rounding() -> None:
    steps = b"G1 X0.333 Y0.111 E0.01\nG1 X-0.111 Y0.333 E0.01\n" * 60
    judged = judge(START + b"G91\nG1 F1800\n" + steps, BENT)
    assert judged.rms_mm <= 0.006
    assert judged.after[-20:].max() <= 0.012


@MODELS
def test_inches(mechanism) -> None:
    text = (
        b"G90\nM83\nG28\nG20\nG1 Z0.01 F24\nG0 X2.4 Y2.4 F240\n"
        b"G1 X3.2 E.04 F72\nG1 Y3.2 E.04\nG1 X2.4 Y2.5 E.04\nG21\nG1 X60 Y62 E1\n"
    )
    right(judge(text, mechanism))


@MODELS
def test_absolute_extrusion(mechanism) -> None:
    text = (
        START.replace(b"M83", b"M82") + b"G92 E0\nG1 X80 E1 F1800\nG1 Y80 E2\nG1 E1 F2400\nG0 X70 F6000\nG1 E2 F2400\n"
        b"G1 X60 Y61 E3 F1800\nG92 E0\nG1 X62 Y80 E1\n"
    )
    right(judge(text, mechanism))


@pytest.mark.parametrize("flavour", list(Flavour))
def test_every_firmware_rule_for_e(flavour: Flavour) -> None:
    """Whatever G91 does to E on that firmware, its total is kept."""
    text = START + b"G91\nG1 X20 E1 F1800\nG90\nG1 X60 Y80 E2\n"
    written, _ = mended(text, BENT, flavour)
    again = initial_state(ENDER3, flavour)
    first = initial_state(ENDER3, flavour)
    ends = [interpret_text(np.frombuffer(t, np.uint8), s) for t, s in ((text, first), (written, again))]
    assert ends[0]["advance"].sum() == pytest.approx(ends[1]["advance"].sum(), abs=1e-4)


@MODELS
@pytest.mark.parametrize("then", [b"", b"M218 T1 X3\n", b"G10 L2 P3 X3\n"], ids=["", "tool", "work"])
def test_set_position(mechanism, then: bytes) -> None:
    """G92 X Y shifts the coordinates; the mended machine stands elsewhere when it reads it. What is set for another
    tool or another zero shifts nothing."""
    text = START + b"G92 X10 Y10\nG1 X30 E1 F1800\nG1 Y30 E1\nG1 X10 Y12 E1\nG92 X60 Y62\n" + then
    text += b"G1 X70 Y70 E1\n"
    right(judge(text, mechanism))


@MODELS
def test_homing_again(mechanism) -> None:
    right(judge(SQUARE + b"G28 X Y\nG0 X100 Y100 F6000\nG1 X120 Y90 E1 F1800\nG1 X100 Y80 E1\n", mechanism))


@MODELS
def test_homing_one_axis(mechanism) -> None:
    right(judge(SQUARE + b"G28 X\nG0 X100 Y70 F6000\nG1 X120 Y90 E1 F1800\nG1 X100 Y80 E1\n", mechanism))


def test_homing_says_which_side_the_belts_rest_on() -> None:
    """The switch stopped the carriage on its way towards it: the first reversal takes up the slack, nothing more."""
    text = b"G90\nM83\nG28\nG1 X20 Y15 E1 F1800\nG1 X5 Y5 E1\n"
    judged = judge(text, PLAY)
    assert judged.prediction.anchors == 0
    assert judged.prediction.takeups == 2
    assert judged.rms_mm <= 0.006
    assert judged.after.max() <= 0.012


def test_a_model_with_another_origin_is_anchored_after_homing() -> None:
    """A printer that backs off from its switch, or a trace that began with the belt loose: the side is not known."""
    loose = replace(PLAY, transmissions=(PLAY.transmissions[0].shifted(-0.1), PLAY.transmissions[1].shifted(0.2)))
    text = b"G90\nM83\nG28\nG1 X20 Y15 E1 F1800\nG1 X5 Y5 E1\n"
    judged = judge(text, loose)
    assert judged.prediction.anchors == 1
    assert judged.rms_mm <= 0.006


@MODELS
def test_homing_one_axis_keeps_the_other_belt(mechanism) -> None:
    """After G28 X the mended Y is another number than the file's, and its belt rests where it was."""
    text = START + b"G1 X80 Y80 E1 F1800\nG28 X\nG1 X30 Y60 E1\nG1 X50 E1\nG28 Y\nG91\nG1 X-10 Y30 E1\nG1 X10 Y-10 E1\n"
    right(judge(text, mechanism))


@MODELS
def test_firmware_retraction(mechanism) -> None:
    text = START + b"G1 X80 E1 F1800\nG10\nG0 X60 Y65 F6000\nG11\nG1 X80 E1 F1800\nG1 Y80 E1\n"
    judged = judge(text, mechanism)
    right(judged)
    assert b"G10\n" in judged.text
    assert b"G11\n" in judged.text


@MODELS
def test_modal_feed(mechanism) -> None:
    """Lines without F keep the speed that they had, whatever was written in between."""
    text = START + b"G1 F1800\nG1 X80 E1\nG1 Y80 E1\nG1 X60 E1\nG1 E-1\nG0 X70 Y70\nG1 E1\n"
    judged = judge(text, mechanism)
    feeds = {move.line: move.feed for move in judged.given if move.start[:2] == move.end[:2] and move.filament}
    assert set(feeds.values()) == {1800.0}


SURE = b"G1 X80 E1 F1800\nG1 Y80 E1\n"
AGAIN = b"G1 X60 Y70 E1\nG1 X64 Y60 E1\n"


@pytest.mark.parametrize(
    "event",
    [b"PAUSE", b"M600", b"M0", b"M25", b"M486 S1", b"EXCLUDE_OBJECT_START NAME=a", b"EXCLUDE_OBJECT_END NAME=a",
     b"@pause", b"@Object a"],
)  # fmt: skip
def test_pauses_and_objects_are_anchored_again(event: bytes) -> None:
    """The belts may be anywhere in their play afterwards: wherever they are, the next line is where it should be."""
    judged = judge(START + SURE + event + b"\n" + AGAIN, PLAY)
    assert judged.prediction.anchors >= 1
    moves, rest = split(judged, event)
    for disturbed in np.linspace(0, 1, 5):
        printed = print_disturbed(moves, rest, float(disturbed))
        wanted = [move for move in judged.wanted if move.draws]
        assert naive_mend.contour_errors_mm(wanted, rest, printed).max() < 0.0105


def split(judged: Judged, event: bytes) -> tuple[list[naive_mend.Move], list[naive_mend.Move]]:
    line = judged.text.splitlines().index(event)
    return [m for m in judged.given if m.line < line], [m for m in judged.given if m.line > line]


def print_disturbed(before: list, after: list, share: float) -> list[np.ndarray]:
    """Print ``after`` with the belts at ``share`` of their play, wherever the first moves left them."""
    belts = np.array(before[-1].end[:2])
    printed = []
    for motor, table in enumerate(PLAY.transmissions):
        lower, upper = table.branches_mm(np.array([before[-1].end[motor]]))
        belts[motor] = (1 - share) * lower[0] + share * upper[0]
    for move in after:
        count = 40
        places = np.linspace(move.start[:2], move.end[:2], count + 1)[1:]
        way = np.empty((count, 2))
        for motor, table in enumerate(PLAY.transmissions):
            lower, upper = table.branches_mm(places[:, motor])
            for i in range(count):
                belts[motor] = min(max(belts[motor], lower[i]), upper[i])
                way[i, motor] = belts[motor]
        printed.append(way)
    return printed


@pytest.mark.parametrize("event", [b"TIMELAPSE_TAKE_FRAME", b"M6 T1", b"G29", b"M84", b"CLEAN_NOZZLE X=1", b"G27"])
def test_lost_places_are_found_again(event: bytes) -> None:
    """After a macro nothing is known until both axes are named; then the next extruding line is anchored."""
    text = START + SURE + event + b"\nG0 X100 Y100 F6000\nG1 X90 E1 F1800\nG1 Y90 E1\n"
    judged = judge(text, PLAY)
    assert judged.prediction.anchors >= 1
    assert judged.rms_mm <= 0.006


def test_what_is_lost_is_left_alone() -> None:
    text = START + SURE + b"CLEAN_NOZZLE\nG91\nG1 X5 E1\nG1 Y5 E1\n"
    written, prediction = mended(text, PLAY)
    assert written.endswith(b"CLEAN_NOZZLE\nG91\nG1 X5 E1\nG1 Y5 E1\n")
    lines = text.count(b"\n")
    assert prediction.unknown == 2
    assert prediction.unknown_lines == (lines - 1, lines)
    assert f"(lines {lines - 1}, {lines})" in prediction.summary()


def test_dots_and_where_lines_begin_are_on_the_bed_or_not() -> None:
    dots = START + b"G1 X80 Y60 E1 F1800\nG0 X90 Y95\nG1 E.05\n"
    assert "it stays on the bed: X 60 to 90, Y 60 to 95 mm" in mended(dots, PLAY)[1].summary()
    told = mended(START + b"G0 X90 Y95\nG1 E.05\n", PLAY)[1].json()
    assert (told["low_mm"], told["printed_low_mm"]) == (None, (90.0, 95.0))
    assert mended(START + b"G0 X90 Y95\n", PLAY)[1].json()["printed_low_mm"] is None
    purged = START + b"G0 X-3 Y60\nG1 X80 Y60 E1 F1800\n"
    prediction = mended(purged, PLAY)[1]
    assert (prediction.low_mm, prediction.printed_low_mm) == ((80.0, 60.0), (-3.0, 60.0))
    assert "it prints beyond the edge of the bed, as the file says: X −3 to 80" in prediction.summary()


def test_still_commands_need_no_anchor() -> None:
    text = START + SURE + b"SET_PRESSURE_ADVANCE ADVANCE=0.03\nM204 S500\nM106 S255\nM104 S200\nM73 P5\n" + AGAIN
    assert judge(text, PLAY).prediction.anchors == judge(START + SURE + AGAIN, PLAY).prediction.anchors


@MODELS
def test_saved_state(mechanism) -> None:
    text = (
        START
        + SURE
        + b"SAVE_GCODE_STATE NAME=a\nG91\nG1 Z1 F600\nRESTORE_GCODE_STATE NAME=a\nG1 Z.2 F600\n"
        + b"G1 F1800\n"
        + AGAIN
    )
    written, prediction = mended(text, mechanism)
    assert prediction.unknown == 0
    assert prediction.after.rms_mm < 0.006
    assert b"RESTORE_GCODE_STATE NAME=a\n" in written


STATES = {
    "zero": b"SAVE_GCODE_STATE NAME=a\nG92 X10 Y10\nG1 X30 Y12 E1\nRESTORE_GCODE_STATE NAME=a\n",
    "back": b"SAVE_GCODE_STATE NAME=a\nG0 X120 Y90 F6000\nRESTORE_GCODE_STATE NAME=a MOVE=1\n",
    "zero and back": b"SAVE_GCODE_STATE NAME=a\nG92 X0 Y0\nG0 X30 Y-12\nRESTORE_GCODE_STATE NAME=a MOVE=1\n",
    "zero before": b"G92 X0 Y0\nSAVE_GCODE_STATE\nG92 X5\nG1 X9 Y9 E1\nRESTORE_GCODE_STATE\nG1 X3 Y3 E1\nG92 X63 Y83\n",
    "relative": b"SAVE_GCODE_STATE NAME=a\nG91\nG1 X5 Y3 E1\nRESTORE_GCODE_STATE NAME=a MOVE=1\n",
    "two": b"SAVE_GCODE_STATE NAME=a\nG0 X90 Y60\nSAVE_GCODE_STATE NAME=b\nG0 X70 Y90\n"
    b"RESTORE_GCODE_STATE NAME=b MOVE=1\nG1 X85 Y64 E1\nRESTORE_GCODE_STATE NAME=a MOVE=1\n",
    "offset": b"SET_GCODE_OFFSET X=3 Y_ADJUST=-2 MOVE=1\nG1 X70 Y75 E1\nSET_GCODE_OFFSET X=0 Y=0\n",
    "macro": b"SAVE_GCODE_STATE NAME=a\nCLEAN_NOZZLE\nRESTORE_GCODE_STATE NAME=a MOVE=1\n",
}


@MODELS
@pytest.mark.parametrize("name", STATES)
def test_states_are_restored_on_mended_places(mechanism, name: str) -> None:
    """What is saved and restored is the mended machine's place and zero; the line after it extrudes at once."""
    after = b"G1 F1800\nG91\nG1 X-6 Y-9 E1\nG90\n" + AGAIN
    judged = judge(START + SURE + STATES[name] + after, mechanism)
    assert judged.prediction.unknown == 0
    assert judged.prediction.anchors == (name == "macro")
    right(judged)


def ends_of(written: bytes, flavour: Flavour) -> list[tuple[float, float]]:
    rows = interpret_text(np.frombuffer(written, np.uint8), initial_state(ENDER3, flavour))
    return [(row["x1"], row["y1"]) for row in rows if row["advance"] > 0]


@pytest.mark.parametrize("line", [b"G10 L20 P1 X0 Y0", b"G10 L20 P2 X0 Y0 ; zero\nG55"])
def test_a_work_zero_lies_where_the_file_has_it(line: bytes) -> None:
    """G10 L20 counts from where the mended head is, as G92 does."""
    moves = b"G1 X5 Y-9 E1\nG1 X-10 Y3 E1\n"
    found, wanted = (
        ends_of(mended(START + SURE + zero + b"\n" + moves, BENT, Flavour.RRF)[0], Flavour.RRF)
        for zero in (line, b"G92 X0 Y0")
    )
    assert np.array(found) == pytest.approx(np.array(wanted), abs=0.0015)


BLOCKS = {
    "while": b"while iterations < 3\n  G1 X90 Y70 E2 F1800\n  G1 X60 Y90 E2\n",
    "if": b"if global.purge\n\tG1 X90 Y20\n\tM120\n\tG91\n\tG1 Z1\n\tM121\nelif a\n    G92 E0\nelse\n  G28\n",
    "inside": b"  if a\n    while true\n      G1 X80\n    G1 X70 E1\n",
}


@MODELS
@pytest.mark.parametrize("name", BLOCKS)
def test_a_block_stays_as_it_is(mechanism, name: str) -> None:
    """Nobody knows how often it is obeyed: no line is put into it, and what it may have moved is found again."""
    again = b"G90\nM83\nG0 X60 Y61 F6000\nG1 X80 Y75 E1 F1800\nG1 X60 Y60 E1\n"
    text = START + SURE + BLOCKS[name] + b"G1 X62 E1\n" + again
    written, prediction = mended(text, mechanism, Flavour.RRF)
    assert BLOCKS[name] in written
    assert prediction.unknown == len(re.findall(rb"G1.* E", BLOCKS[name])) + 1
    left_mm, after = prediction.length_mm - prediction.mended_mm, prediction.after
    assert left_mm > 0
    assert after.rms_mm**2 * prediction.length_mm < 0.006**2 * prediction.mended_mm + after.max_mm**2 * left_mm
    judged = judge(START + SURE + again, mechanism)
    assert np.array(ends_of(written, Flavour.RRF)[-1]) == pytest.approx(judged.given[-1].end[:2], abs=0.02)


def test_lines_that_stay_as_they_are_count_in_the_figures() -> None:
    """They are off as before, and where they are most of a file mending it is no gain; the line to blame is named."""
    whole = mended(SQUARE, PLAY)[1]
    text = START.replace(b"G0 X60", b"/G91\nG0 X60") + SQUARE[len(START) :]
    prediction = mended(text, PLAY)[1]
    assert (prediction.mended_mm, prediction.length_mm) == (0.0, pytest.approx(whole.length_mm))
    assert not prediction.is_better
    assert prediction.after.rms_mm == pytest.approx(whole.before.rms_mm, abs=0.02)
    assert prediction.doubted_line == text.splitlines().index(b"/G91") + 1
    assert f"The cause is line {prediction.doubted_line}" in prediction.summary()


def test_what_m120_saves_is_brought_back() -> None:
    """Also the speed, which the mended file has at another value there."""
    aside = b"M120\nG91\nG1 Z1 F600\nM121\n"
    text = START + SURE + aside + b"G1 X60 Y70 E1\nG1 X64 Y60 E1\n"
    written, prediction = mended(text, BENT, Flavour.RRF)
    assert prediction.unknown == 0
    plain, _ = mended(text.replace(aside, b""), BENT, Flavour.RRF)
    rows = [
        interpret_text(np.frombuffer(each, np.uint8), initial_state(ENDER3, Flavour.RRF)) for each in (written, plain)
    ]
    for name in ("x1", "y1", "feed"):
        assert rows[0][name][-1] == pytest.approx(rows[1][name][-1])


@pytest.mark.parametrize("letter", [b"A", b"B", b"C", b"U", b"V", b"W"])
@pytest.mark.parametrize("mode", [b"G90", b"G91"])
def test_a_further_axis_goes_as_far_as_the_file_says(letter: bytes, mode: bytes) -> None:
    line = b"G1 X80 Y85 " + letter + b"3 E1\n"
    written, prediction = mended(START + b"G1 X80 Y60 E1 F1800\n" + mode + b"\n" + line, BENT, Flavour.RRF)
    assert prediction.commands > prediction.moves
    assert written.count(letter + b"3") == 1


def test_a_forgotten_zero_is_forgotten() -> None:
    """G92.1 after a zero that was set on a mended place."""
    text = START + SURE + b"G92 X0 Y0\nG1 X5 Y-9 E1\nG92.1\n" + AGAIN
    written, _ = mended(text, BENT)
    ends = []
    for source in (text, written):
        rows = interpret_text(np.frombuffer(source, np.uint8), initial_state(ENDER3, Flavour.KLIPPER))
        ends.append((rows[-1]["x1"], rows[-1]["y1"]))
    assert ends[1] == pytest.approx(judge(START + SURE + AGAIN, BENT).given[-1].end[:2], abs=0.02)
    assert ends[0] == (64, 60)


def test_corexy_is_mended_in_motor_space() -> None:
    """A play of motor A alone: a move along x reverses both motors, one along the diagonal only one."""

    from printmend.corruption import Corruption, Drive
    from printmend.corruption.transmission import Play

    one = Corruption((Drive(belt=Play(0.5)), Drive())).lower(COREXY).homed()
    text = START + b"G1 X80 Y80 E1 F1800\nG1 X60 Y100 E1\nG1 X80 Y80 E1\n"
    judged = judge(text, one)
    assert judged.rms_mm <= 0.006
    # x − y is all that changes on the way along the other diagonal: motor A stands still, no slack is taken up
    assert judged.prediction.takeups == 0
    back = judge(text + b"G1 X60 Y60 E1\n", one)
    assert back.prediction.takeups == 1
    assert back.rms_mm <= 0.006


def test_offsets_are_followed() -> None:
    text = START + SURE + b"SET_GCODE_OFFSET X=1 Y=2\n" + b"G1 X60 Y70 E1\nG1 X64 Y60 E1\n"
    planner, state = start(PLAY), initial_state(ENDER3, Flavour.KLIPPER)
    written = b"".join(bytes(v) for v in rewrite([np.frombuffer(text, np.uint8)], state, planner.plan))
    rows = interpret_text(np.frombuffer(written, np.uint8), initial_state(ENDER3, Flavour.KLIPPER))
    assert math.dist((rows[-1]["x1"], rows[-1]["y1"]), (65, 62)) < 1.0


EVERYTHING = (
    START + b"G1 X80 Y62 E1 F1800\nG91\nG1 X-7.3 Y9 E.5\nG1 Y3 E.2\nG90\nG92 X10 Y10\nG1 X25 Y12 E1\nG92 X87.7 Y76\n"
    b"M82\nG92 E0\nG1 X70 Y80 E1\nG10\nG0 X64 Y70 F6000\nG11\nG1 Y60 E2 F1800\nM83\nG20\nG1 X3.1 Y2.5 E.04\nG21\n"
    b"SAVE_GCODE_STATE NAME=a\nG92 X0 Y0\nG1 X5 Y9 E.4\nRESTORE_GCODE_STATE NAME=a MOVE=1\nG1 X70 E.3\nPAUSE\n"
    b"G1 X60 Y66 E.5\nG28 X\nG0 X75 F6000\nG2 X85 Y70 I5 J1 E.9 F1800\nG1 E-1 F2400\nG1 Z.6\nG3 X70 Y60 I-9 J-2\n"
    b"G1 Z.2\nG1 E1\nG3 X62 Y58 R9 E.6 F1800\nEXCLUDE_OBJECT_START NAME=b\nG1 X80 Y75 E1\n"
    b"SET_GCODE_OFFSET X=1 Y=-1 MOVE=1\nG1 X60 E1\nG1 X60 E-.1\nG1 Y60 F1200\nG1 E.1\ng1x70y64e.4\nX60 Y70 E.4\n"
    b"G28\nG0 X90 Y80 F6000\nG1 X70 Y90 E1 F1800\n"
)


@pytest.mark.parametrize(
    ("family", "printer"),
    [(name, ENDER3) for name in families() if name != "gain-table"]
    + [(name, COREXY) for name in ("play", "pulley-loose", "elastic", "frame")],
    ids=lambda value: getattr(value, "name", value),
)
def test_every_family_with_every_state(family: str, printer: Printer) -> None:
    mechanism = sample(family, np.random.default_rng(9), "realistic").lower(printer).homed()
    judged = judge(EVERYTHING, mechanism)
    assert judged.rms_mm <= 0.6 * tolerance_mm(mechanism)
    assert judged.after.max() <= 1.5 * tolerance_mm(mechanism)
    wanted = sum(move.filament for move in judged.wanted)
    assert sum(move.filament for move in judged.given) == pytest.approx(wanted, abs=1e-4)


@pytest.mark.parametrize(("mechanism", "most_mm"), [(PLAY, np.hypot(0.4, 0.7)), (BENT, np.hypot(1.4, 1.2))])
def test_a_file_without_homing_tells_of_its_uncertain_start(mechanism: Mechanism, most_mm: float) -> None:
    """Its first line is drawn from wherever the head is: as far off as the printer errs, no farther than is said."""
    text = START.replace(b"G28\n", b"").replace(b"G0 X60 Y60 F6000\n", b"") + b"G1 X80 Y60 E1 F1800\nG1 X80 Y80 E1\n"
    judged = judge(text, mechanism)
    assert judged.prediction.unknown == 1
    assert judged.prediction.after.max_mm <= most_mm + 1e-6
    assert 0.3 < judged.after.max() <= judged.prediction.after.max_mm


def test_an_unread_line_is_predicted_as_it_is() -> None:
    """Longer than a statement may be: copied, and off as much as it was."""
    long = b"G1 X80 Y85 E1 " + b"Q1 " * 3000 + b"\n"
    judged = judge(START + b"G1 X80 Y60 E1 F1800\nG1 X70 Y90 E1\n" + long + b"G1 X60 Y60 E1\n", PLAY)
    assert long in judged.text
    assert judged.after.max() > 0.1
    # looked at every 2 mm
    assert 0.7 < judged.prediction.after.max_mm / judged.after.max() < 1.05


def test_an_unknown_side_is_no_promise_of_nought() -> None:
    """Both ways of a line are the same for belts that hang loose: their play remains."""
    loose = replace(PLAY, rest_share=(0.5, 0.5))
    text = START + SURE + b"PAUSE\nG1 X60.1 E1\n"
    assert mended(text, loose)[1].before.rms_mm > 0.1
