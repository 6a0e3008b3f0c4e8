"""What a model promises: the budget, the range, what may act; each against a machine that is known."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from printmend.cli.main import group
from printmend.corruption import Corruption, CrookedFrame, Drive, EccentricBore, Ellipse, Play, Polygon
from printmend.errors import ModelError, RefusedError, TraceError
from printmend.export.firmware import remainder
from printmend.export.supported import export_supported
from printmend.gcode.container import open_gcode
from printmend.identify.drive import Rows
from printmend.identify.drive.machines import MACHINES
from printmend.learn.greybox import motor_rows
from printmend.machine import Frame
from printmend.measure.distance import scaled_by, settled
from printmend.measure.measurement import instrument_on_bed
from printmend.measure.table import read_trace, write_trace
from printmend.path import FLATBED, Instrument, Trace, last_way
from printmend.picture.paper import PAPER
from printmend.printer import Printer, read_printer
from printmend.probe import design_probe
from printmend.promise.apply import believe
from printmend.promise.budget import DIRECTIONS, parse_budget
from printmend.promise.effects import EARLY, ENDED, LEARNED, DrawnCause, Effect
from printmend.promise.misfit import misfit_section, refusals
from printmend.promise.predict import (
    DRAWS,
    Errors,
    PathPlaces,
    Promise,
    _directions,
    _largest_of,
    _Side,
    _summed_up,
    _thinned,
    _weighted_p95,
    promised,
    shape_of,
)
from printmend.promise.scale import in_words, scale_words
from printmend.promise.section import KEPT_VARIANCE_SHARE, kept_directions
from printmend.promise.unexplained import unexplained
from printmend.repair import check_gcode, mend_gcode
from printmend.repair.against import judge_gcode
from printmend.repair.history import read_history, rows_of
from printmend.repair.learned import learn_model, report
from printmend.repair.mend import _check_worth_writing, is_healthy
from printmend.repair.prediction import advice_of
from printmend.repair.update import Updated
from printmend.repair.verify import BROKEN, KEPT, UNSURE, expectation, update_words, updated, verify
from printmend.report.part_view import look_at
from printmend.saved.model import SavedModel, exact_model, read_model, write_model
from printmend.studio.scene import as_printed, read_drawing
from printmend.twin import Twin
from tests.mending import SQUARE
from tests.test_greybox_learning import stairs

ENDER3 = read_printer("ender3")
HEALTHY = Corruption((Drive(), Drive()))
BENT = Corruption((Drive(pulley=EccentricBore(0.4, 1.0), belt=Play(0.3)), Drive(belt=Play(0.2))))
SLIPPED = Corruption((Drive(pulley=EccentricBore(0.4, 2.0), belt=Play(0.3)), Drive(belt=Play(0.2))))
CIRCLE = "G21\nG90\nM83\nG28\nG1 Z0.2 F600\nG0 X140 Y110 F6000\n" + "".join(
    f"G1 X{110 + 30 * np.cos(t):.3f} Y{110 + 25 * np.sin(t):.3f} E0.05 F1800\n"
    for t in np.linspace(0, 2 * np.pi, 181)[1:]
)


def measured(corruption: Corruption, noise_mm: float, seed: int, points: int = 700, printer: Printer = ENDER3) -> Trace:
    way = stairs(points)
    noise = np.random.default_rng(seed).normal(0, noise_mm, way.shape)
    return Trace(way, Twin.of(corruption, printer).follow(way) + noise, homed=True)


def scanned(trace: Trace, stretch: np.ndarray, instrument: Instrument | None = None) -> Trace:
    """Return the trace as an instrument sees it that stretches and knows no place."""
    moved = (trace.measured_mm - 100.0) @ (np.eye(2) + stretch).T + [95.0, 104.0]
    return replace(trace, measured_mm=moved, placed=False, instrument=instrument)


@pytest.fixture(scope="module")
def bent() -> SavedModel:
    return learn_model(measured(BENT, 0.05, 1), ENDER3)


@pytest.fixture
def part(tmp_path: Path) -> Path:
    (tmp_path / "part.gcode").write_text(CIRCLE)
    return tmp_path / "part.gcode"


def test_the_promise_is_kept_and_says_what_it_is_made_of(bent: SavedModel, part: Path) -> None:
    done = mend_gcode(part, bent, part.with_name("out.gcode"))
    plain = json.loads(json.dumps(done.prediction.json()))
    after = plain["after"]
    assert plain["made_of"] == after["made_of"]
    assert plain["planning_rms_mm"] == after["planning_rms_mm"] < 0.003
    assert {"parameters", "unexplained", "rounding", "planning"} <= set(after["made_of"])
    assert sum(share**2 for share in after["made_of"].values()) == pytest.approx(after["rms_mm"] ** 2, rel=1e-6)
    truth = judge_gcode(part, part.with_name("out.gcode"), Twin.of(BENT, ENDER3))
    assert 0.5 * after["rms_low_mm"] < truth.after.rms_mm < after["rms_high_mm"] < 0.04  # the twin has no micro-steps
    assert after["rms_low_mm"] < after["rms_mm"] < after["rms_high_mm"]
    assert after["rms_mm"] < after["p95_mm"] < after["max_mm"] < 0.12
    assert after["rms_high_mm"] < after["max_mm"]
    before = plain["before"]
    assert before["rms_low_mm"] < truth.before.rms_mm < before["rms_high_mm"]
    said = done.prediction.summary()
    assert "9 of 10 prints" in said
    assert "what the test print left open 0.00" in said


def test_figures_and_pictures_leave_the_same_shift_out(part: Path) -> None:
    """Nobody knows where a scan lay: figures, the page's colours and the report's are of the shape."""
    model = learn_model(scanned(measured(BENT, 0.02, 1), np.zeros((2, 2)), FLATBED), ENDER3)
    done = mend_gcode(part, model, part.with_name("out.gcode")).prediction
    assert done.of_shape
    shift_mm = float(np.hypot(*done.shift_mm))
    assert shift_mm > 0.05
    assert f"all of it also lies {shift_mm:.2f} mm beside its place" in done.summary()
    assert done.json()["shift_mm"] == pytest.approx(done.shift_mm)
    drawing = read_drawing(part, ENDER3)
    shape, all_of = (as_printed(drawing, model.mechanism, aligned=aligned) for aligned in (True, False))
    assert done.path is not None
    figure = float(np.sqrt(np.average(shape_of(done.path) ** 2, weights=done.path.weight)))
    assert shape.rms_mm(shape.raw_error_mm) == pytest.approx(figure, rel=0.03)
    assert all_of.rms_mm(all_of.raw_error_mm) > 1.1 * figure
    view = look_at(part, part.with_name("out.gcode"), model.mechanism, shift_mm=done.shift_mm)
    assert view is not None
    assert np.sqrt(np.mean(view.before.off_mm**2)) == pytest.approx(figure, rel=0.05)
    known = check_gcode(part, exact_model(Twin.of(BENT, ENDER3).homed()))  # its figures contain the place
    assert not known.of_shape
    assert "these figures contain that" in known.summary()
    still = check_gcode(part, exact_model(Twin.of(HEALTHY, ENDER3).homed()))
    assert (still.shift_words, still.shift_mm) == ("", pytest.approx((0.0, 0.0), abs=1e-9))


def test_less_is_promised_where_less_was_measured(bent: SavedModel, part: Path) -> None:
    poor = learn_model(measured(BENT, 0.2, 1, 250), ENDER3)
    promises = [check_gcode(part, model).after for model in (bent, poor)]
    assert promises[1].rms_mm > 2 * promises[0].rms_mm
    assert promises[1].rms_high_mm - promises[1].rms_low_mm > 1.5 * (promises[0].rms_high_mm - promises[0].rms_low_mm)


def test_marks_are_expected_as_warm_as_the_way_between_them_is_long(bent: SavedModel) -> None:
    """A machine that grows by 0.4 mm: marks that are as far apart as those of the measured print, and much nearer."""
    trace = measured(BENT, 0.05, 1)
    way_mm = float(np.hypot(*np.diff(trace.commanded_mm, axis=0).T).sum())
    spans = np.array([[0.0, 220.0]] * 4)
    grows = Effect("thermal", 0, np.array([0.2, 0.0]), 0.25, 0.0, EARLY, np.zeros(3), spans, 40.0, way_mm)
    made_of = []
    for effect in (grows, replace(grows, way_mm=100 * way_mm)):
        warm = replace(bent, document={**bent.document, "misfit": misfit_section((), (effect,))})
        found = expectation(warm, trace)
        assert found is not None
        made_of.append(found.made_of["thermal"])
    assert made_of[0] > 1.2 * made_of[1] > 0


def test_a_model_that_says_nothing_of_its_doubt_promises_what_it_plans(part: Path) -> None:
    after = check_gcode(part, exact_model(BENT.lower(ENDER3))).after
    assert after.rms_low_mm == after.rms_mm == after.rms_high_mm == after.planning_rms_mm
    assert set(after.made_of) == {"planning"}


def test_a_learner_without_doubt_promises_no_less_than_it_leaves(part: Path) -> None:
    trace = measured(BENT, 0.05, 1, 250)
    model = learn_model(trace, ENDER3, model="naive")
    before = check_gcode(part, model).before
    off_mm = np.sqrt(np.mean((trace.measured_mm - trace.commanded_mm) ** 2))
    assert before.rms_low_mm < off_mm < before.rms_high_mm
    assert before.made_of["unexplained"] > 0.9 * before.rms_mm


def test_the_budget_follows_the_machine(bent: SavedModel) -> None:
    """Each direction of a motor's budget, added to its parameters, moves its belt as its columns say."""
    budget = parse_budget(bent)
    assert budget is not None
    at = np.linspace(20, 200, 301)
    for motor in budget.motors:
        for which in range(0, motor.factor_mm.shape[1], 5):
            branches = motor.design.branches(
                motor.factor_mm[:, which], period_mm=motor.period_mm, origin_mm=motor.middle_mm, reach_mm=motor.reach_mm
            )
            raised = replace(
                branches, play=replace(branches.play, powers_mm=np.add(branches.play.powers_mm, [50.0, 0.0, 0.0]))
            )
            mean, play = raised.errors_mm(at)  # above zero, where play is not clipped
            for side in (-1.0, 1.0):
                column = motor.columns(at, at - 110, 0 * at, np.full(len(at), side))[:, which]
                assert np.abs(mean - side * (play - 50.0) / 2 - column).max() < 1e-6


