"""What a model promises: the range holds the truth, and the drawn machines are those of the model's file."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive, Play, Polygon
from printmend.diagnosis.named import is_gap_of_z
from printmend.effects import EFFECTS, Of, Places, columns_of
from printmend.effects.effect import at_places
from printmend.effects.prior import share_of, size_mm
from printmend.effects.sized import Sized
from printmend.errors import ModelError, RefusedError
from printmend.export.firmware import remainder
from printmend.export.supported import export_supported
from printmend.gcode.container import open_gcode
from printmend.infer.machine import DRAWS
from printmend.learn.learned import learn_model
from printmend.learn.rows import _left_out
from printmend.machine import healthy_mechanism
from printmend.mend import check_gcode, mend_gcode
from printmend.mend.against import checked_against, judge_gcode
from printmend.mend.mend import _check_worth_writing
from printmend.mend.prediction import advice_of, doubt_mm
from printmend.messages import say
from printmend.model.model import SavedModel, exact_model
from printmend.path import FLATBED, Trace
from printmend.printer import read_printer
from printmend.probe import design_probe
from printmend.promise.belief import Belief, belief_section, parse_belief
from printmend.promise.predict import (
    DrawnCause,
    Errors,
    PathPlaces,
    Promise,
    _largest_of,
    _Side,
    _summed_up,
    _thinned,
    _weighted_p95,
    best_shift,
    promised,
    shape_of,
)
from printmend.promise.scatter import Outliers, Scatter
from printmend.promise.words import in_a_line
from printmend.report.part_view import look_at
from printmend.studio.scene import as_printed, read_drawing
from printmend.twin import Twin
from tests.believed import SCENES
from tests.believed import part as believed_part
from tests.mending import SQUARE, coarsely
from tests.promised import BENT, CIRCLE, ENDER3, HEALTHY, measured, scanned


@pytest.fixture(scope="module")
def bent() -> SavedModel:
    return learn_model(measured(BENT, 0.05, 1), ENDER3)


def shape_mm(part: Path, corruption: Corruption) -> float:
    """Return how far a part as it is lies from its shape, RMS."""
    path = check_gcode(part, exact_model(coarsely(corruption))).path
    assert path is not None
    return float(np.sqrt(np.average(shape_of(path) ** 2, weights=path.weight)))


@pytest.fixture
def part(tmp_path: Path) -> Path:
    (tmp_path / "part.gcode").write_text(CIRCLE)
    return tmp_path / "part.gcode"


def test_a_line_of_causes_says_what_counts_and_calls_effects_as_everywhere() -> None:
    line = in_a_line({"uneven": 0.004, "parameters": 0.02, "rub": 0.0051, "rounding": 0.0004})
    assert line == "what the test print left open 90 %; lost motion that changes along an axis 6 %"


def test_the_promise_is_kept_and_says_what_it_is_made_of(bent: SavedModel, part: Path) -> None:
    done = mend_gcode(part, bent, part.with_name("out.gcode"))
    plain = json.loads(json.dumps(done.prediction.json()))
    after = plain["after"]
    assert plain["made_of"] == after["made_of"]
    assert plain["planning_rms_mm"] == after["planning_rms_mm"] < 0.003
    assert {"parameters", "scatter", "motion", "rounding", "planning"} <= set(after["made_of"])
    assert done.prediction.after.combined_mm > after["rms_mm"]  # rare errors are large ones
    truth = judge_gcode(part, part.with_name("out.gcode"), Twin.of(BENT, ENDER3))
    true_mm = np.hypot(truth.after.rms_mm, after["made_of"]["rounding"])  # the twin has no micro-steps
    assert 0.5 * after["rms_low_mm"] < true_mm < after["rms_high_mm"] < 0.04
    assert after["rms_low_mm"] < after["rms_mm"] < after["rms_high_mm"]
    assert after["rms_mm"] < after["p95_mm"] < after["max_mm"] < 0.12
    assert after["rms_high_mm"] < after["max_mm"]
    assert done.prediction.before.rms_low_mm < shape_mm(part, BENT) < done.prediction.before.rms_high_mm
    said = done.prediction.summary()
    assert "90 % of prints" in said
    assert re.search(r"causes of the mean square error after mending: .*what the test print left open \d+ %", said)


def test_figures_and_pictures_leave_the_same_shift_out(part: Path) -> None:
    """Each homing puts a print elsewhere: figures, the page's colours and the report's are of the shape."""
    model = learn_model(scanned(measured(BENT, 0.02, 1), np.zeros((2, 2)), FLATBED), ENDER3)
    done = mend_gcode(part, model, part.with_name("out.gcode")).prediction
    assert done.of_shape
    shift_mm = float(np.hypot(*done.shift_mm))
    assert shift_mm > 0.05
    assert f"the whole print is shifted by {shift_mm:.2f} mm" in done.summary()
    assert done.json()["shift_mm"] == pytest.approx(done.shift_mm)
    itself = checked_against(check_gcode(part, model), str(part), str(part), model)
    assert itself.is_untouched  # held against itself it is no worse by its shift
    assert itself.after == itself.before == done.before
    drawing = read_drawing(part, ENDER3)
    shape, all_of = (as_printed(drawing, model.mechanism, aligned=aligned) for aligned in (True, False))
    assert done.path is not None
    figure = float(np.sqrt(np.average(shape_of(done.path) ** 2, weights=done.path.weight)))
    assert shape.rms_mm(shape.raw_error_mm) == pytest.approx(figure, rel=0.03)
    assert all_of.rms_mm(all_of.raw_error_mm) > 1.1 * figure
    view = look_at(part, part.with_name("out.gcode"), model.mechanism, shift_mm=done.shift_mm)
    assert view is not None
    assert np.sqrt(np.mean(view.before.off_mm**2)) == pytest.approx(figure, rel=0.05)
    known = check_gcode(part, exact_model(coarsely(BENT)))  # its figures contain the place
    assert not known.of_shape
    assert "These figures include the shift" in known.summary()
    still = check_gcode(part, exact_model(coarsely(HEALTHY)))
    assert (still.shift_words, still.shift_mm) == ("", pytest.approx((0.0, 0.0), abs=1e-9))


def test_colours_and_layers_state_the_error_of_the_figures(bent: SavedModel, part: Path) -> None:
    """Not only the part of it that the model itself says, which is next to nothing once it is mended."""
    done = mend_gcode(part, bent, part.with_name("out.gcode")).prediction
    doubts_mm = doubt_mm(done.before), doubt_mm(done.after)
    view = look_at(part, part.with_name("out.gcode"), bent.mechanism, shift_mm=done.shift_mm, doubt_mm=doubts_mm)
    assert view is not None
    for name, drawn in (("before", view.before), ("after", view.after)):
        figure = getattr(done, name).rms_mm
        assert np.sqrt(np.mean(drawn.off_mm**2)) == pytest.approx(figure, rel=0.05)
        lengths, rows = zip(*((row["length_mm"], row[f"{name}_rms_mm"]) for row in done.layers), strict=True)
        assert np.sqrt(np.average(np.square(rows), weights=lengths)) == pytest.approx(figure, rel=0.01)


def test_less_is_promised_where_less_was_measured(bent: SavedModel, part: Path) -> None:
    poor = learn_model(measured(BENT, 0.2, 1, 250), ENDER3)
    promises = [check_gcode(part, model).after for model in (bent, poor)]
    assert promises[1].rms_mm > 2 * promises[0].rms_mm
    assert promises[1].rms_low_mm > 2 * promises[0].rms_low_mm
    # what no mark shows of the motion and of the next homing is the same, and reaches farther than either noise
    assert promises[1].rms_high_mm > promises[0].rms_high_mm


def test_a_model_that_says_nothing_of_its_doubt_promises_what_it_plans(part: Path) -> None:
    after = check_gcode(part, exact_model(coarsely(BENT))).after
    assert after.rms_low_mm == after.rms_mm == after.rms_high_mm == after.planning_rms_mm
    assert set(after.made_of) == {"planning"}


def test_a_learner_without_doubt_promises_no_less_than_it_leaves(part: Path) -> None:
    trace = measured(BENT, 0.05, 1, 250)
    model = learn_model(trace, ENDER3, model="naive")
    before = check_gcode(part, model).before
    off_mm = np.sqrt(np.mean((trace.measured_mm - trace.commanded_mm) ** 2))
    assert before.rms_low_mm < off_mm < before.rms_high_mm
    assert before.made_of["uneven"] > 0.9 * before.rms_mm


def test_drawn_machines_move_marks_as_their_effects_say(bent: SavedModel) -> None:
    """A mark of a drawn machine lies from that of the mean machine by the part's columns times what it was drawn."""
    belief = parse_belief(bent)
    assert belief is not None
    (play,) = belief.of("play", 1)
    at = np.stack([np.full(120, 110.0), np.linspace(40, 180, 120)], axis=1)
    tangent, off = np.tile([0.0, 1.0], (120, 1)), np.zeros(120)
    way = np.vstack([at[0] - [0.0, 30.0], at])
    for draw in range(0, DRAWS, 30):
        table = bent.mechanism.transmissions[1]
        wider_mm = float(play.draws_mm[0, draw] - play.acts_mm[0])
        other = replace(table, lower_mm=table.lower_mm - wider_mm / 2, upper_mm=table.upper_mm + wider_mm / 2)
        machine = replace(bent.mechanism, transmissions=(bent.mechanism.transmissions[0], other))
        moved = (Twin(machine).follow(way) - Twin(bent.mechanism).follow(way))[1:, 1]
        scene = belief.scene
        places = Places(
            ENDER3.to_motor(at), -np.sign(tangent), at, tangent, tangent, off, np.full(120, 50.0), np.zeros((120, 2))
        )
        said = columns_of("play", places, 1, (), scene)[:, 1, 0] * wider_mm
        assert moved == pytest.approx(said, abs=1e-6)


