"""The law of mending: what is written, executed on an independent printer of the same fault, draws what was wanted."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from printmend.corruption import HEALTHY, Corruption, Drive, WrongRadius
from printmend.corruption.transmission import EccentricBore, Play, Ripple
from printmend.effects.effect import STROKES, strokes_of
from printmend.errors import GcodeError
from printmend.mend import mend_gcode
from printmend.mend.against import judged
from printmend.model import exact_model
from printmend.path import last_way
from printmend.plan.kernels import layout
from printmend.printer import Printer
from printmend_lab.sampling import families, sample
from tests import naive_mend
from tests.mending import BENT, COREXY, ENDER3, ENDER5, PLAY, SQUARE, START, judge, mended, tolerance_mm

FAMILIES = [name for name in families() if name != "gain-table"]


def part(printer: Printer) -> bytes:
    """A ring, a hatch in two directions and a pointed star on two layers, in the middle of the bed."""
    cx, cy = (printer.x.min_mm + printer.x.max_mm) / 2 - 5, (printer.y.min_mm + printer.y.max_mm) / 2 + 3
    lines = ["G21", "G90", "M83", "G28"]
    for layer in range(2):
        lines += [";LAYER_CHANGE", f"G1 Z{0.2 * (layer + 1):.1f} F600"]
        for radius, count, sense in ((12.0, 28, 1), (6.0, 6, -1)):
            angles = sense * np.linspace(0, 2 * np.pi, count + 1) + layer
            reach = radius * (1 + 0.3 * (np.arange(count + 1) % 2)) if count == 6 else np.full(count + 1, radius)
            x, y = cx + reach * np.cos(angles), cy + reach * np.sin(angles)
            lines += ["G1 E-1 F2400", f"G0 X{x[0]:.3f} Y{y[0]:.3f} F7200", "G1 E1 F2400"]
            lines += [
                f"G1 X{b[0]:.3f} Y{b[1]:.3f} E{0.04 * math.dist(a, b):.5f} F1800"
                for a, b in zip(zip(x, y, strict=True), zip(x[1:], y[1:], strict=True), strict=False)
            ]
        for k in range(3):
            sign = 1 if (k + layer) % 2 else -1
            lines.append(f"G0 X{cx - sign * 12:.3f} Y{cy - 5 + 2 * k - sign * layer * 6:.3f} F7200")
            lines.append(f"G1 X{cx + sign * 12:.3f} Y{cy - 5 + 2 * k + sign * layer * 6:.3f} E1.1 F3000")
    return "\n".join(lines).encode() + b"\n"


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family(family: str) -> None:
    mechanism = sample(family, np.random.default_rng(5), "damaged").lower(ENDER3).homed()
    result = judge(part(ENDER3), mechanism)
    assert result.prediction.clamped_extruding == 0
    assert result.rms_mm <= 0.6 * tolerance_mm(mechanism)
    assert result.after.max() <= 2.0 * tolerance_mm(mechanism)
    # what the program predicts is what happens
    assert result.prediction.after.rms_mm == pytest.approx(result.rms_mm, abs=0.0015)


@pytest.mark.parametrize("printer", [ENDER5, COREXY], ids=lambda printer: printer.name)
@pytest.mark.parametrize("family", ["play", "pulley-loose", "pulley-set-screw", "frame"])
def test_other_printers(printer: Printer, family: str) -> None:
    mechanism = sample(family, np.random.default_rng(3), "realistic").lower(printer).homed()
    result = judge(part(printer), mechanism)
    assert result.rms_mm <= 0.006
    assert naive_mend.rms(result.before) > result.rms_mm


def test_the_prediction_of_the_original_is_what_the_naive_printer_prints() -> None:
    result = judge(part(ENDER3), PLAY)
    assert result.prediction.before.rms_mm == pytest.approx(naive_mend.rms(result.before), rel=0.1)
    assert result.prediction.before.max_mm == pytest.approx(result.before.max(), rel=0.1)


def test_a_healthy_machine_leaves_every_byte() -> None:
    text = part(ENDER3)
    assert mended(text, HEALTHY.lower(ENDER3).homed())[0] == text


def test_a_healthy_axis_leaves_its_lines() -> None:
    one = replace(PLAY, transmissions=(PLAY.transmissions[0], HEALTHY.lower(ENDER3).transmissions[1]))
    text = START + b"G1 Y90 E1 F1800 ; up\nG1 Y70 E1\nG1 Y85 E1\n"
    lines, written = text.splitlines(), mended(text, one)[0].splitlines()
    assert written[-3:] == lines[-3:]


def test_filament_is_kept() -> None:
    result = judge(part(ENDER3), BENT)
    wanted = sum(move.filament for move in result.wanted)
    assert sum(move.filament for move in result.given) == pytest.approx(wanted, abs=1e-4)


def test_extrusion_follows_the_printed_length() -> None:
    """The filament a millimetre of printed path is the file's, within what the chords may run ahead or behind."""
    result = judge(SQUARE, BENT)
    printed = naive_mend.print_moves(result.given, BENT, pitch_mm=1000.0)
    at, densities = None, []
    for move, way in zip(result.given, printed, strict=True):
        if move.draws and at is not None:
            length = math.dist(at, way[-1])
            densities.append(move.filament / length)
        at = way[-1]
    assert np.allclose(densities, 1 / 20, rtol=0.08)