@pytest.mark.parametrize("count", [0.4, 1.0, 300.0, 50_000.0])
def test_the_largest_of_many_normal_values(count: float) -> None:
    uniform = np.array([0.01, 0.3, 0.5, 0.95, 0.999])
    below = [0.5 * (1 + math.erf(each / math.sqrt(2))) for each in _largest_of(np.full(5, count), uniform)]
    assert np.power(below, count) == pytest.approx(uniform, abs=1e-3)


def test_the_95th_percentiles_along_a_path_are_those_of_each_machine(rng: np.random.Generator) -> None:
    values, weight = rng.normal(size=(20, 301)), rng.uniform(0, 2, 301) * (rng.random(301) < 0.7)
    for row, found in zip(values, _weighted_p95(values, weight), strict=True):
        beyond = [weight[row > each].sum() for each in (found, row[row < found].max())]
        assert beyond[0] <= 0.05 * weight.sum() < beyond[1]


def test_a_longer_print_has_a_larger_largest_error(bent: SavedModel) -> None:
    budget, error = parse_budget(bent), Errors(0.002, 0.004, 0.006)
    assert budget is not None
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    tangent = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    most_mm = []
    for length_mm in (1.0, 100.0):  # of each place: 0.4 m, and 40 m of lines over the same places
        path = PathPlaces(
            110 + 30 * np.stack([np.cos(angle), np.sin(angle)], axis=1), tangent, np.zeros(400), np.sign(tangent),
            np.full(400, length_mm),
        )  # fmt: skip
        outlook = promised(bent.mechanism, budget, path, error, error)
        assert outlook is not None
        most_mm.append(outlook.after.max_mm)
    assert 1.15 * most_mm[0] < most_mm[1] < 2 * most_mm[0]


def test_a_part_left_out_is_there_in_few_machines(bent: SavedModel, rng: np.random.Generator) -> None:
    budget = parse_budget(bent)
    assert budget is not None
    motor = replace(
        budget.motors[0], factor_mm=np.ones((budget.motors[0].design.size, 5)), left_out=((2, 0.1), (1, 0.5))
    )
    z = np.hstack([_directions(motor, None, rng) for _ in range(200)])
    assert np.mean(z != 0, axis=1) == pytest.approx([1, 1, 0.1, 0.1, 0.5], abs=0.01)
    assert np.var(z, axis=1) == pytest.approx(np.ones(5), abs=0.06)  # the same variance as if it were always there
    assert ((z[2] != 0) == (z[3] != 0)).all()  # one part: both of its directions, or none


def test_where_machines_are_kept_each_draw_is_one_of_them(bent: SavedModel, rng: np.random.Generator) -> None:
    budget = parse_budget(bent)
    assert budget is not None
    motor = replace(budget.motors[0], factor_mm=np.ones((budget.motors[0].design.size, 5)), machines=True)
    z = np.hstack([_directions(motor, None, rng) for _ in range(50)])
    assert ((z > 0).sum(axis=0) == 1).all()
    assert np.mean(z > 0, axis=1) == pytest.approx(np.full(5, 0.2), abs=0.02)


def test_a_motor_that_rounding_moves_stands_still(rng: np.random.Generator) -> None:
    """Lines at 45° on a CoreXY move one motor; that their ends are rounded does not turn the other one round."""
    printer = read_printer("corexy")
    budget = parse_budget(
        learn_model(measured(Corruption((Drive(), Drive(belt=Play(0.3)))), 0.02, 4, 700, printer), printer)
    )
    assert budget is not None
    side = np.repeat(np.where(np.arange(40) % 2, 1.0, -1.0), 10)
    straight = np.stack([side, side], axis=1) / np.sqrt(2)
    places = 150 + np.linspace(-20, 20, 400)[:, None] * [1.0, -1.0] + np.tile(np.linspace(-20, 20, 10), 40)[:, None]
    error = Errors(0.0, 0.0, 0.0)
    expected = []
    for lean in (0.0, 2e-5):  # a thousandth of a millimetre in 50
        tangent = straight + lean * rng.choice([-1.0, 1.0], 40).repeat(10)[:, None] * [1.0, -1.0]
        pushed = np.stack([side, np.ones(400)], axis=1)
        path = PathPlaces(places, tangent, np.zeros(400), pushed, np.ones(400))
        outlook = promised(exact_model(Twin.of(HEALTHY, printer).mechanism).mechanism, budget, path, error, error)
        assert outlook is not None
        expected.append(outlook.before.rms_mm)
    assert expected[1] == pytest.approx(expected[0], rel=1e-3)


