"""The probe print excites what must be learned, stays on the bed, and says exactly what it does."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from printmend.errors import ConfigError, InputError
from printmend.measure.plan import approaches, read_plan, write_plan
from printmend.printer import Printer, read_printer
from printmend.probe import cost, design_probe, probe_gcode, turns_covered, write_probe


def beds() -> list[Printer]:
    ender3 = read_printer("ender3")
    small = replace(ender3, name="small", x=replace(ender3.x, max_mm=90.0), y=replace(ender3.y, max_mm=70.0))
    centred = replace(
        ender3,
        name="centred",
        x=replace(ender3.x, min_mm=-120.0, max_mm=120.0, home_mm=-120.0, mm_per_turn=32.0),
        y=replace(ender3.y, min_mm=-10.0, max_mm=190.0, home_mm=190.0, home_side="max", microsteps=32),
    )
    return [ender3, read_printer("ender5"), read_printer("corexy"), small, centred]


@pytest.fixture(scope="module", params=beds(), ids=lambda printer: printer.name)
def probed(request):
    return request.param, design_probe(request.param)


def last_contacts(motor_mm: np.ndarray, play_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Follow a play; return the motor position of the last contact and its side, for each way-point."""
    at, side, position = np.empty(len(motor_mm)), np.empty(len(motor_mm)), motor_mm[0] + play_mm / 2
    contact = (motor_mm[0], 1.0)
    for row, m in enumerate(motor_mm):
        if position < m - play_mm / 2:
            position, contact = m - play_mm / 2, (m, -1.0)
        elif position > m + play_mm / 2:
            position, contact = m + play_mm / 2, (m, 1.0)
        at[row], side[row] = contact
    return at, side


def features(at: np.ndarray, side: np.ndarray, turn_mm: float, middle_mm: float, length_mm: float) -> np.ndarray:
    """Both branches of a pulley with 16 harmonics, whose odd ones fade along the axis: 68 unknowns."""
    place = (at - middle_mm) / length_mm
    columns = [np.ones_like(at), place, side, side * place]
    for k in range(1, 17):
        wave = [np.cos(2 * np.pi * k * at / turn_mm), np.sin(2 * np.pi * k * at / turn_mm)]
        columns += wave
        if k % 2:
            columns += [side * wave[0], side * wave[1], place * wave[0], place * wave[1]]
    return np.stack(columns, axis=1)


def expected_rms_mm(printer: Printer, plan, motor: int, rows: np.ndarray, sigma_mm: float) -> float:
    """The RMS error of least squares on these rows, over both branches and the whole width of the marks."""
    at, side = last_contacts(printer.to_motor(plan.waypoints_mm)[:, motor], 0.3)
    low, high = printer.motor_range_mm(motor)
    turn = (printer.x, printer.y)[motor].mm_per_turn
    span = (turn, (low + high) / 2, high - low)
    design = features(at[rows], side[rows], *span)
    grid = np.linspace(at[rows].min() + 1, at[rows].max() - 1, 700)
    wanted = np.vstack([features(grid, np.full_like(grid, s), *span) for s in (-1.0, 1.0)])
    covariance = np.linalg.inv(design.T @ design)
    return sigma_mm * float(np.sqrt(np.einsum("ij,jk,ik->i", wanted, covariance, wanted).mean()))


def test_it_is_small_quick_and_on_the_bed(probed):
    printer, plan = probed
    minutes, grams = cost(plan)
    assert minutes <= 15
    assert grams <= 5
    low = np.array([printer.x.min_mm, printer.y.min_mm])
    high = np.array([printer.x.max_mm, printer.y.max_mm])
    assert (plan.waypoints_mm[1:] >= low + 3.9).all()
    assert (plan.waypoints_mm[1:] <= high - 3.9).all()
    assert (plan.marks_mm >= low + 11).all()
    assert (plan.marks_mm <= high - 11).all()
    np.testing.assert_array_equal(plan.waypoints_mm[0], printer.home_mm)


def test_way_points_are_micro_steps(probed):
    printer, plan = probed
    motors = printer.to_motor(plan.waypoints_mm)
    for motor, axis in enumerate((printer.x, printer.y)):
        micro = motors[:, motor] * axis.microsteps / axis.mm_per_step
        assert np.abs(micro - np.rint(micro)).max() < 2e-3


def test_every_angle_is_seen_in_both_directions_at_several_places(probed):
    printer, plan = probed
    motors = printer.to_motor(plan.waypoints_mm)
    direction, run = approaches(motors)
    for motor, turns in enumerate(turns_covered(printer, plan)):
        turn_mm = (printer.x, printer.y)[motor].mm_per_turn
        for sign in (-1, 1):
            rows = (direction[:, motor] == sign) & (run[:, motor] > 2.0)
            angle = np.floor(motors[rows, motor] / turn_mm % 1 * 40).astype(int)
            turn = np.floor(motors[rows, motor] / turn_mm)
            for value in range(40):
                seen = turn[angle == value]
                assert len(seen) >= (3 if printer.name == "small" else 15)
                assert len(np.unique(seen)) >= min(3, int(turns))


def test_noise_of_a_twentieth_is_learned_to_a_fiftieth():
    for printer in beds()[:3]:
        plan = design_probe(printer)
        for motor in range(2):
            assert expected_rms_mm(printer, plan, motor, np.arange(len(plan.waypoints_mm)), 0.05) < 0.01
            assert expected_rms_mm(printer, plan, motor, plan.rows, 0.05) < 0.02