def test_speed_along_the_path_is_kept() -> None:
    result = judge(SQUARE, BENT)
    printed = naive_mend.print_moves(result.given, BENT, pitch_mm=1000.0)
    at = None
    for move, way in zip(result.given, printed, strict=True):
        if move.draws and at is not None:
            seconds = move.length / move.feed
            assert math.dist(at, way[-1]) / seconds == pytest.approx(1800, rel=0.03)
        at = way[-1]


def test_take_ups_extrude_nothing_and_do_not_move_the_nozzle() -> None:
    sharp = b"".join(b"G1 X%d Y%d E1 F1800\n" % way for way in ((80, 80), (61, 82), (79, 61), (60, 63)))
    loose = Corruption((Drive(belt=Play(1.4)), Drive(belt=Play(1.7)))).lower(ENDER3).homed()
    result = judge(START + sharp, loose)
    printed = naive_mend.print_moves(result.given, loose)
    seen, at = 0, None
    for move, way in zip(result.given, printed, strict=True):
        if at is not None and move.filament == 0 and move.start[2] > 0 and seen_square(move):
            assert np.abs(way - at).max() < 0.0015
            seen += 1
        at = way[-1]
    assert 0 < seen == result.prediction.stops <= result.prediction.takeups


def seen_square(move: naive_mend.Move) -> bool:
    return math.dist(move.start[:2], move.end[:2]) < 3 and move.start[:2] != move.end[:2]


def test_jitter_does_not_kick() -> None:
    """Reversals below the resolution take no slack up."""
    rows = [f"G1 X{60 + 0.2 * k:.3f} Y{60 + 0.001 * (k % 2):.3f} E0.01" for k in range(1, 100)]
    result = judge(START + b"G1 F1800\n" + "\n".join(rows).encode() + b"\n", PLAY)
    assert result.prediction.takeups <= 1
    assert result.after.max() < 0.006


def test_no_more_chords_than_needed() -> None:
    """The curvature of an eccentric bore of 0.5 mm asks for a chord each 1.2–4 mm."""
    result = judge(
        START + b"G1 X160 Y60 E5 F1800\n", replace(BENT, transmissions=(BENT.transmissions[0], PLAY.transmissions[1]))
    )
    assert result.after.max() < 0.006
    assert result.prediction.commands < 40