def test_a_print_of_half_a_turn_promises_by_the_machines_that_it_allows(part: Path) -> None:
    """Half of a polygon may be half of an oval, of a triangle or of neither: the rest is in as much doubt."""
    rng = np.random.default_rng(6)
    way = np.concatenate([[[0.0, 0.0]], 100 + rng.uniform(-9, 9, (300, 2))])
    twin = Twin.of(Corruption((Drive(pulley=Polygon((6.2, 7.1, 6.4, 7.4, 6.6))), Drive())), ENDER3)
    trace = Trace(way, twin.follow(way) + rng.normal(0, 0.05, way.shape), homed=True)
    model = learn_model(trace, ENDER3)
    budget = parse_budget(model)
    assert budget is not None
    assert budget.motors[0].machines
    assert budget.motors[0].factor_mm.shape[1] == MACHINES
    done = mend_gcode(part, model, part.with_name("out.gcode"), force=True)
    promise = done.prediction.after
    truth = judge_gcode(part, part.with_name("out.gcode"), twin)
    assert promise.rms_low_mm < truth.after.rms_mm < promise.rms_high_mm
    assert promise.rms_high_mm > 5 * promise.rms_low_mm


def test_ringing_that_no_mark_at_rest_shows_lies_in_the_range(bent: SavedModel, part: Path) -> None:
    """A head that swings by 0.1 mm after a corner every 10 mm, 0.025 mm typically, at 40 Hz and 30 mm/s.

    The marks of the test print were made at rest, so the model cannot know; the range must.
    """
    promise = mend_gcode(part, bent, part.with_name("out.gcode")).prediction.after
    since_corner_mm = np.linspace(0, 10, 1000)
    swing_mm = 0.1 * np.exp(-since_corner_mm / 2.5) * np.cos(2 * np.pi * 40 / 30 * since_corner_mm)
    planned = judge_gcode(part, part.with_name("out.gcode"), Twin.of(BENT, ENDER3)).after.rms_mm
    true_mm = np.hypot(planned, np.sqrt(np.mean(swing_mm**2)))
    assert true_mm > 0.02
    assert promise.rms_low_mm < true_mm < promise.rms_high_mm
    assert "motion" in promise.made_of


def test_a_printer_that_sticks_is_promised_no_better_than_its_marks_scatter(
    part: Path, rng: np.random.Generator
) -> None:
    """Each axis stops anywhere within 0.1 mm of where it was sent; the callipers say that they read to 0.01 mm.

    How much of that is the dots' own is not known: a quarter of its variance is expected, nearly all is in the range.
    """
    trace = measured(BENT, 0.01, 7)
    stuck = rng.uniform(-0.05, 0.05, trace.measured_mm.shape)
    sticking = replace(trace, measured_mm=trace.measured_mm + stuck, sigma_mm=np.full(len(trace), 0.01))
    model = learn_model(sticking, ENDER3)
    promise = mend_gcode(part, model, part.with_name("out.gcode")).prediction.after
    planned = judge_gcode(part, part.with_name("out.gcode"), Twin.of(BENT, ENDER3)).after.rms_mm
    true_mm = np.hypot(planned, 0.05 / np.sqrt(3))  # across a line it is off by as much as either axis
    assert promise.rms_low_mm < true_mm < promise.rms_high_mm
    assert promise.rms_mm == pytest.approx(true_mm / 2, rel=0.25)


def test_what_was_left_out_is_read_with_its_chance() -> None:
    way = stairs(250)
    trace = Trace(way, way + np.random.default_rng(5).normal(0, 0.05, way.shape), homed=True)
    model = learn_model(trace, ENDER3)
    section = json.loads(json.dumps(model.document["promise"]))
    for motor in section["motors"].values():
        directions = len(next(iter(motor["factor_mm"].values()))[0])
        assert motor["left_out"]
        assert 1 <= sum(count for count, _ in motor["left_out"]) < directions
        assert all(0.003 < chance < 1 for _, chance in motor["left_out"])
    for wrong in ([[99, 0.5]], [[1, 0.0]], [[1.5, 0.5]], [[1]], "all"):
        section["motors"]["x"]["left_out"] = wrong
        with pytest.raises(ModelError):
            parse_budget(replace(model, document={**model.document, "promise": section}))


def test_no_scanner_mends_a_healthy_printer(part: Path) -> None:
    trace = measured(HEALTHY, 0.01, 3)
    for far_mm, stretch in ((0.0, np.diag([0.0013, 0.0013])), (120.0, np.array([[0.002, 0.0004], [0.0004, 0.001]]))):
        seen = scanned(trace, stretch)
        model = learn_model(replace(seen, measured_mm=seen.measured_mm + far_mm), ENDER3)
        done = mend_gcode(part, model, part.with_name("out.gcode"))
        assert done.output is not None
        assert done.output.read_bytes() == part.read_bytes()
        assert done.prediction.after.rms_high_mm < 0.2
        left_out = model.document["promise"]["left_out"]
        assert left_out[0]["part"] == "scale of both axes"
        assert left_out[0]["value"] == pytest.approx(100 * np.trace(stretch) / 2, abs=0.02)


def test_a_scanners_stretch_is_no_uneven_belt() -> None:
    """Beside the smallest wave of its carriage, which no one turn of the plate tells from a belt's."""
    trace = measured(HEALTHY, 0.005, 3)
    seen = scanned(trace, np.diag([0.002, 0.0013]))
    for wave_mm in (0.0, 0.012):
        wave = wave_mm * np.sin(2 * np.pi * seen.commanded_mm[:, 1:] / 85) * [0.0, 1.0]
        model = learn_model(replace(seen, measured_mm=seen.measured_mm + wave), ENDER3)
        middle = np.linspace(60, 160, 200)
        off = [table.branches_mm(middle)[0] - middle for table in model.mechanism.transmissions]
        assert max(np.ptp(each) for each in off) < 3 * wave_mm + 1e-6, wave_mm


def test_a_lens_that_bends_no_more_than_a_photo_does_is_not_mended() -> None:
    seen = scanned(measured(HEALTHY, 0.002, 3), np.zeros((2, 2)), PAPER)
    bend_mm = 0.01 * ((seen.commanded_mm - 110) / 100) ** 2
    model = learn_model(replace(seen, measured_mm=seen.measured_mm + bend_mm), ENDER3)
    assert is_healthy(model)
    assert "changing scale" in str(model.document["promise"]["left_out"])
    bent = learn_model(replace(seen, measured_mm=seen.measured_mm + 20 * bend_mm), ENDER3)
    assert "scale that changes along the axis" in bent.findings[0]


def test_an_axis_that_never_moved_says_nothing() -> None:
    still = measured(HEALTHY, 0.002, 3)
    still = replace(still, commanded_mm=still.commanded_mm * [1, 0], measured_mm=still.measured_mm * [1, 0])
    assert is_healthy(learn_model(replace(still, instrument=PAPER, placed=False), ENDER3))