def test_what_builds_up_is_promised_by_how_far_a_part_goes_between_its_turns(tmp_path: Path) -> None:
    """Of two squares, the small one turns round before the lag has built up."""
    twin = Twin.of(HEALTHY, ENDER3).with_effects([Sized("soft_play", 0, (8.0,), np.array([0.3]))])
    rng, expected = np.random.default_rng(2), []
    way = np.concatenate([[[0.0, 0.0]], 110 + np.cumsum(rng.uniform(-12, 12, (400, 2)), axis=0) / 3])
    model = learn_model(Trace(way, twin.follow(way) + rng.normal(0, 0.03, way.shape), homed=True), ENDER3)
    for side_mm in (3.0, 60.0):
        corners = 110 + side_mm * np.array([(0, 0), *((1, 0), (1, 1), (0, 1), (0, 0)) * 8])
        part, lines = tmp_path / "part.gcode", "".join(f"G1 X{x} Y{y} E0.1\n" for x, y in corners[1:])
        part.write_text(f"G21\nG90\nM83\nG28\nG1 Z0.2 F600\nG0 X110 Y110 F6000\n{lines}")
        path = np.vstack([[[0.0, 0.0]], *np.linspace(corners[:-1], corners[1:], 21, axis=1)])
        off_mm, way = (twin.follow(path) - path)[1:], np.repeat(np.diff(corners, axis=0), 21, axis=0) / side_mm
        normal = np.stack([-way[:, 1], way[:, 0]], axis=1)
        across_mm = (off_mm * normal).sum(axis=1)
        across_mm -= normal @ np.linalg.lstsq(normal, across_mm, rcond=None)[0]  # each homing shifts all of it
        true_mm = np.sqrt(np.mean(across_mm**2))
        promise = check_gcode(part, model).before
        assert promise.rms_low_mm < true_mm < promise.rms_high_mm
        expected.append(promise.rms_mm)
    assert expected[0] < 0.6 * expected[1]


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
    belief, error = parse_belief(bent), Errors(0.002, 0.004, 0.006)
    assert belief is not None
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    tangent = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    most_mm = []
    for length_mm in (2.5e-4, 1.0, 100.0):  # of each place: 0.1 mm, 0.4 m, and 40 m of lines over the same places
        path = PathPlaces(
            110 + 30 * np.stack([np.cos(angle), np.sin(angle)], axis=1), tangent, np.zeros(400), np.sign(tangent),
            np.full(400, length_mm),
        )  # fmt: skip
        outlook = promised(bent.mechanism, belief, path, error, error)
        assert outlook is not None
        assert outlook.after.rms_mm < outlook.after.p95_mm <= outlook.after.max_mm
        most_mm.append(outlook.after.max_mm)
    assert most_mm[0] < most_mm[1]
    assert 1.05 * most_mm[1] < most_mm[2] < 2 * most_mm[1]