def test_chords_lie_on_both_sides_of_the_path() -> None:
    """A chord on a curvature κ that stays within ε on either side is √(16 ε/κ) long, √2 times one inside the curve."""
    mechanism = Corruption((Drive(pulley=EccentricBore(0.3, 0.5)), Drive())).lower(ENDER3).homed()
    result = judge(START + b"G1 X190 Y150 E8 F1800\n", mechanism)
    assert result.after.max() < 0.0065
    drive, line = mechanism.transmissions[0], np.array([130.0, 90.0])
    s = np.arange(0.0, np.linalg.norm(line), 0.25)
    across, along = line[1] / np.linalg.norm(line), line[0] / np.linalg.norm(line)
    motor = np.interp(60.0 + along * s, drive.lower_mm, drive.motor_mm)
    curvature = np.abs(np.gradient(np.gradient(motor, s), s)) * across
    least = np.sqrt(curvature / (16 * 0.005)).sum() * 0.25
    drawn = sum(move.draws for move in result.given)
    assert least < drawn < 1.25 * least + 1


@pytest.mark.parametrize("wall", ["X190 Y60.5", "X60 Y160"])
def test_an_outer_wall_along_an_axis_keeps_its_width(wall: str) -> None:
    """The teeth of a belt make the nozzle faster and slower along it: no piece holds speeds 3 % from its own."""
    ripple = Ripple((0.025 / ENDER3.axes[0].mm_per_step,), (2.0 / ENDER3.axes[0].mm_per_step,), (1.0,))
    mechanism = Corruption((Drive(ripple=ripple), Drive(ripple=ripple))).lower(ENDER3).homed()
    text = START + b";TYPE:External perimeter\nG1 " + wall.encode() + b" E8 F1800\n"
    result = judge(text, mechanism)
    assert result.after.max() < 0.006
    k = 0 if wall.startswith("X190") else 1
    drive, paces = mechanism.transmissions[k], []
    for move in (move for move in result.given if move.draws):
        motor = np.linspace(move.start[k], move.end[k], 50)
        belt = np.interp(motor, drive.motor_mm, drive.lower_mm)
        assert np.ptp(np.gradient(belt, motor)) < 0.066 or abs(belt[-1] - belt[0]) < 0.25
        paces.append((belt[-1] - belt[0]) / (motor[-1] - motor[0]) * move.feed)
    assert np.std(paces) < 0.01 * np.mean(paces)
    other = judge(text.replace(b"External perimeter", b"Internal infill"), mechanism)
    assert len(other.given) < len(result.given) / 4


def test_nothing_leaves_the_bed() -> None:
    text = START + b"G1 X219.9 Y60 E5 F1800\nG1 X219.9 Y219.8 E5\nG1 X0.1 Y219.8 E5\nG1 X0.1 Y0.1 E5\n"
    result = judge(text, PLAY)
    for move in result.given:
        assert min(move.end[:2]) >= -1e-9
        assert max(move.end[:2]) <= 220 + 1e-9
    assert result.prediction.clamped_extruding > 0


def test_pieces_are_not_too_short() -> None:
    mechanism = sample("ripple", np.random.default_rng(1), "realistic").lower(ENDER3).homed()
    result = judge(SQUARE, mechanism)
    lengths = [move.length for move in result.given if move.draws]
    assert min(lengths) > 0.04
    assert np.median(lengths) > 0.08


def test_klipper_takes_every_move() -> None:
    """A wide bead on a gain of 1.4 would be refused as a move of more than 0.64 mm² were it not cut."""
    mechanism = Corruption((Drive(pulley=WrongRadius(1.4 * ENDER3.x.radius_mm)), Drive())).lower(ENDER3).homed()
    result = judge(START + b"G1 X100 Y60 E9.5 F1800\n", mechanism)
    for move in result.given:
        if move.draws:
            assert move.filament * 2.405 / move.length <= 0.64 or move.filament <= 0.106


def test_plan_is_right_in_chunks_of_any_size() -> None:
    """What the end of a chunk hides of the path ahead costs a stop at most."""
    from printmend.gcode.machine import Flavour, initial_state
    from printmend.gcode.write import rewrite
    from printmend.plan import start

    text = part(ENDER3)
    lines = text.splitlines(keepends=True)
    chunks = [np.frombuffer(b"".join(lines[i : i + 7]), np.uint8) for i in range(0, len(lines), 7)]
    state = initial_state(ENDER3, Flavour.KLIPPER)
    written = b"".join(bytes(view) for view in rewrite(chunks, state, start(BENT).plan))
    whole = judge(text, BENT)
    given = naive_mend.read_moves(written, tuple(axis.home_mm for axis in ENDER3.axes))
    errors = naive_mend.contour_errors_mm(whole.wanted, given, naive_mend.print_moves(given, BENT))
    assert max(errors.max(), whole.after.max()) < 0.0105
    assert len(given) < 1.3 * len(whole.given)


