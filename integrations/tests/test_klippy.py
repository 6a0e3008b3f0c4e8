"""Klipper's own planner as judge: what it makes of mended files, and where that lands on a truly broken printer."""

import re
from pathlib import Path

import numpy as np
import pytest
from parts import part

from bench_clock import clocked
from bench_klippy import both, mend
from klippy_bead import ADVANCED, bead_deviation, commanded_mm
from klippy_judge import Track, distances_mm, judge, judge_both, places, samples, slowest_mm_s, wanted_path
from klippy_run import RefusedByPlanner, plan
from printmend.corruption import Corruption, Drive, WrongRadius, corruption_toml
from printmend.corruption.frame import CrookedFrame
from printmend.corruption.transmission import Play
from printmend.export.firmware import export_klipper
from printmend.mend import mend_gcode
from printmend.model.model import exact_model, write_model
from printmend.printer import read_printer
from printmend_lab.sampling import sample
from true_printer import TruePrinter

ENDER3, COREXY = read_printer("ender3"), read_printer("corexy")
HALF_MM = 0.5 * 40 / 200 / 16 + 1e-6
TOWARDS = b"G28\nM83\nG1 Z0.2 F600\nG1 X100 Y100 F6000\n"


@pytest.mark.parametrize("printer", [ENDER3, COREXY], ids=lambda printer: printer.kinematics)
def test_the_decoded_steps_follow_the_planned_moves(printer, tmp_path: Path) -> None:
    planned = plan(part(1, arcs=True), printer, tmp_path)
    assert not planned.complaints
    place = Track(planned, printer).at(planned.end_s)
    off = np.abs(place[:, :2] - planned.end_mm[:, :2])
    assert off.max() < HALF_MM + 300 * 25e-6  # the planner may shift a step by 25 µs
    time, filament = samples(planned)
    healthy = Track(planned, printer).at(time)
    far, height = distances_mm(wanted_path(planned), healthy, filament)
    assert far.max() < np.hypot(HALF_MM, HALF_MM) + 1e-3
    assert height.max() < 0.003


def test_stops_are_counted_where_the_nozzle_stops(tmp_path: Path) -> None:
    straight = b"".join(b"G1 X%d E1 F1800\n" % x for x in range(101, 120))
    there = TOWARDS + straight
    back, corner = there + b"G1 X100 E1\n", there + b"G1 Y120 E1\n"
    for text, stops, corners in ((there, 0, 0), (back, 1, 1), (corner, 0, 1)):
        planned = plan(text, ENDER3, tmp_path)
        speed = slowest_mm_s(planned, Track(planned, ENDER3))
        assert (places(speed, 1.0), places(speed, 6.0)) == (stops, corners)
    # Slack of Y taken up at right angles, which the firmware does at 5 mm/s and more: the nozzle stands.
    slack = there + b"G1 Y99.5 F6000\nG1 X130 E1 F1800\n"
    planned = plan(slack, ENDER3, tmp_path)
    true = TruePrinter.of("[x.belt]\nkind='play'\nplay_mm=2.0\n[y.belt]\nkind='play'\nplay_mm=2.0\n", ENDER3)
    assert places(slowest_mm_s(planned, Track(planned, ENDER3, true)), 1.0) == 1


def test_the_true_printer_loses_its_play(tmp_path: Path) -> None:
    text = TOWARDS + b"G1 X120 E2 F1800\nG1 X100 Y101 E2\n"
    planned = plan(text, ENDER3, tmp_path)
    true = TruePrinter.of(corruption_toml(Corruption((Drive(belt=Play(0.5)), Drive()))), ENDER3)
    found = judge(planned, wanted_path(planned), Track(planned, ENDER3, true),
                  Track(planned, ENDER3), text)  # fmt: skip
    # Homed towards the left the belt is drawn: forwards 0.5 mm are lost, and on the way back nothing.
    assert found.max_mm == pytest.approx(0.5, abs=0.02)


def test_what_the_firmware_refuses_is_said(tmp_path: Path) -> None:
    planned = plan(part(1), ENDER3, tmp_path)
    with pytest.raises(RefusedByPlanner, match="out of range"):
        plan(b"G28\nG1 X230 Y10 F6000\n", ENDER3, tmp_path, around=planned)
    assert any("M9999" in line for line in plan(b"G28\nM9999\nG1 X20 F600\n", ENDER3, tmp_path).complaints)


FAMILIES = [
    ("pulley-play", ENDER3, {}), ("pulley-loose", COREXY, {"absolute": True}), ("everything", ENDER3, {"arcs": True}),
    ("elastic", COREXY, {"arcs": True}), ("set-screw", ENDER3, {"absolute": True}), ("smooth", COREXY, {}),
    ("screw", ENDER3, {}), ("frame", COREXY, {}),
]  # fmt: skip