def test_a_motor_that_rounding_moves_stands_still(rng: np.random.Generator) -> None:
    """Lines at 45° on a CoreXY move one motor; that their ends are rounded does not turn the other one round."""
    printer = read_printer("corexy")
    belief = parse_belief(
        learn_model(measured(Corruption((Drive(), Drive(belt=Play(0.3)))), 0.02, 6, 300, printer), printer)
    )
    assert belief is not None
    side = np.repeat(np.where(np.arange(40) % 2, 1.0, -1.0), 10)
    straight = np.stack([side, side], axis=1) / np.sqrt(2)
    places = 150 + np.linspace(-20, 20, 400)[:, None] * [1.0, -1.0] + np.tile(np.linspace(-20, 20, 10), 40)[:, None]
    error = Errors(0.0, 0.0, 0.0)
    expected = []
    for lean in (0.0, 2e-5):  # a thousandth of a millimetre in 50
        tangent = straight + lean * rng.choice([-1.0, 1.0], 40).repeat(10)[:, None] * [1.0, -1.0]
        pushed = np.stack([side, np.ones(400)], axis=1)
        path = PathPlaces(places, tangent, np.zeros(400), pushed, np.ones(400))
        outlook = promised(exact_model(Twin.of(HEALTHY, printer).mechanism).mechanism, belief, path, error, error)
        assert outlook is not None
        expected.append(outlook.before.rms_mm)
    assert expected[1] == pytest.approx(expected[0], abs=1e-4)  # a turn would add a tenth of a millimetre