def test_the_plan_says_from_where_each_mark_was_approached(probed):
    _, plan = probed
    for mark in range(0, len(plan), 7):
        for axis in range(2):
            row, run = int(plan.rows[mark]), 0.0
            sign = 0.0
            while row > 0:
                move = plan.waypoints_mm[row, axis] - plan.waypoints_mm[row - 1, axis]
                if sign and move * sign < 0:
                    break
                sign, run, row = sign or np.sign(move), run + abs(move), row - 1
            assert plan.direction[mark, axis] == sign
            assert plan.reversal_mm[mark, axis] == pytest.approx(run, abs=1e-4)


def test_marks_lie_on_their_lattice_and_never_touch(probed):
    printer, plan = probed
    c, s = np.cos(plan.angle_rad), np.sin(plan.angle_rad)
    lattice = plan.site @ (plan.pitch_mm * np.array([[c, s], [-s, c]]))
    offset = plan.marks_mm - lattice
    assert np.ptp(offset, axis=0).max() < 2 * max(printer.mm_per_step) / printer.x.microsteps
    assert len(np.unique(plan.site, axis=0)) == len(plan)
    assert plan.pitch_mm > 2.5 * plan.big_dot_mm


def test_reversals_shrink_from_eight_millimetres_to_a_tenth(probed):
    printer, plan = probed
    _, run = approaches(printer.to_motor(plan.waypoints_mm))
    for motor in range(2):
        runs = run[plan.rows, motor]
        for low, high in ((0.1, 0.3), (0.3, 0.7), (0.7, 1.3), (1.3, 2.2), (2.2, 4), (4, 7), (7, 9)):
            assert ((runs > low) & (runs < high)).sum() >= 2


def test_the_code_of_large_dots_fits_in_one_place_only(probed):
    _, plan = probed
    code = {tuple(site): (1 if big else -1) for site, big in zip(plan.site.tolist(), plan.big, strict=True)}
    for turned in ((1, 0, 0, 1), (0, 1, -1, 0), (-1, 0, 0, -1), (0, -1, 1, 0), (1, 0, 0, -1), (0, 1, 1, 0)):
        for di in range(-4, 5):
            for dj in range(-4, 5):
                if turned == (1, 0, 0, 1) and di == dj == 0:
                    continue
                a, b, c, d = turned
                other = [(value, code.get((a * i + b * j + di, c * i + d * j + dj))) for (i, j), value in code.items()]
                agree = np.mean([value == theirs for value, theirs in other if theirs is not None])
                assert agree < 0.9


def test_the_gcode_visits_the_plan_and_extrudes_at_the_marks(probed):
    _, plan = probed
    visited, position, dots = [plan.waypoints_mm[0]], None, []
    for line in probe_gcode(plan).splitlines():
        words = dict(re.findall(r"([XYZEF])(-?[\d.]+)", line.split(";")[0]))
        if line.startswith(("G0", "G1")) and "X" in words:
            position = np.array([float(words["X"]), float(words["Y"])])
            visited.append(position)
        elif line.startswith("G1 E0") and float(words["F"]) == 120:
            dots.append(position)
    np.testing.assert_allclose(np.array(visited), plan.waypoints_mm, atol=1e-9)
    np.testing.assert_allclose(np.array(dots), plan.marks_mm, atol=1e-9)


def test_a_smaller_print_can_be_asked_for():
    printer = read_printer("ender3")
    with pytest.raises(ConfigError, match=r"--size: expected at most \d+ mm on .*, found 1000 mm"):
        design_probe(printer, size_mm=1000)
    plan = design_probe(printer, size_mm=80)
    assert (np.abs(plan.marks_mm - 110) <= 40.01).all()
    with pytest.raises(ConfigError, match="30 mm"):
        design_probe(replace(printer, x=replace(printer.x, max_mm=40.0)))


def test_a_design_that_is_none_is_named():
    with pytest.raises(ConfigError, match="one of fixed, layer, optimal, active, found 'best'"):
        design_probe(read_printer("ender3"), design="best")


def test_a_plan_is_read_back(probed, tmp_path: Path):
    _, plan = probed
    path = write_probe(tmp_path / "probe.gcode", plan)
    assert path == tmp_path / "probe.json"
    back = read_plan(path)
    for name in plan.__dataclass_fields__:
        theirs, ours = getattr(back, name), getattr(plan, name)
        if isinstance(ours, np.ndarray):
            np.testing.assert_allclose(theirs, ours, atol=1e-5)
        else:
            assert theirs == ours


@pytest.mark.parametrize(
    ("damage", "named"),
    [
        (lambda text: text[:200], "not JSON"),
        (lambda text: "{}", "another JSON"),
        (lambda text: text.replace('"version": 1', '"version": 9'), "version 9"),
        (lambda text: text.replace('"row": ', '"line": '), "whole probe.json"),
        (lambda text: text.replace('"x_mm": ', '"x_mm": 3'), "whole probe.json"),
        (lambda text: text.replace('"version": 1', '"version": 1, "paper": "yes"'), "neither true nor false"),
    ],
)
def test_a_broken_plan_ends_in_one_line(tmp_path, damage, named):
    path = tmp_path / "probe.json"
    write_plan(path, design_probe(read_printer("ender3"), size_mm=60))
    path.write_text(damage(path.read_text()))
    with pytest.raises(InputError, match=named):
        read_plan(path)