def test_threads_change_no_byte(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is read, planned and written in threads, many short batches one after the other, is what one thread does."""
    from printmend.gcode import write

    monkeypatch.setattr(write, "_RECORDS", 16)
    in_threads, predicted = mended(part(ENDER3), BENT)
    monkeypatch.setattr(write, "_ahead", iter)
    in_one, alike = mended(part(ENDER3), BENT)
    assert in_threads == in_one
    assert predicted.summary() == alike.summary()


@pytest.mark.parametrize("family", ["ripple", "pulley-loose", "friction"])
def test_what_is_reported_is_what_the_files_do(family: str, tmp_path: Path) -> None:
    """RMS, 95 % and largest error, before and after, against both files read again and printed finely."""
    model = exact_model(sample(family, np.random.default_rng(2), "realistic").lower(ENDER3))
    source, output = tmp_path / "part.gcode", tmp_path / "out.gcode"
    source.write_bytes(part(ENDER3))
    said = mend_gcode(source, model, output).prediction
    found = judged(said, str(source), str(output), model.mechanism)
    for name in ("rms_mm", "p95_mm", "max_mm"):
        before, after = (getattr(errors, name) for errors in (said.before, said.after))
        assert before == pytest.approx(getattr(found.before, name), rel=0.1), name
        # Where a corner is cut the path is nearer than the line that is being drawn.
        least_mm = 0.003 if name == "max_mm" else 0.001
        assert after == pytest.approx(getattr(found.after, name), rel=0.1, abs=least_mm), name


def test_a_file_with_other_filament_is_not_the_mended_one(tmp_path: Path) -> None:
    source, output = tmp_path / "part.gcode", tmp_path / "out.gcode"
    source.write_bytes(SQUARE)
    output.write_bytes(SQUARE.replace(b"E1\n", b"E1.1\n"))
    with pytest.raises(GcodeError, match="filament"):
        judged(mended(SQUARE, PLAY)[1], str(source), str(output), PLAY)


def test_places_of_a_line_along_one_axis_know_which_way_the_other_went_last():
    """A head that tilts or a gantry that racks stays on that side, through travels, too."""
    text = START + b"G1 X80 Y80 E1 F1800\nG1 X60 E1\nG0 X70\nG0 Y60\nG1 X90 E1\nG1 Y70 E1\n"
    path = mended(text, PLAY)[1].path
    for tangent, axis, way in (([-1, 0], 1, 1), ([1, 0], 1, -1), ([0, 1], 0, 1)):
        there = np.isclose(path.tangent, tangent, atol=1e-6).all(axis=1)
        assert there.any()
        assert (path.ways[there, axis] == way).all()


def test_places_know_how_far_each_motor_has_gone_since_its_last_turns():
    """The kernel notes it move by move; the law, from the whole way."""
    assert layout.STROKES == STROKES
    corners = np.array([[80, 80], [60, 80], [90, 60], [70, 90], [85, 85], [60, 70.0]])
    lines = (f"G1 X{x:g} Y{y:g} E1\n" for x, y in corners[1:])
    path = mended(START + b"G0 X80 Y80 F1800\n" + "".join(lines).encode(), PLAY)[1].path
    way = np.concatenate([np.array([ENDER3.home_mm]), corners])
    for place, tangent, strokes in zip(path.wanted_mm, path.tangent, path.strokes_mm, strict=True):
        ways = np.diff(way, axis=0)
        at = int(np.argmax(ways @ tangent / np.hypot(*ways.T)))
        gone = ENDER3.to_motor(np.concatenate([way[: at + 1], place[None]]))
        sides = last_way(gone)
        wanted = strokes_of(gone, sides, np.zeros(2))[-1]
        known = np.isfinite(wanted)
        assert strokes[known] == pytest.approx(wanted[known], abs=0.02)