def test_a_print_of_half_a_turn_promises_by_the_machines_that_it_allows(part: Path) -> None:
    """Half of a polygon may be half of an oval, of a triangle or of neither. A whole turn tells."""
    rng, out = np.random.default_rng([61, 0]), part.with_name("out.gcode")
    twin, high_mm = Twin.of(Corruption((Drive(pulley=Polygon(tuple(rng.uniform(6.2, 7.4, 5)))), Drive())), ENDER3), []
    for reach_mm in (9, 40):
        way = np.concatenate([[[0.0, 0.0]], 100 + rng.uniform(-reach_mm, reach_mm, (300, 2))])
        trace = Trace(way, twin.follow(way) + rng.normal(0, 0.05, way.shape), homed=True)
        promise = mend_gcode(part, learn_model(trace, ENDER3), out, force=True).prediction.after
        true_mm = np.hypot(judge_gcode(part, out, twin).after.rms_mm, promise.made_of["rounding"])  # it has no steps
        assert 0.9 * promise.rms_low_mm < true_mm < 1.1 * promise.rms_high_mm  # quantiles of 96 draws are as uncertain
        high_mm.append(promise.rms_high_mm)
    assert high_mm[0] > 2 * high_mm[1]


def test_ringing_that_no_mark_at_rest_shows_lies_in_the_range(bent: SavedModel, part: Path) -> None:
    """A head that swings by 0.05 mm after a corner every 10 mm, 0.013 mm typically, at 40 Hz and 30 mm/s.

    The marks of the test print were made at rest, so the model cannot know; the range must. It is of nine prints in
    ten: larger swings, as of 0.07 mm, are the twentieth's.
    """
    promise = mend_gcode(part, bent, part.with_name("out.gcode")).prediction.after
    since_corner_mm = np.linspace(0, 10, 1000)
    swing_mm = 0.05 * np.exp(-since_corner_mm / 2.5) * np.cos(2 * np.pi * 40 / 30 * since_corner_mm)
    planned = judge_gcode(part, part.with_name("out.gcode"), Twin.of(BENT, ENDER3)).after.rms_mm
    true_mm = np.hypot(planned, np.sqrt(np.mean(swing_mm**2)))
    assert true_mm > 0.012
    assert promise.rms_low_mm < true_mm < promise.rms_high_mm
    assert "motion" in promise.made_of


def test_a_printer_that_sticks_is_promised_no_better_than_its_marks_scatter(
    part: Path, rng: np.random.Generator
) -> None:
    """Each axis stops anywhere within 0.1 mm of where it was sent; the callipers say that they read to 0.01 mm.

    How much of that is the dots' own is not known: any share of its variance is as likely, half of it is expected.
    """
    trace = measured(BENT, 0.01, 7)
    stuck = rng.uniform(-0.05, 0.05, trace.measured_mm.shape)
    sticking = replace(trace, measured_mm=trace.measured_mm + stuck, sigma_mm=np.full(len(trace), 0.01))
    model = learn_model(sticking, ENDER3)
    promise = mend_gcode(part, model, part.with_name("out.gcode")).prediction.after
    planned = judge_gcode(part, part.with_name("out.gcode"), Twin.of(BENT, ENDER3)).after.rms_mm
    true_mm = np.hypot(planned, 0.05 / np.sqrt(3))  # across a line it is off by as much as either axis
    assert promise.rms_low_mm < true_mm < promise.rms_high_mm
    assert promise.made_of["scatter"] == pytest.approx(0.05 / np.sqrt(3) / np.sqrt(2), rel=0.05)


def test_a_shape_is_not_worse_for_lying_elsewhere() -> None:
    """A part 3 mm off its place, whose lines end so far from where they should that their distance is larger still."""
    angle, nothing = np.linspace(0, 2 * np.pi, 40, endpoint=False), np.zeros((40, 2))
    tangent = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    off = -3.0 * tangent[:, 1] + 0.1 * np.sin(5 * angle)
    path = PathPlaces(nothing, tangent, off, nothing, np.ones(40))
    known = Errors(1.1 * float(np.sqrt(np.mean(off**2))), 3.0, 3.2)
    alone, rng = np.zeros(DRAWS), np.random.default_rng(0)
    side, home = _Side(path, off, {}, {}, known, signed=True), np.zeros((2, DRAWS))
    (shape, whole_mm), (_, own_mm) = (_summed_up(side, home, alone, rng, placed=placed) for placed in (True, False))
    assert whole_mm == pytest.approx(np.sqrt(np.mean(off**2)))  # by which mending is judged
    assert own_mm == pytest.approx(shape.rms_mm)
    assert np.hypot(*best_shift(tangent, off, path.weight)) == pytest.approx(3.0, rel=0.01)
    assert shape.place_mm == 0.0  # the next homing moves nothing
    assert shape.rms_mm == pytest.approx(0.1 / np.sqrt(2), rel=0.2)
    assert shape.rms_mm <= shape.max_mm
    assert shape.planning_rms_mm == pytest.approx(shape.rms_mm)
    many = PathPlaces(*(np.repeat(each, 40, axis=0) for each in (nothing, tangent, off, nothing, np.ones(40))))
    many = replace(many, off_mm=many.off_mm * (1 + (np.arange(1600) % 7 == 0)))
    few, all_of = (shape_of(each) for each in (_thinned(many), many))
    assert len(few) < 1600
    assert np.mean(few**2) == pytest.approx(np.mean(all_of**2), rel=0.01)
    for across in (0.1, 0.2, 0.3, 0.6):  # merely shifted: rounding may leave less than nothing of its shape
        off = across * tangent[:, 0] - 3.0 * tangent[:, 1]
        side = _Side(path, off, {}, {}, known, signed=True)
        assert _summed_up(side, home, alone, rng, placed=False)[0].rms_mm == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("placed", [True, False])