def test_a_scale_that_no_scanner_has_is_mended(part: Path) -> None:
    skewed = Corruption((Drive(), Drive()), frame=CrookedFrame(x_scale=1.015, skew_deg=1.0))
    model = learn_model(scanned(measured(skewed, 0.01, 4), np.diag([0.0005, 0.0003])), ENDER3)
    said = check_gcode(part, model)
    assert said.before.rms_mm > 0.1
    assert said.after.made_of["instrument"] > 0.5 * said.after.rms_mm
    upper = part.with_name("upper.gcode")
    upper.write_text(CIRCLE + CIRCLE[CIRCLE.index("G1 Z") :].replace("Z0.2", "Z0.4").replace("X1", "X"))
    whole = check_gcode(upper, model)  # the upper layer lies elsewhere: without the part's place it is off otherwise
    length, rms, most = (
        np.array([row[k] for row in whole.layers]) for k in ("length_mm", "before_rms_mm", "before_max_mm")
    )
    assert rms.min() > 0.1
    assert (most >= rms).all()
    assert most.max() <= 1.001 * whole.before.max_mm
    assert np.sqrt(np.average(rms**2, weights=length)) == pytest.approx(whole.before.rms_mm, rel=0.05)
    layer = CIRCLE[CIRCLE.index("G1 Z") :]
    upper.write_text(CIRCLE + "".join(layer.replace("Z0.2", f"Z{0.2 * n:.1f}") for n in range(2, 90)))
    alike = np.array([row["before_rms_mm"] for row in check_gcode(upper, model).layers])
    assert alike == pytest.approx(alike.mean(), rel=0.25)  # each layer is the same circle
    mend_gcode(part, model, part.with_name("out.gcode"))
    truth = judge_gcode(part, part.with_name("out.gcode"), Twin.of(skewed, ENDER3))
    assert truth.after.rms_mm < 0.1 * truth.before.rms_mm
    surer = replace(FLATBED, scale_sd=0.0003, axes_sd=1e-4, lean_sd=1e-4)
    known = learn_model(scanned(measured(skewed, 0.01, 4), np.zeros((2, 2)), surer), ENDER3)
    assert check_gcode(part, known).after.rms_mm < 0.5 * said.after.rms_mm
    assert scale_words(known) == ()


def test_learn_says_what_scale_a_scan_leaves_open() -> None:
    wide = Corruption((Drive(), Drive()), frame=CrookedFrame(x_scale=1.004, y_scale=1.004))
    model = learn_model(scanned(measured(wide, 0.01, 4), np.zeros((2, 2))), ENDER3)
    (said,) = scale_words(model)
    assert re.search(r"the print is \+0\.4\d % in X and \+0\.4\d % in Y too large .* Mending takes nothing", said)
    assert said in report(model)
    assert "Mending takes off +0.50 % in X and -0.00 % in Y, which may be wrong by 0.2 mm" in in_words(
        np.array([0.005, 0.001]), np.array([0.005, -1e-6]), 0.002
    )
    healthy = learn_model(scanned(measured(HEALTHY, 0.01, 3), np.zeros((2, 2))), ENDER3)
    assert scale_words(healthy) == ()


def test_a_scan_of_a_skewed_corexy_leaves_the_direction_of_x(part: Path) -> None:
    """No scan tells how a frame turns what it prints: x keeps its direction, however the plate lay on the glass."""
    corexy, skewed = read_printer("corexy"), Corruption((Drive(), Drive()), frame=CrookedFrame(skew_deg=2.6))
    sin = np.radians(-0.7)
    seen = scanned(measured(skewed, 0.01, 4, 300, corexy), np.array([[-(sin**2) / 2, -sin], [sin, -(sin**2) / 2]]))
    model = learn_model(seen, corexy)
    mend_gcode(part, model, part.with_name("out.gcode"))
    truth = judge_gcode(part, part.with_name("out.gcode"), Twin.of(skewed, corexy))
    assert truth.after.rms_mm < 0.03 < 0.3 < truth.before.rms_mm


def test_a_scan_of_a_corexy_with_another_pulley_turns_no_print() -> None:
    """A motor whose scale is off by a tenth leans like a frame that is skewed by 5°: such a one would be seen."""
    corexy, rng = read_printer("corexy"), np.random.default_rng(2)
    points = np.vstack([[corexy.home_mm], rng.uniform(20, 280, (900, 2))])
    belts = corexy.to_motor(points - corexy.home_mm) * np.array([0.89, 0.98])
    printed = np.asarray(corexy.from_motor(belts)) + corexy.home_mm + rng.normal(0, 0.02, points.shape)
    model = learn_model(scanned(Trace(points, printed, homed=True), np.zeros((2, 2))), corexy)
    linear = [Frame.exponents.index(powers) for powers in ((1, 0), (0, 1))]
    matrix = model.mechanism.frame.coefficients_mm[:, linear]
    assert matrix[0, 1] - matrix[1, 0] == pytest.approx(0.0, abs=1e-6)
    assert {fault["kind"] for fault in model.document["diagnosis"]} == {"scale"}


def test_a_scan_knows_a_corexys_skew_better_than_its_scales() -> None:
    corexy, skewed = read_printer("corexy"), Corruption((Drive(), Drive()), frame=CrookedFrame(skew_deg=0.5))
    model = learn_model(scanned(measured(skewed, 0.01, 4, 300, corexy), np.zeros((2, 2))), corexy)
    (skew,) = (fault for fault in model.document["diagnosis"] if fault["kind"] == "skew")
    assert abs(skew["value"]) == pytest.approx(0.5, abs=0.06)
    assert 0.02 < skew["sd"] < 0.1
    assert "frame skewed by" in model.findings[0]


def test_a_scanned_check_print_with_more_play_breaks_the_promise() -> None:
    """The promise of what is compared without the scanner's stretch does not hold that stretch."""
    model = learn_model(scanned(measured(BENT, 0.01, 3), np.diag([0.001, 0.0005])), ENDER3)
    wanted = stairs(300)
    printed = Twin.of(BENT, ENDER3).follow(mended_mm(model, wanted))
    worn = printed + 0.1 * np.stack([np.zeros(len(wanted)), last_way(wanted[:, 1])], axis=1)
    noise = np.random.default_rng(9).normal(0, 0.01, wanted.shape)
    same, other = (verify(model, scanned(Trace(wanted, each + noise), np.zeros((2, 2)))) for each in (printed, worn))
    assert (same.result, other.result) == (KEPT, BROKEN)
    assert other.promised_high_mm < 0.08 < other.now_mm