@pytest.mark.parametrize(("family", "printer", "kind"), FAMILIES, ids=lambda value: getattr(value, "name", str(value)))
def test_a_mended_file_lands_where_it_should(family: str, printer, kind: dict, tmp_path: Path) -> None:
    corruption = sample(family, np.random.default_rng([3, *family.encode()]), "realistic")
    source, model, output = tmp_path / "part.gcode", tmp_path / "m.mend.json", tmp_path / "out.gcode"
    source.write_bytes(part(2, **kind))
    write_model(model, exact_model(corruption.lower(printer)))
    report = mend(source, model, output)
    before, after, complaints = both(source.read_bytes(), output.read_bytes(), printer, corruption, tmp_path / "run")
    assert not complaints
    assert after.rms_mm < 0.012
    assert after.rms_mm < report["after"]["rms_mm"] + 0.006  # half a micro-step on both motors
    assert before.rms_mm == pytest.approx(report["before"]["rms_mm"], abs=0.02, rel=0.1)
    assert after.samples == pytest.approx(before.samples, rel=1e-3)


@pytest.mark.parametrize("skew_deg", [0.7, -0.4])
def test_klipper_takes_off_the_skew_that_export_gives_it(skew_deg: float, tmp_path: Path) -> None:
    corruption, text = Corruption(frame=CrookedFrame(skew_deg=skew_deg)), part(1)
    export = dict(export_klipper(corruption.lower(ENDER3).homed()).files)["klipper.cfg"]
    (command,) = re.findall(r"^# (SET_SKEW XY=.*)$", export, re.MULTILINE)
    original = plan(text, ENDER3, tmp_path / "a")
    lines = text.replace(b"G28\n", f"G28\n{command}\n".encode())
    corrected = plan(lines, ENDER3, tmp_path / "b", around=original, extras=export)
    true = TruePrinter.of(corruption_toml(corruption), ENDER3)
    before, after, complaints = judge_both(original, corrected, ENDER3, true, text, lines)
    assert not complaints
    assert after.rms_mm < 0.012 < 0.1 < before.rms_mm


def test_klipper_takes_off_the_scale_that_export_gives_it(tmp_path: Path) -> None:
    radius_mm, text = ENDER3.x.radius_mm, part(1)
    pulleys = [Drive(pulley=WrongRadius(share * radius_mm)) for share in (0.99, 1.02)]
    corruption = Corruption((pulleys[0], pulleys[1]))
    export = dict(export_klipper(corruption.lower(ENDER3).homed()).files)["klipper.cfg"]
    assert len(re.findall(r"^rotation_distance: ", export, re.MULTILINE)) == 2
    original = plan(text, ENDER3, tmp_path / "a")
    corrected = plan(text, ENDER3, tmp_path / "b", around=original, extras=export)
    true = TruePrinter.of(corruption_toml(corruption), ENDER3)
    before, after, complaints = judge_both(original, corrected, ENDER3, true, text, text)
    assert not complaints
    assert after.rms_mm < 0.012 < 0.1 < before.rms_mm


@pytest.mark.parametrize(("family", "kind"), [("pulley-play", {}), ("everything", {"arcs": True})])
def test_the_clock_runs_as_klippers_planner(family: str, kind: dict, tmp_path: Path) -> None:
    """To a tenth of a percent, of the file as it is and mended; Klippy starts where it homed, as the clock does."""
    corruption = sample(family, np.random.default_rng([3, *family.encode()]), "realistic")
    source, output = tmp_path / "part.gcode", tmp_path / "out.gcode"
    again = part(1).replace(b"G28\n", b"")
    source.write_bytes(part(2, **kind) + b"M204 S1200\nSET_VELOCITY_LIMIT SQUARE_CORNER_VELOCITY=8\n" + again)
    mend_gcode(source, exact_model(corruption.lower(ENDER3)), output)
    original = plan(source.read_bytes(), ENDER3, tmp_path / "run")
    corrected = plan(output.read_bytes(), ENDER3, tmp_path / "run", around=original)
    for path, planned in ((source, original), (output, corrected)):
        assert clocked(path, ENDER3)[0] == pytest.approx(planned.job_s, rel=1e-3)


def test_an_even_line_has_an_even_bead(tmp_path: Path) -> None:
    """Where nothing changes nothing swells; where the line's plastic changes, pressure advance evens it out."""
    even = TOWARDS + b"".join(b"G1 X%d E0.4 F1800\n" % x for x in range(110, 201, 10))
    wide = TOWARDS + b"".join(b"G1 X%d E%.2f F1800\n" % (x, 0.4 + 0.4 * (x % 20 == 0)) for x in range(110, 201, 10))
    found = {}
    for name, text in (("even", even), ("plain", wide), ("advanced", ADVANCED + wide)):
        planned = plan(text, ENDER3, tmp_path)
        found[name] = bead_deviation(planned, Track(planned, ENDER3), wanted_path(planned))
        assert commanded_mm(planned, planned.end_s - 1e-9) == pytest.approx(planned.end_mm[:, 3], abs=1e-4)
    assert found["even"] < 0.02
    assert found["advanced"] < 0.6 * found["plain"]