def test_what_is_summed_up_at_once_is_what_each_drawn_machine_prints(rng: np.random.Generator, placed: bool) -> None:
    angle, weight, off = rng.uniform(0, 7, 40), rng.uniform(1, 2, 40), rng.normal(0, 0.1, 40)
    tangent = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    causes = {
        name: DrawnCause(rng.normal(0, 0.05, (40, k)), rng.standard_normal((k, DRAWS)))
        for name, k in (("instrument", 3), ("homing", 2))
    }
    local = {"motion": DrawnCause(rng.uniform(0, 1e-4, (40, 2)), rng.uniform(0, 1, (2, DRAWS)))}
    path = PathPlaces(np.zeros((40, 2)), tangent, off, np.zeros((40, 2)), weight)
    known = Errors(float(np.sqrt(np.average(off**2, weights=weight))), 0.2, 0.3)
    side = _Side(path, off, causes, local, known, signed=True)
    home_mm = np.full((2, DRAWS), 0.1)
    promise, judged = _summed_up(side, home_mm, np.zeros(DRAWS), rng, placed=placed)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    root = np.sqrt(weight)[:, None]
    doubt = sum(each.columns @ each.drawn for each in causes.values())
    shift = np.linalg.lstsq(normal * root, (off[:, None] + doubt) * root, rcond=None)[0]
    known = normal @ np.linalg.lstsq(normal * root, off[:, None] * root, rcond=None)[0]
    shape = off[:, None] + doubt - normal @ shift
    beside = local["motion"].columns @ local["motion"].drawn
    rms, with_known = (np.sqrt(np.average(each**2 + beside, axis=0, weights=weight)) for each in (shape, shape + known))
    assert judged == pytest.approx(with_known if placed else rms, abs=1e-7)
    assert promise.rms_mm == pytest.approx(np.median(rms))
    homing = causes["homing"].columns @ causes["homing"].drawn  # an open scale's shift is no scatter of homings
    homed = np.linalg.lstsq(normal * root, homing * root, rcond=None)[0]
    assert promise.place_mm == pytest.approx(np.median(np.hypot(*(homed + home_mm))))
    for name, each in causes.items():
        error = each.columns @ each.drawn
        error -= normal @ np.linalg.lstsq(normal * root, error * root, rcond=None)[0]
        assert promise.made_of[name] == pytest.approx(np.sqrt(np.mean(np.average(error**2, axis=0, weights=weight))))
    assert promise.combined_mm**2 == pytest.approx(sum(size_mm**2 for size_mm in promise.made_of.values()))
    apart = np.sqrt(np.average(local["motion"].columns @ local["motion"].drawn, axis=0, weights=weight))
    for along in (-1.0, 1.0):  # what nothing explains lies against what is known, or with it
        told = _summed_up(side, home_mm, np.full(DRAWS, along), rng, placed=placed)[0]
        assert told.rms_mm == pytest.approx(np.median(np.sqrt(rms**2 - apart**2) + along * apart))


def test_noise_by_chance_above_the_instruments_is_no_printers_scatter(rng: np.random.Generator) -> None:
    """Printers drawn from the prior lie in the ranges of their own scatter as often as these say."""
    share, sd_mm = share_of("scatter"), size_mm("scatter")
    own_mm, chance, inside, none = 0.05, (np.arange(DRAWS) + 0.5) / DRAWS, [], []
    for _ in range(400):
        true_mm = abs(rng.normal(0, sd_mm)) * (rng.random() < share)
        left_mm = rng.normal(0, np.hypot(own_mm, true_mm), 1200)
        drawn_mm2 = Scatter.of(np.sum(left_mm**2) / 1180, 1180, own_mm).quantiles_mm2(chance)
        low, high = np.quantile(drawn_mm2, [0.05, 0.95])
        inside.append(low <= true_mm**2 + 2e-6 and true_mm**2 - 2e-6 <= high)
        none.append((drawn_mm2 == 0).mean())
    assert np.mean(inside) > 0.87
    assert np.mean(none) == pytest.approx(1 - share, abs=0.08)
    assert not Scatter.of(np.sum(left_mm**2) / 1180, 1180, None).quantiles_mm2(chance).any()