def test_what_is_believed_of_a_stretch() -> None:
    exact = 1e-10 * np.eye(3)
    doubtful, none, _ = believe(np.array([0.0015, 0.0, 0.0]), exact, FLATBED, False)
    assert not none.any()
    assert 0 < doubtful.weight[0] < 1
    assert doubtful.weight.sum() == pytest.approx(1)
    _, one_axis, _ = believe(np.array([0.01, 0.0099, 0.0]), exact, FLATBED, False)
    assert one_axis[0] == one_axis[1] == pytest.approx(0.01, rel=0.05)  # X alone: Y keeps its length
    _, skew, lean_rad = believe(np.array([0.0, 0.0, 0.01]), exact, FLATBED, True)
    assert skew == pytest.approx([0, 0, 0.01])  # of a CoreXY: a crooked frame before two opposite scales
    assert lean_rad == pytest.approx(0.01)
    assert believe(np.array([0.02, 0.0, 0.02]), exact, FLATBED, True)[2] == 0.0  # one motor's pulley leans no frame
    # a large lean is of two wrong pulleys, also where an axis has a scale of its own
    assert believe(np.array([0.035, 0.005, -0.07]), exact, FLATBED, True)[2] == 0.0
    _, wide, _ = believe(np.array([0.01, 0.01, 0.0]), exact, FLATBED, True)
    assert wide == pytest.approx([0.01, 0.01, 0.0], rel=0.05)  # a CoreXY's frame that is too wide is no scanner's fault
    slight, _, _ = believe(np.zeros(3), exact, FLATBED, False)  # nor is a printer exact because it looks so
    assert 0.0002 < float(np.sqrt(slight.weight @ slight.covariance[:, 0, 0])) < FLATBED.scale_sd / 2


def test_one_distance_settles_the_scale(rng: np.random.Generator) -> None:
    true = rng.uniform(0, 150, (50, 2))
    true[:2] = [[10, 20], [110, 110]]
    stretch = np.array([[1.0025, 0.0], [0.0, 1.0025]])
    span_mm = float(np.hypot(100, 90)) + 1.6
    dots = np.full(2, 1.6 * 1.0025)
    again, left, note = scaled_by(span_mm, (0, 1), dots, true @ stretch, replace(FLATBED, axes_sd=1e-4, lean_sd=1e-4))
    assert np.ptp(again - true, axis=0).max() < 0.2 * np.ptp(true @ stretch - true, axis=0).max()
    assert left.scale_sd < 0.0005
    assert "0.25 % too large" in note
    with pytest.raises(TraceError, match="dot 0 to dot 1"):
        scaled_by(120.0, (0, 1), dots, true, FLATBED)


def test_a_trace_keeps_what_its_instrument_cannot_tell(tmp_path: Path) -> None:
    trace = replace(measured(HEALTHY, 0.01, 5, 30), placed=False, instrument=FLATBED)
    write_trace(tmp_path / "t.csv", trace)
    assert read_trace(tmp_path / "t.csv", ENDER3).instrument == FLATBED
    unknown = replace(trace, instrument=None).instrument_doubt  # how the plate lay is not known: no axis is surer
    assert unknown.axes_sd == unknown.lean_sd
    assert 2 * unknown.lean_sd**2 == pytest.approx(FLATBED.axes_sd**2 + FLATBED.lean_sd**2, rel=0.05)
    assert replace(trace, instrument=None, placed=True).instrument_doubt.is_exact
    text = (tmp_path / "t.csv").read_text()
    (tmp_path / "bad.csv").write_text(text.replace("0.001300", "7"))
    with pytest.raises(TraceError, match="scale_sd from 0"):
        read_trace(tmp_path / "bad.csv", ENDER3)


def test_patterns_are_told_from_noise(rng: np.random.Generator) -> None:
    rows: Rows = motor_rows(measured(HEALTHY, 0.01, 6), ENDER3)[0]
    side = np.sign(np.diff(rows.motor_mm, prepend=0.0)).astype(np.int8)
    noise = rng.normal(0, 0.05, len(rows))
    assert unexplained(rows, noise, side).variance_mm2 == 0
    assert unexplained(rows, noise, side, 0.04).variance_mm2 == 0  # it may scatter a little more than it says
    drawn_anew = unexplained(rows, noise, side, 0.01)
    assert np.sqrt(4 * drawn_anew.variance_mm2) == pytest.approx(0.05, rel=0.15)  # more of that may be the dots'
    for pattern in (
        0.05 * np.sin(rows.motor_mm / 5),  # by place
        0.05 * side,  # by direction
        0.05 * np.sin(np.arange(len(rows)) / 60),  # by time
        0.05 * np.sin(rows.other_mm / 9),  # by the other axis
    ):
        found = unexplained(rows, noise + pattern, side)
        assert np.sqrt(found.variance_mm2) == pytest.approx(np.std(pattern), rel=0.35)


def test_a_shape_is_not_worse_for_lying_elsewhere() -> None:
    """A part 3 mm off its place, whose lines end so far from where they should that their distance is larger still."""
    angle, nothing = np.linspace(0, 2 * np.pi, 40, endpoint=False), np.zeros((40, 2))
    tangent = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    off = -3.0 * tangent[:, 1] + 0.1 * np.sin(5 * angle)
    path = PathPlaces(nothing, tangent, off, nothing, np.ones(40))
    known = Errors(1.1 * float(np.sqrt(np.mean(off**2))), 3.0, 3.2)
    alone, rng = np.zeros(DRAWS), np.random.default_rng(0)
    whole, shape = (_summed_up(_Side(path, off, {}, {}, known, signed=True), placed, alone, rng)[0]
                    for placed in (True, False))  # fmt: skip
    assert whole.rms_mm == pytest.approx(np.sqrt(np.mean(off**2)))
    assert shape.rms_mm == pytest.approx(0.1 / np.sqrt(2), rel=0.2)
    assert shape.rms_mm <= shape.max_mm
    assert shape.planning_rms_mm == pytest.approx(shape.rms_mm)
    many = PathPlaces(*(np.repeat(each, 40, axis=0) for each in (nothing, tangent, off, nothing, np.ones(40))))
    many = replace(many, off_mm=many.off_mm * (1 + (np.arange(1600) % 7 == 0)))
    for placed in (True, False):
        few, all_of = (each.off_mm if placed else shape_of(each) for each in (_thinned(many, placed), many))
        assert len(few) < 1600
        assert np.mean(few**2) == pytest.approx(np.mean(all_of**2), rel=0.01)
    for across in (0.1, 0.2, 0.3, 0.6):  # merely shifted: rounding may leave less than nothing of its shape
        off = across * tangent[:, 0] - 3.0 * tangent[:, 1]
        side = _Side(path, off, {}, {}, known, signed=True)
        assert _summed_up(side, False, alone, rng)[0].rms_mm == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("placed", [True, False])
def test_what_is_summed_up_at_once_is_what_each_drawn_machine_prints(rng: np.random.Generator, placed: bool) -> None:
    angle, weight, off = rng.uniform(0, 7, 40), rng.uniform(1, 2, 40), rng.normal(0, 0.1, 40)
    tangent = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    causes = {
        name: DrawnCause(rng.normal(0, 0.05, (40, k)), rng.standard_normal((k, DRAWS)))
        for name, k in (("a", 3), ("b", 2))
    }
    local = {"motion": DrawnCause(rng.uniform(0, 1e-4, (40, 2)), rng.uniform(0, 1, (2, DRAWS)))}
    path = PathPlaces(np.zeros((40, 2)), tangent, off, np.zeros((40, 2)), weight)
    known = Errors(float(np.sqrt(np.average(off**2, weights=weight))), 0.2, 0.3)
    side = _Side(path, off, causes, local, known, signed=True)
    promise, rms = _summed_up(side, placed, np.zeros(DRAWS), rng)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    root = np.sqrt(weight)
    for draw in range(0, DRAWS, 50):
        error = off + sum(each.columns @ each.drawn[:, draw] for each in causes.values())
        shift = np.linalg.lstsq(normal * root[:, None], error * root, rcond=None)[0]
        counted = error if placed else error - normal @ shift
        square = np.average(counted**2 + local["motion"].columns @ local["motion"].drawn[:, draw], weights=weight)
        assert rms[draw] == pytest.approx(np.sqrt(square), abs=1e-7)
    assert promise.rms_mm == pytest.approx(np.median(rms))
    assert sum(share**2 for share in promise.made_of.values()) == pytest.approx(promise.rms_mm**2)
    apart = np.sqrt(np.average(local["motion"].columns @ local["motion"].drawn, axis=0, weights=weight))
    for along in (-1.0, 1.0):  # what nothing explains lies against what is known, or with it
        told = _summed_up(side, placed, np.full(DRAWS, along), rng)[0]
        assert told.rms_mm == pytest.approx(np.median(np.sqrt(rms**2 - apart**2) + along * apart))


