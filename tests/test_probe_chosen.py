"""Chosen test prints: what marks tell is what least squares says, and every design can be printed and measured."""

from dataclasses import replace

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive, EccentricBore, Ellipse, Play
from printmend.errors import GcodeError, InputError
from printmend.gcode.read import Program, read_gcode
from printmend.measure.marks import read_marks
from printmend.path import Trace
from printmend.printer import Printer, read_printer
from printmend.probe import DESIGNS, cost, design_probe, expected_error_mm, turns_covered
from printmend.probe.part_layer import longest_layer_mm
from printmend.probe.tiles import belief_after, fall_of, information, prior_belief, still_unknown
from printmend.twin import Twin

MARKS = 160


def part_of(printer: Printer, size_mm: float = 70.0) -> Program:
    """A part in a quarter of the bed, lines of 5 mm distance on one layer and a square on the next."""
    x, y = printer.x.min_mm + 30, printer.y.min_mm + 40
    lines = ["G28", "G90", "M83", "G1 Z0.2 F600", f"G0 X{x} Y{y} F6000"]
    for k in range(int(size_mm / 5) + 1):
        ends = (x, x + size_mm)[:: 1 if k % 2 else -1]
        lines += [f"G1 X{end} Y{y + 5 * k} E1 F1800" for end in ends]
    lines += ["G1 Z0.4 F600", f"G1 X{x} Y{y} E1", f"G1 X{x + size_mm} Y{y} E1"]
    return read_gcode("\n".join(lines).encode(), printer=printer)


@pytest.fixture(scope="module", params=["ender3", "corexy"])
def planned(request):
    printer = read_printer(request.param)
    part = part_of(printer)
    return printer, part, {name: design_probe(printer, design=name, part=part, marks=MARKS) for name in DESIGNS}


@pytest.mark.parametrize("design", DESIGNS)
def test_it_is_small_quick_and_on_the_bed(planned, design):
    printer, _, plans = planned
    plan = plans[design]
    minutes, grams = cost(plan)
    assert minutes <= 15
    assert grams <= 5
    assert MARKS / 2 < len(plan) <= 1.2 * MARKS
    low, high = np.array([[axis.min_mm, axis.max_mm] for axis in (printer.x, printer.y)]).T
    assert (plan.waypoints_mm[1:] >= low + 3.9).all()
    assert (plan.waypoints_mm[1:] <= high - 3.9).all()
    assert (np.diff(plan.waypoints_mm, axis=0) != 0).any(axis=1).all()
    assert len(np.unique(plan.site, axis=0)) == len(plan)
    c, s = np.cos(plan.angle_rad), np.sin(plan.angle_rad)
    offset = plan.marks_mm - plan.site @ (plan.pitch_mm * np.array([[c, s], [-s, c]]))
    assert np.ptp(offset, axis=0).max() < 2 * max(printer.mm_per_step) / printer.x.microsteps


@pytest.mark.parametrize("design", DESIGNS)
def test_a_scanner_tells_its_marks_apart_on_a_damaged_printer(planned, design):
    printer, _, plans = planned
    plan = plans[design]
    broken = Corruption(
        (Drive(pulley=EccentricBore(0.6, 1.0), belt=Play(0.8)), Drive(pulley=Ellipse(6.8, 6.0, 0.3), belt=Play(1.2)))
    )
    printed = Twin.of(broken, printer).follow(plan.waypoints_mm)[plan.rows]
    printed = printed + np.random.default_rng(3).normal(0, 0.01, printed.shape)
    marks = read_marks(printed * [1, -1], plan.diameter_mm, plan)
    assert marks is not None
    assert marks.found.mean() > 0.8
    np.testing.assert_array_equal(marks.match.dot[marks.found], np.flatnonzero(marks.found))


def test_the_optimal_print_promises_the_least_error_of_the_part(planned):
    printer, part, plans = planned
    errors = {name: expected_error_mm(printer, plan, part=part) for name, plan in plans.items()}
    assert errors["optimal"] == min(errors.values())
    assert errors["optimal"] < 0.85 * errors["layer"]