def test_many_points_that_fit_no_model_are_the_printers_and_a_few_are_dirt() -> None:
    told = {
        count: Outliers(count, 600, 0.01).drawn_mm2(4000, np.random.default_rng(3)) / 0.01 for count in (0, 1, 12, 130)
    }
    assert not told[0].any()
    assert np.mean(told[1]) < 1e-4
    assert np.mean(told[12] > 0) < 0.1
    assert np.mean(told[130] > 0) > 0.9
    assert 0.15 < np.median(told[130]) < told[130].max() <= 130 / 600


def test_no_printer_throws_a_dot_to_where_a_wrong_cell_lies(rng: np.random.Generator) -> None:
    near_mm, far_mm = (size * rng.standard_normal((60, 2)) for size in (0.1, 10.0))
    assert Outliers.of(near_mm, 600).count > 50
    assert Outliers.of(far_mm, 600).count < 5
    both = Outliers.of(np.vstack([near_mm, far_mm]), 600)
    assert math.sqrt(both.square_mm2) == pytest.approx(0.1, rel=0.5)


@pytest.mark.parametrize(("by_hand", "words"), [(True, "check the table"), (False, "Look for dirt or damage")])
def test_nobody_wrote_the_table_of_a_scan(by_hand: bool, words: str) -> None:
    (found,) = _left_out(np.full((120, 2), 0.1), np.zeros((120, 2)), 600, by_hand=by_hand)
    assert words in found.words