def test_a_budget_that_is_none_of_ours_is_refused(bent: SavedModel) -> None:
    section = dict(bent.document["promise"])
    motors = section["motors"]
    for changed in (
        {**section, "version": 2},
        {**section, "motors": {"x": motors["x"]}},
        {**section, "motors": {**motors, "y": {**motors["y"], "factor_mm": {"mean_powers": [[1.0]]}}}},
        {**section, "motors": {**motors, "y": {**motors["y"], "period_mm": -1}}},
        {**section, "stretch": [{"weight": 1, "mean": [0, 0], "covariance": [[0]]}]},
        [],
    ):
        with pytest.raises(ModelError):
            parse_budget(replace(bent, document={**bent.document, "promise": changed}))
    older = {key: value for key, value in bent.document.items() if key != "promise"}
    assert parse_budget(replace(bent, document=older)) is None


def test_a_firmware_gets_only_what_helps_by_more_than_its_doubt(bent: SavedModel) -> None:
    export = export_supported(bent, "marlin")
    assert set(export.settings) == {"backlash of X", "backlash of Y"}
    assert export.after_mm < export.before_mm
    assert 0.001 < export.doubt_mm < 0.1
    assert export.doubt_mm > 0.02  # what a printer may do in motion, which no dot at rest shows, as in `mend`'s range
    without, most = (np.hypot(each, export.doubt_mm) for each in (export.before_mm, export.after_mm))
    assert f"up to {without:.3f} mm without, up to {most:.3f} mm with this" in remainder(export)
    found, span = {"kind": "wear", "size_mm": 0.1, "severity": "warning", "words": ""}, [0.0, 200.0]
    effect = Effect("wear", 0, np.array([0.1]), 0.0, 0.0, ENDED, np.zeros(3), np.array([span] * 4), 40.0).json()
    for state, doubt_mm in ((ENDED, np.hypot(export.doubt_mm, 0.2)), (LEARNED, export.doubt_mm)):
        section = {"found": [found], "effects": [{**effect, "state": state}]}
        grows = replace(bent, document={**bent.document, "misfit": section})
        assert export_supported(grows, "marlin").doubt_mm == pytest.approx(doubt_mm)  # as in `mend`'s range, too
    text = dict(export.files)["marlin.gcode"]
    assert "M500" not in text
    assert "to undo" in text
    why = "backlash of X and backlash of Y: Klipper has no setting for backlash"
    with pytest.raises(RefusedError, match=why) as refused:
        export_supported(bent, "klipper")
    assert "`printmend mend` mends the files" in str(refused.value)
    healthy = learn_model(scanned(measured(HEALTHY, 0.01, 3), np.diag([0.0013, 0.0013])), ENDER3)
    for firmware in ("marlin", "klipper", "rrf", "linuxcnc"):
        with pytest.raises(RefusedError, match="leave its settings as they are: there is nothing to mend"):
            export_supported(healthy, firmware)
    unsure = replace(FLATBED, scale_sd=0.01, axes_sd=0.01)
    scaled = Corruption((Drive(), Drive()), frame=CrookedFrame(x_scale=1.2))
    model = learn_model(scanned(measured(scaled, 0.01, 4), np.zeros((2, 2)), unsure), ENDER3)
    assert export_supported(model, "klipper").settings == ("scale of X",)


def mended_mm(model: SavedModel, wanted: np.ndarray) -> np.ndarray:
    """Return what mending commands [N, 2] for marks at wanted places [N, 2]."""
    motors = ENDER3.to_motor(model.mechanism.frame.invert(wanted)).copy()
    for motor, table in enumerate(model.mechanism.transmissions):
        side = last_way(motors[:, motor])
        branches = [np.interp(motors[:, motor], each, table.motor_mm) for each in (table.lower_mm, table.upper_mm)]
        motors[:, motor] = np.where(side > 0, branches[0], np.where(side < 0, branches[1], motors[:, motor]))
    motors[0] = wanted[0]
    return motors


LOOSER = Corruption((replace(BENT.drives[0], belt=Play(0.4)), Drive(belt=Play(0.3))))
KNOWN_SCALE = Instrument(scale_sd=0.0003, axes_sd=0.001, lean_sd=0.0005)


@pytest.mark.parametrize(
    ("machine", "grown", "instrument", "kept"),
    [
        (BENT, 0.0, FLATBED, True),
        (BENT, 0.002, FLATBED, True),  # no more than such a scanner may do
        (BENT, 0.006, FLATBED, False),
        (BENT, 0.003, KNOWN_SCALE, False),
        (LOOSER, 0.0, FLATBED, False),
    ],
)
def test_a_scanners_doubt_hides_no_change_of_the_machine(
    bent: SavedModel, machine: Corruption, grown: float, instrument: Instrument, kept: bool
) -> None:
    wanted = stairs(300)
    printed = (1 + grown) * Twin.of(machine, ENDER3).follow(mended_mm(bent, wanted))
    printed += np.random.default_rng(9).normal(0, 0.02, wanted.shape)
    verdict = verify(bent, Trace(wanted, printed, homed=True, placed=False, instrument=instrument))
    assert verdict.result == (KEPT if kept else BROKEN), verdict.words
    anew = update_words(verdict, Updated(bent, (), ("X",)))
    assert ("is not the one" in anew) != kept  # what keeps its promise is of this machine


OTHER = Corruption((Drive(pulley=Ellipse(7.0, 5.8, 0.3)), Drive(pulley=EccentricBore(0.5, 2.5), belt=Play(0.5))))


@pytest.mark.parametrize(
    ("machine", "is_mended", "words"),
    [
        (BENT, True, "kept"),
        (BENT, False, "Was the mended file printed"),
        (LOOSER, True, "Mend again with the model"),
        (LOOSER, False, "Was the mended file printed"),
        (OTHER, True, "Is it another printer's"),
        (OTHER, False, "Is it another printer's"),
    ],
)
def test_another_printers_table_without_a_name_is_asked_whose_it_is(
    bent: SavedModel, machine: Corruption, is_mended: bool, words: str
) -> None:
    wanted = stairs(300)
    printed = Twin.of(machine, ENDER3).follow(mended_mm(bent, wanted) if is_mended else wanted)
    noise = np.random.default_rng(9).normal(0, 0.03, wanted.shape)
    assert words in verify(bent, Trace(wanted, printed + noise, homed=True)).words