def test_the_active_print_leaves_least_unknown(planned):
    printer, _, plans = planned
    belief = prior_belief(printer)
    left = {
        name: still_unknown(belief.told(belief.columns(plan.waypoints_mm, plan.rows))) for name, plan in plans.items()
    }
    assert left["active"] == min(left.values())


def test_worths_are_differences_of_what_is_known():
    printer = read_printer("ender3")
    belief = prior_belief(printer)
    plan = design_probe(printer, size_mm=60)
    columns = belief.columns(plan.waypoints_mm, plan.rows[:24])
    after = belief.told(columns)
    wanted = belief.wanted(plan.waypoints_mm[500:])
    fall = belief.expected_mm(wanted) ** 2 - after.expected_mm(wanted) ** 2
    assert fall_of(wanted)(belief, columns) == pytest.approx(fall, rel=1e-6)
    assert information(belief, columns) == pytest.approx(still_unknown(belief) - still_unknown(after), rel=1e-6)


def test_the_expected_error_is_the_error_of_ridge_least_squares():
    rng = np.random.default_rng(0)
    belief = prior_belief(read_printer("ender3"))
    columns = belief.columns(rng.uniform(20, 200, (60, 2)), np.arange(60))
    told = belief.told(columns)
    squares = []
    for _ in range(400):
        truth = rng.normal(0, np.sqrt(np.diag(belief.covariance)))
        measured = columns @ truth + rng.normal(0, belief.sigma_mm, len(columns))
        found = told.covariance @ (columns.T @ measured) / belief.sigma_mm**2
        squares.append(np.mean((columns @ (found - truth)) ** 2))
    expected = np.einsum("ij,jk,ik->", columns, told.covariance, columns) / len(columns)
    assert np.mean(squares) == pytest.approx(expected, rel=0.05)


def test_contacts_follow_the_play():
    motor_mm = np.array([10.0, 20.0, 19.9, 19.8, 19.6, 19.8, 25.0])
    touch = prior_belief(read_printer("ender3")).contacts(np.stack([motor_mm, motor_mm], axis=1))
    np.testing.assert_allclose(motor_mm[touch.row[:, 0]], [10, 20, 20, 20, 19.6, 19.6, 25])
    np.testing.assert_array_equal(touch.side[1:, 0], [-1, -1, -1, 1, 1, -1])


def test_a_first_trace_is_completed_where_it_was_blind():
    printer = read_printer("ender3")
    first = design_probe(printer, size_mm=30)
    printed = Twin.of(Corruption((Drive(belt=Play(0.5)), Drive())), printer).follow(first.waypoints_mm)
    measured = np.full_like(printed, np.nan)
    measured[first.rows] = (printed + np.random.default_rng(0).normal(0, 0.03, printed.shape))[first.rows]
    trace = Trace(first.waypoints_mm, measured, homed=True)
    part = part_of(printer)
    belief = belief_after(printer, trace)
    blind = belief.expected_mm(belief.wanted(part_ends(part)))
    second = design_probe(printer, design="optimal", part=part, after=trace, marks=60)
    assert min(turns_covered(printer, second)) > 1
    assert expected_error_mm(printer, second, part=part, after=trace) < 0.5 * blind


def part_ends(part: Program) -> np.ndarray:
    return part.moves.end_mm[part.moves.extruding, :2]


def test_the_layer_is_followed_to_its_end():
    printer = read_printer("ender3")
    part = part_of(printer)
    path = longest_layer_mm(part)
    assert len(path) == 31  # two ends a line, and where the first begins
    plan = design_probe(printer, design="layer", part=part)
    for point in path[1:]:
        assert np.abs(plan.waypoints_mm - point).max(axis=1).min() < 0.01


def test_what_cannot_be_designed_is_said():
    printer = read_printer("ender3")
    with pytest.raises(InputError, match="--for part"):
        design_probe(printer, design="layer")
    with pytest.raises(GcodeError, match="room for 16 dots"):
        design_probe(printer, design="layer", part=part_of(printer, 10.0))
    wide = replace(printer, x=replace(printer.x, max_mm=400.0), y=replace(printer.y, max_mm=400.0))
    assert cost(design_probe(wide, design="layer", part=part_of(wide, 330.0)))[0] <= 15