def test_printers_drawn_with_outliers_have_as_many_as_is_said(rng: np.random.Generator) -> None:
    """The mean over printers and instruments of the prior, counted as a posterior must (Talts et al. 2018)."""
    true, said = [], []
    for _ in range(3000):
        own = rng.exponential(0.1) * (rng.random() < 0.05)
        count = rng.poisson(600 * (rng.exponential(0.02) + own))
        if count <= 600:
            true.append(own)
            said.append(np.mean(Outliers(int(count), 600, 1.0).drawn_mm2(200, rng)))
    assert np.mean(said) == pytest.approx(np.mean(true), abs=0.0015)
    few = np.argsort(said)[: len(said) * 9 // 10]
    assert np.mean(np.array(said)[few]) == pytest.approx(np.mean(np.array(true)[few]), abs=0.0005)


def test_a_file_of_an_older_version_has_its_scatter_as_a_size(bent: SavedModel) -> None:
    section = {key: value for key, value in bent.document["promise"].items() if key != "scatter_mm2"}
    belief = parse_belief(replace(bent, document={**bent.document, "promise": {**section, "scatter_mm": 0.02}}))
    assert belief is not None
    assert belief.scatter.quantiles_mm2(np.array([0.1, 0.9])) == pytest.approx(0.0004)


def test_what_shifts_all_of_a_print_keeps_no_fault_from_being_mended(rng: np.random.Generator) -> None:
    """It does the same to both files: only the place that is stated beside the shape holds it."""
    angle, weight, off = rng.uniform(0, 7, 40), rng.uniform(1, 2, 40), rng.normal(0, 0.1, 40)
    tangent = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    path, normal = PathPlaces(np.zeros((40, 2)), tangent, off, np.zeros((40, 2)), weight), tangent[:, ::-1] * [-1, 1]
    known = Errors(float(np.sqrt(np.average(off**2, weights=weight))), 0.2, 0.3)
    slipped, nowhere, aside = (
        DrawnCause(normal, np.full((2, DRAWS), 0.3)),
        np.zeros((2, DRAWS)),
        np.full((2, DRAWS), 0.3),
    )
    (none, judged), *others = (
        _summed_up(_Side(path, off, causes, {}, known, signed=True), home_mm, np.zeros(DRAWS), rng, placed=True)
        for causes, home_mm in (({}, nowhere), ({"homing": slipped}, nowhere), ({}, aside))
    )
    for told, own in others:
        np.testing.assert_allclose(own, judged, atol=1e-6)
        assert told.rms_mm == pytest.approx(none.rms_mm, abs=1e-6)
        assert told.place_mm > none.place_mm + 0.3


def test_a_print_that_is_faster_than_dots_is_less_warm_when_it_ends() -> None:
    """A test print stands at each dot; nobody says how long it took. Marks of another one take as long as its own."""
    scene, sizes = replace(SCENES["ender3"], homed=True), [0.2, 0.0, 0.0, 0.2, 0.0, 0.0]
    warms = believed_part("warmth", 0, sizes, (0.4,))
    angle = np.linspace(0, 40 * np.pi, 400)
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    wanted, weight = scene.middle_mm + 80 * normal, np.full(400, scene.way_mm / 400)  # as long as the test print
    path = PathPlaces(wanted, normal[:, ::-1] * [1, -1], np.zeros(400), np.ones((400, 2)), weight)

    def true_mm(pace: float) -> float:
        places = at_places(bed_mm=wanted, done=pace * np.cumsum(weight) / scene.way_mm)
        moved = columns_of("warmth", places, 0, (0.4,), scene) @ sizes
        return float(np.sqrt(np.mean((moved * normal).sum(axis=1) ** 2)))

    belief, none = Belief(scene, (warms,), True), Errors(0.0, 0.0, 0.0)
    line, dots = (
        promised(healthy_mechanism(ENDER3), belief, path, none, none, at_rest=at_rest) for at_rest in (False, True)
    )
    assert line is not None
    assert dots is not None
    assert all(line.before.rms_low_mm < true_mm(pace) < line.before.rms_high_mm for pace in (0.25, 0.4, 1.0))
    assert dots.before.rms_low_mm < true_mm(1.0) < dots.before.rms_high_mm
    assert true_mm(0.4) < dots.before.rms_low_mm


def test_a_section_that_is_none_of_ours_is_refused_in_one_line(bent: SavedModel) -> None:
    section = dict(bent.document["promise"])
    first, *others = section["parts"]
    for changed in (
        {**section, "version": 1},
        {**section, "parts": [{**first, "effect": "nobody"}, *others]},
        {**section, "parts": [{**first, "where": 7}, *others]},
        {**section, "parts": [{**first, "effect": "uneven", "shape": []}, *others]},
        {**section, "parts": [{**first, "acts": [*first["acts"], 0.0]}, *others]},
        {**section, "parts": [{**first, "draws": [row[1:] for row in first["draws"]]}, *others]},
        {**section, "parts": [{**first, "there": [DRAWS]}, *others]},
        {**section, "parts": [first] * 1500},
        {**section, "turns_mm": [40.0, -1.0]},
        {**section, "bed_span_mm": [[1.0, 0.0], [0.0, 1.0]]},
        {**section, "way_mm": "far"},
        {**section, "scatter_mm2": [0.0, -1.0]},
        {**{name: value for name, value in section.items() if name != "scatter_mm2"}, "scatter_mm": None},
        {**section, "outliers": [7, 3, 0.1]},
        [],
    ):
        with pytest.raises(ModelError) as refused:
            parse_belief(replace(bent, document={**bent.document, "promise": changed}))
        assert "\n" not in str(refused.value)
    older = {key: value for key, value in bent.document.items() if key != "promise"}
    assert parse_belief(replace(bent, document=older)) is None


def test_what_a_file_says_of_its_drawn_machines_is_what_was_drawn(bent: SavedModel) -> None:
    belief = parse_belief(bent)
    assert belief is not None
    again = belief_section(belief.scene, belief.parts, scatter=belief.scatter)
    assert json.loads(json.dumps(again)) == json.loads(json.dumps({**bent.document["promise"], **again}))
    for part in belief.parts:
        assert part.draws_mm.shape == (len(part.acts_mm), DRAWS)
        assert EFFECTS[part.effect].of is not Of.INSTRUMENT
        if part.acts_mm.any() and part.chance > 0.99:  # what acts is the mean of what was drawn
            sd = part.draws_mm.std(axis=1) / np.sqrt(DRAWS)
            assert (np.abs(part.draws_mm.mean(axis=1) - part.acts_mm) < 5 * sd + 1e-6).all(), part.effect


def test_a_firmware_gets_only_what_helps_by_more_than_its_doubt(bent: SavedModel) -> None:
    export = export_supported(bent, "marlin")
    assert set(export.settings) == {"backlash of X", "backlash of Y"}
    assert export.after_mm < export.before_mm
    assert 0.001 < export.doubt_mm < 0.1
    assert export.doubt_mm > 0.015  # what a printer may do in motion, which no dot at rest shows, as in `mend`'s range
    without, most = (np.hypot(each, export.doubt_mm) for each in (export.before_mm, export.after_mm))
    assert f"up to {without:.3f} mm without these settings, up to {most:.3f} mm with them" in remainder(export)
    text = dict(export.files)["marlin.gcode"]
    assert "M500" not in text
    assert "to undo" in text
    why = "backlash of X and backlash of Y: Klipper has no setting for backlash"
    with pytest.raises(RefusedError, match=why) as refused:
        export_supported(bent, "klipper")
    assert "`printmend mend` mends the files" in str(refused.value)


def test_a_shift_that_learning_took_off_is_told_beside_that_of_the_print(bent: SavedModel, part: Path) -> None:
    trace = measured(BENT, 0.05, 1)
    aside = learn_model(replace(trace, measured_mm=trace.measured_mm + 1.0), ENDER3)
    for model in (bent, aside):
        done = check_gcode(part, model)
        assert done.shift_words
        assert any("the test print showed is no part" in each for each in done.advice) == (model is aside)


def test_most_of_a_doubt_is_told_before_printing(bent: SavedModel) -> None:
    wide = Promise(0.05, 0.1, 0.2, 0.02, 0.09, 0.0, 0.001, {"planning": 0.001, "parameters": 0.049})
    gap = say("seen-over-part-of-turn", "X", "30", say("print-least-mm-along-better-two", "40", "X", "80"))
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


@pytest.mark.parametrize(
    ("step_mm", "noise_mm", "drive"),
    [*((step_mm, noise_mm, BENT.drives[0]) for step_mm, noise_mm in ((0.1, 0.005), (0.1, 0.02), (0.5, 0.06))),
     (0.5, 0.06, Drive())],
)  # fmt: skip
def test_a_rounded_table_makes_no_ripple(step_mm: float, noise_mm: float, drive: Drive) -> None:
    """A last digit is an error of the instrument: it acts on nothing, and no point is left out for it. Y is healthy."""
    plan, rng = design_probe(ENDER3), np.random.default_rng(3)
    places = Twin.of(Corruption((drive, Drive())), ENDER3).follow(plan.waypoints_mm)
    places = places + rng.normal(0, noise_mm, places.shape)
    measured_mm = np.full_like(places, np.nan)
    measured_mm[plan.rows] = step_mm * np.round(places[plan.rows] / step_mm)
    sigma_mm = np.full(len(places), 0.03)
    trace = Trace(plan.waypoints_mm, measured_mm, sigma_mm=sigma_mm, homed=True, step_mm=step_mm)
    model = learn_model(trace, ENDER3)
    faults = {(row["part"], row["kind"].rstrip("0123456789-")) for row in model.document["diagnosis"]}
    assert faults == (set() if drive == Drive() else {("x", "harmonic"), ("x", "play")})
    assert "left_out" not in model.document["trace"]
    assert model.is_healthy == (drive == Drive())


@pytest.mark.parametrize(("percent", "others"), [(0.2, (0.2, 0.0)), (-0.2, (-1.0, -1.0))])
def test_a_scale_of_both_axes_alike_may_be_the_instruments(
    percent: float, others: tuple[float, float], part: Path
) -> None:
    """Nothing acts on what a rule of another length shows, and what is promised holds the printer that does it, too. A
    scale of one axis is the machine's, and so is one that no instrument has."""
    printer = read_printer("ender3")
    plan, rng = design_probe(printer), np.random.default_rng(6)

    def learned(*percents: float) -> SavedModel:
        measured_mm = np.full_like(plan.waypoints_mm, np.nan)
        true_mm = plan.waypoints_mm[plan.rows]
        measured_mm[plan.rows] = true_mm * (1 + np.array(percents) / 100) + rng.normal(0, 0.05, true_mm.shape)
        return learn_model(Trace(plan.waypoints_mm, measured_mm, homed=True), printer)

    alike = learned(percent, percent)
    assert alike.is_healthy
    assert "more likely the scale of the instrument" in str(alike.document["misfit"])
    stays = check_gcode(part, alike).before
    assert stays.rms_low_mm < 0.005 < 0.05 < stays.rms_high_mm  # of a part 25 to 30 mm about its middle
    assert not learned(*others).is_healthy


def test_a_tall_part_is_told_that_a_flat_print_shows_no_screw(bent: SavedModel, tmp_path: Path) -> None:
    low = "G21\nG90\nM83\nG28\n" + "".join(
        f"G1 Z{z} F600\nG0 X{60 + z} Y60 F6000\nG1 X120 E5 F1800\nG1 Y120 E5\n" for z in (0.2, 0.4, 0.6)
    )
    for text, is_tall in ((low, False), (low.replace("Z0.6", "Z1.6"), True)):  # a turn is 8 mm
        (tmp_path / "part.gcode").write_text(text)
        prediction = check_gcode(tmp_path / "part.gcode", bent)
        assert any("within each layer" in each for each in prediction.json()["advice"]) == is_tall
    assert any(is_gap_of_z(gap) for gap in bent.findings)


@pytest.mark.parametrize(
    ("cause", "said"),
    [
        ("creep", "a shift that slows down"),
        ("parameters", "whole `printmend probe`"),
        ("instrument", "--distance"),
        ("rounding", "measure more"),
    ],
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
    part, rng = tmp_path / "part.gcode", np.random.default_rng(5)
    points = np.vstack([[ENDER3.home_mm], rng.uniform([20.0, 10.0], [70.0, 210.0], (300, 2))])
    measured = Twin.of(BENT, ENDER3).follow(points) + rng.normal(0, 0.02, points.shape)
    model = learn_model(Trace(points, measured, homed=True), ENDER3)
    for left, beyond in ((b"53", False), (b"60", True)):
        right = b"%d" % (int(left) + 20)
        part.write_bytes(SQUARE.replace(b"X60", b"X" + left).replace(b"X80", b"X" + right))
        said = " ".join(check_gcode(part, model).advice)
        assert ("The model assumes that the rest of the axis is the same" in said) == beyond
        assert "is at Y" not in said
        assert not beyond or re.search(r"is at X 60 to 80 mm, but the test print showed only 20 to (69|70)", said)