def test_a_table_that_wanders_breaks_no_promise_and_updates_no_model(bent: SavedModel) -> None:
    wanted, rng = stairs(600), np.random.default_rng(9)
    printed = Twin.of(BENT, ENDER3).follow(mended_mm(bent, wanted)) + rng.normal(0, 0.02, wanted.shape)
    trace = Trace(wanted, printed + np.cumsum(rng.normal(0, 0.01, wanted.shape), axis=0), homed=True)
    verdict = verify(bent, trace)
    assert verdict.now_mm > verdict.promised_high_mm
    assert verdict.result == UNSURE
    assert "What measures wanders" in verdict.words
    with pytest.raises(TraceError, match="one that wanders: place and scale may be off"):
        updated(bent, trace)
    assert verify(bent, replace(trace, measured_mm=printed)).wanders_mm == 0


@pytest.mark.parametrize(
    ("noise_mm", "is_stated", "worse", "result"),
    [
        (0.02, True, 0.0, KEPT),
        (0.02, False, 0.0, KEPT),
        (0.02, True, 2.0, BROKEN),
        (0.02, False, 2.0, BROKEN),
        (0.3, True, 0.0, UNSURE),
        (0.3, False, 0.0, UNSURE),
    ],
)
def test_verify_says_broken_of_what_it_sees_and_nothing_of_what_it_cannot(
    bent: SavedModel, noise_mm: float, is_stated: bool, worse: float, result: str
) -> None:
    """Noise far above that of the measurement that was learned from breaks no promise, and keeps none."""
    wanted = stairs(300)
    printed = Twin.of(BENT, ENDER3).follow(mended_mm(bent, wanted))
    worn = worse * np.stack([last_way(wanted[:, 0]), 0 * wanted[:, 0]], axis=1)
    worn *= verify(bent, Trace(wanted, printed, homed=True)).promised_high_mm
    sigma_mm = np.full(len(wanted), noise_mm) if is_stated else None
    said = []
    for seed in range(10):
        noise = np.random.default_rng(seed).normal(0, noise_mm, wanted.shape)
        said.append(verify(bent, Trace(wanted, printed + worn + noise, homed=True, sigma_mm=sigma_mm)))
    assert sum(each.result == result for each in said) >= 9, [each.words for each in said]
    words = next(each.words for each in said if each.result == result)
    assert f": {result}" in words
    if result == UNSURE:
        assert all(each.shows_from_mm > each.now_high_mm > 2 * each.promised_high_mm for each in said)
        assert ("say in sigma_mm" in words) != is_stated


def test_what_a_check_print_cannot_tell_ends_well(bent: SavedModel, tmp_path: Path) -> None:
    write_model(tmp_path / "printer.mend.json", bent)
    wanted = stairs(300)
    noise = np.random.default_rng(9).normal(0, 0.4, wanted.shape)
    write_trace(tmp_path / "check.csv", Trace(wanted, wanted + noise, homed=True))
    done = CliRunner().invoke(
        group, ["verify", str(tmp_path / "check.csv"), "-m", str(tmp_path / "printer.mend.json"), "--json"]
    )
    assert done.exit_code == 0, done.output
    said = json.loads(done.output)
    assert (said["result"], said["kept"]) == ("cannot tell", False)
    rows = rows_of(read_history(tmp_path / "printer.mend.json"))
    assert rows[0][2].endswith("cannot tell")


def test_an_idlers_error_is_no_noise_of_the_table(bent: SavedModel) -> None:
    wanted = stairs(300)
    printed = Twin.of(BENT, ENDER3).follow(mended_mm(bent, wanted))
    printed += 0.15 * np.sin(wanted * (2 * np.pi / 33.3))
    noise = np.random.default_rng(9).normal(0, 0.03, wanted.shape)
    assert verify(bent, Trace(wanted, printed + noise, homed=True)).result == BROKEN


def test_verify_states_the_result_against_the_promise(bent: SavedModel, tmp_path: Path) -> None:
    write_model(tmp_path / "printer.mend.json", bent)
    wanted = stairs(300)
    motors = mended_mm(bent, wanted)
    for name, corruption, kept in (("same", BENT, True), ("slipped", SLIPPED, False)):
        printed = Twin.of(corruption, ENDER3).follow(motors)
        noise = np.random.default_rng(9).normal(0, 0.05, wanted.shape)
        write_trace(tmp_path / f"{name}.csv", Trace(wanted, printed + noise, homed=True))
        new = tmp_path / f"{name}.mend.json"
        done = CliRunner().invoke(
            group, ["verify", str(tmp_path / f"{name}.csv"), "-m", str(tmp_path / "printer.mend.json"), "-o", str(new)]
        )
        assert done.exit_code == (0 if kept else 3), done.output
        assert "was promised: " + ("kept" if kept else "broken") in done.output
        assert "distances on the bed: about 1.4 times what `mend` counts" in done.output
        assert (read_model(new).digest != bent.digest) or kept
    history = [json.loads(line) for line in (tmp_path / "printer.mend.history.jsonl").read_text().splitlines()]
    assert [each["kept"] for each in history] == [True, False]
    raw = Twin.of(BENT, ENDER3).follow(wanted) - wanted
    assert history[0]["before_mm"] == pytest.approx(np.sqrt((raw**2).sum(axis=1).mean()), rel=0.02)
    assert history[0]["now_mm"] < 0.03
    assert history[1]["now_mm"] > 0.1
    noise = np.random.default_rng(9).normal(0, 0.01, wanted.shape)
    scanned = verify(bent, Trace(wanted, 1.001 * wanted + noise, placed=False))  # the scanner's stretch is no fault
    assert scanned.result == KEPT
    assert scanned.stretch_percent == pytest.approx(0.1, abs=0.01)
    mistaken = verify(bent, Trace(motors, Twin.of(BENT, ENDER3).follow(motors) + noise, homed=True))
    assert "not with those of the mended file?" in mistaken.words
    tables = tuple(table.shifted(0.5) for table in bent.mechanism.transmissions)
    elsewhere = replace(bent, mechanism=replace(bent.mechanism, transmissions=tables))  # a learned origin is the bed's
    off = np.sqrt(((raw + 0.5) ** 2).sum(axis=1).mean())
    assert verify(elsewhere, Trace(wanted, wanted + noise, homed=True)).before_mm == pytest.approx(off, rel=0.02)
    unsaid = np.full(len(wanted), np.nan)  # an empty column of sigma_mm is none
    assert verify(bent, Trace(wanted, 1.001 * wanted + noise, placed=False, sigma_mm=unsaid)) == scanned
    with pytest.raises(ModelError):
        verify(exact_model(BENT.lower(ENDER3)), Trace(wanted, wanted))


def test_most_of_a_doubt_is_told_before_printing(bent: SavedModel) -> None:
    wide = Promise(0.05, 0.1, 0.2, 0.02, 0.09, 0.05, 0.0, 0.001, {"planning": 0.001, "parameters": 0.049})
    gap = "X was seen on 30 % of its pulley's turn only; the rest is a guess. Print at least 40 mm along X."
    partial = replace(bent, document={**bent.document, "findings": ["X healthy", gap]})
    assert gap in advice_of(partial, wide)[0]
    small = replace(bent, document={**bent.document, "trace": {**bent.document["trace"], "measured": 60}})
    assert "A whole `printmend probe`" in advice_of(small, wide)[0]
    whole = replace(bent, document={**bent.document, "trace": {**bent.document["trace"], "measured": 601}})
    assert "A second test print" in advice_of(whole, wide)[0]  # not the same again
    assert "--distance" in advice_of(bent, replace(wide, made_of={"instrument": 0.05}))[0]
    assert advice_of(bent, replace(wide, rms_high_mm=0.02)) == ()
    fine = replace(wide, rms_mm=0.004, rms_high_mm=0.032, made_of={"instrument": 0.003})
    assert advice_of(bent, fine) == ()  # no callipers for three micrometres


def test_a_length_that_was_given_is_not_asked_for_again() -> None:
    """One distance settles the scale along it: a second scan, turned, what is left across it."""
    stretched = Corruption((Drive(), Drive()), frame=CrookedFrame(x_scale=1.0027, y_scale=1.0008))
    doubt = Promise(0.05, 0.1, 0.2, 0.02, 0.09, 0.05, 0.0, 0.001, {"planning": 0.001, "instrument": 0.049})
    both = settled(0.0, 0.0, 140.0, instrument_on_bed(FLATBED, np.eye(2), settled=True))[1]
    whole = learn_model(scanned(measured(stretched, 0.01, 4), np.zeros((2, 2)), both), ENDER3)
    assert advice_of(whole, doubt) == ("most of what is left is the scale, as far as the callipers left it open.",)
    odd = {**whole.document["promise"], "instrument": {"scale_axes": 0.1, "axes_sd": "0.1", "scale_sd": [0.1]}}
    assert "second scan" in advice_of(replace(whole, document={**whole.document, "promise": odd}), doubt)[0]
    for instrument, is_known in ((FLATBED, False), (settled(0.0, 0.0, 140.0, FLATBED)[1], True)):
        model = learn_model(scanned(measured(stretched, 0.01, 4), np.zeros((2, 2)), instrument), ENDER3)
        scale, advice = *scale_words(model), *advice_of(model, doubt)
        for said in (scale, advice):
            assert ("--distance" in said) != is_known
            assert ("second scan of the same plate" in said) == is_known


@given(st.lists(st.integers(1, 60), min_size=1, max_size=6), st.integers(0, 2**32 - 1), st.booleans())
def test_no_more_directions_are_kept_than_a_file_may_hold(sizes: list[int], seed: int, own_is_sure: bool) -> None:
    rng = np.random.default_rng(seed)
    spreads = [np.sort(rng.choice([0.0, 1e-6, 1.0], n) * rng.random(n).round(1))[::-1] for n in sizes]
    if own_is_sure:  # every part that was left out outweighs what was chosen
        spreads[0] = spreads[0] * 1e-9

    counts = kept_directions(spreads)

    assert counts[0] >= 1
    assert sum(counts) <= DIRECTIONS
    assert all(count <= size for count, size in zip(counts, sizes, strict=True))
    if sum(counts) < DIRECTIONS:
        lost = sum(each[count:].sum() for each, count in zip(spreads, counts, strict=True))
        assert lost <= (1 - KEPT_VARIANCE_SHARE) * sum(each.sum() for each in spreads) + 1e-12


@pytest.mark.parametrize("length_mm", [61.0, 79.5])
def test_one_scans_wave_may_be_its_carriages(length_mm: float, rng: np.random.Generator) -> None:
    """What a scanner's carriage does by running uneven is not printed into parts; two turns of the plate tell it."""
    points = np.vstack([[ENDER3.home_mm], rng.uniform(10, 210, (600, 2))])
    wave = 0.022 * np.sin(points[:, 1] / length_mm * 2 * np.pi)
    measured = points + np.stack([np.zeros(len(points)), wave], axis=1) + rng.normal(0, 0.01, points.shape)
    scan = Trace(points, measured, homed=True, placed=False, instrument=FLATBED)
    once = learn_model(scan, ENDER3)
    assert is_healthy(once)
    assert "Scan the same plate a second time" in report(once)
    assert max(each["unexplained_mm2"] for each in once.document["promise"]["motors"].values()) > 0.4 * 0.022**2 / 2
    twice = learn_model(replace(scan, instrument=replace(FLATBED, axes_sd=1e-4, lean_sd=1e-4)), ENDER3)
    assert not is_healthy(twice)


def test_play_that_was_left_out_is_no_finding(rng: np.random.Generator) -> None:
    points = np.vstack([[ENDER3.home_mm], rng.uniform(10, 210, (600, 2))])
    twin = Twin.of(Corruption((Drive(belt=Play(0.04)), Drive())), ENDER3)
    measured = twin.follow(points) + rng.normal(0, 0.01, points.shape)
    for wave_mm, said in ((0.02, "X healthy; Y healthy"), (0.001, "X belt play 0.0")):
        scan = Trace(points, measured, homed=True, placed=False, instrument=replace(FLATBED, wave_mm=wave_mm))
        assert report(learn_model(scan, ENDER3)).startswith(said)


@pytest.mark.parametrize(
    ("cause", "said"), [("creep", "said of something that gives way"), ("parameters", "measure mo")]
)
def test_a_refusal_names_what_would_have_to_be_put_right(
    cause: str, said: str, bent: SavedModel, tmp_path: Path
) -> None:
    (tmp_path / "part.gcode").write_bytes(SQUARE)
    prediction = check_gcode(tmp_path / "part.gcode", bent)
    doubted = replace(
        prediction,
        gain_mm=np.array([-0.1, 0.1]),
        after=replace(prediction.after, made_of={"rounding": 0.0, cause: 0.1}),
    )
    with open_gcode(tmp_path / "part.gcode") as file, pytest.raises(RefusedError, match=said):
        _check_worth_writing(file, bent, doubted, force=False)


def test_a_part_beyond_what_was_measured_is_told_so_before_printing(tmp_path: Path) -> None:
    (part := tmp_path / "part.gcode").write_bytes(SQUARE)  # from 60 to 80 mm
    rng = np.random.default_rng(5)
    for low, high, beyond in ((55.0, 95.0, False), (20.0, 77.0, False), (20.0, 70.0, True)):
        points = np.vstack([[ENDER3.home_mm], rng.uniform([low, 10.0], [high, 210.0], (300, 2))])
        measured = Twin.of(BENT, ENDER3).follow(points) + rng.normal(0, 0.02, points.shape)
        said = " ".join(check_gcode(part, learn_model(Trace(points, measured, homed=True), ENDER3)).advice)
        assert ("elsewhere the printer is thought to go on" in said) == beyond
        assert "lies at Y" not in said
        assert not beyond or re.search(r"lies at X 60 to 80 mm, and the test print showed 20 to (69|70):", said)


@pytest.mark.parametrize("turn_mm", [(49.0, 41.5), (34.0, 40.0)])
def test_a_pulley_of_a_far_other_size_is_learned_from_a_scan(turn_mm: tuple[float, float]) -> None:
    """What such a printer misses is tens of millimetres in the middle of the bed, and nothing at home."""
    printer = read_printer("corexy")
    plan = design_probe(printer)
    printed = np.asarray(printer.from_motor(printer.to_motor(plan.marks_mm) * np.array(turn_mm) / 40.0))
    seen = printed + np.random.default_rng(3).normal(0, 0.02, printed.shape) + [60.0, 80.0]
    document = learn_model(plan.trace(seen), printer).document
    assert not refusals(document)
    assert document["trace"]["residual_after_mm"] < 0.04
