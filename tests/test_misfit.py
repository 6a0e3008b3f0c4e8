"""What does not fit: found, named, put right where that is certain, and not seen where all is well."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from printmend.promise.budget import parse_budget
from printmend.promise.effects import (
    BEGUN,
    EARLY,
    EARLY_DONE,
    ENDED,
    LEARNED,
    SHIFT_STAYS,
    STAYS,
    Effect,
    PrintPlaces,
    parse_effects,
)
from printmend.promise.misfit_columns import Candidate
from printmend.promise.misfit_tests import (
    IN_TIME,
    Cause,
    _near,
    _once,
    _one_border,
    _tilted,
    _tilts,
    _words,
    as_printed,
    causes_of,
    effects_of,
    found_in,
    of_one_time,
    unrest_mm,
)
from printmend.promise.walk import RATIOS, walk_of

from printmend.cli.main import group
from printmend.corruption import Corruption, CrookedFrame, Drive, EccentricBore, Play, WrongRadius, sample
from printmend.diagnosis.advice import advise
from printmend.diagnosis.diagnosis import NamedFault
from printmend.errors import InputError, TraceError
from printmend.identify.drive.sight import sight
from printmend.identify.drive.turn import roughly_turned, turned
from printmend.learn.greybox.greybox import Greybox
from printmend.learn.greybox.model import GreyboxModel
from printmend.learn.greybox.previous import remember
from printmend.learn.greybox.rows import motor_rows
from printmend.machine import print_from_home
from printmend.machine.mechanism import healthy_mechanism
from printmend.measure import read_trace, write_trace
from printmend.path import FLATBED, Instrument, Trace, last_way
from printmend.printer import Printer, read_printer
from printmend.probe import design_probe
from printmend.probe.probe import keep_plan
from printmend.promise import misfit_rows, predict
from printmend.promise.misfit import misfit_section
from printmend.promise.misfit_printer import another_home, another_printers
from printmend.promise.misfit_rows import in_order
from printmend.repair.learned import Learned, learn, learn_model, report
from printmend.repair.update import update
from printmend.saved import Wave, branches_of, read_model, write_model
from printmend.twin import Twin
from printmend.units import TURN_RAD

PRINTER = read_printer("ender5")
Change = Callable[[np.ndarray], np.ndarray]


def measured_once(rng: np.random.Generator, count: int = 400) -> Trace:
    corners = np.vstack([[PRINTER.home_mm], rng.uniform(10, 210, (30, 2))])
    along = np.linspace(0, len(corners) - 1, count)
    points = np.stack([np.interp(along, np.arange(len(corners)), corners[:, axis]) for axis in range(2)], axis=1)
    twin = Twin.of(sample("pulley-play", rng), PRINTER)
    return Trace(points, twin.follow(points) + rng.normal(0, 0.05, points.shape), homed=True)


ORDERS: dict[str, Change] = {
    "rows-reversed": lambda mm: mm[::-1],
    "rows-shifted": lambda mm: np.vstack([mm[:1], mm[:-1]]),
    "rows-shifted by three": lambda mm: np.vstack([mm[:3], mm[:-3]]),
    "rows-shifted from the middle on": lambda mm: np.vstack([mm[:200], mm[199:-1]]),
}


@pytest.mark.parametrize("spoiled", ORDERS)
def test_rows_in_another_order_are_named_and_put_right(spoiled: str, rng: np.random.Generator) -> None:
    trace = measured_once(rng)
    again = in_order(Trace(trace.commanded_mm, ORDERS[spoiled](trace.measured_mm), homed=True), PRINTER)
    assert [found.kind for found in again.found] == [spoiled.split()[0]]
    known = again.trace.measured_rows
    assert known.mean() > 0.98
    assert np.mean(again.trace.measured_mm[known] == trace.measured_mm[known]) > 0.99


def test_shuffled_marks_are_put_back_and_shuffled_lines_refused(rng: np.random.Generator) -> None:
    trace = measured_once(rng, count=4000)
    apart = np.zeros(len(trace), bool)
    apart[::40] = True
    marks = np.where(apart[:, None], trace.measured_mm, np.nan)
    shuffled = marks.copy()
    shuffled[apart] = rng.permutation(marks[apart])
    again = in_order(Trace(trace.commanded_mm, shuffled), PRINTER)
    assert [found.kind for found in again.found] == ["rows-shuffled"]
    known = again.trace.measured_rows
    assert known.sum() >= 0.9 * apart.sum()
    assert np.array_equal(again.trace.measured_mm[known], marks[known])
    with pytest.raises(TraceError, match="the same points in another order"):
        in_order(Trace(trace.commanded_mm, rng.permutation(trace.measured_mm)), PRINTER)


@pytest.mark.parametrize(("order", "said"), [("reversed", "in the reversed order"), ("any", "in another order")])
def test_a_table_in_another_order_reaches_who_can_say_so(order: str, said: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    plan = design_probe(PRINTER)
    marks = Twin.of(sample("pulley-play", rng, "realistic"), PRINTER).follow(plan.waypoints_mm) + rng.normal(
        0, 0.02, (len(plan.waypoints_mm), 2)
    )
    spoiled = marks[::-1] if order == "reversed" else rng.permutation(marks)
    write_trace(tmp_path / "t.csv", Trace(plan.waypoints_mm, spoiled))
    result = CliRunner().invoke(
        group, ["learn", str(tmp_path / "t.csv"), "--printer", "ender5", "-o", str(tmp_path / "m.json")]
    )
    assert (result.exception is None) == (order == "reversed")
    assert said in f"{result.output}{result.exception}"


def test_shuffled_dots_are_not_taken_for_another_unit(tmp_path: Path) -> None:
    """Some hundred dots in any order have a slope of a few hundredths by chance: an inch's, or a centimetre's."""
    rng, file = np.random.default_rng(4), tmp_path / "t.csv"
    places = rng.uniform(10, 210, (300, 2))
    slopes = []
    for _ in range(12):
        other = rng.permutation(places)
        slopes.append(abs(float(np.vdot(places - 110, other - 110) / np.square(places - 110).sum())))
        write_trace(file, Trace(places, other))
        assert np.array_equal(read_trace(file, PRINTER).measured_mm, np.round(other, 6))
    assert sum(0.63 < slope * factor < 1.58 for slope in slopes for factor in (10, 25.4)) >= 3
    for factor, unit in ((25.4, "inches"), (10.0, "centimetres")):
        write_trace(file, Trace(places, places / factor))
        with pytest.raises(TraceError, match=unit):
            read_trace(file, PRINTER)


def test_rows_in_order_stay_as_they_are(rng: np.random.Generator) -> None:
    trace = measured_once(rng)
    assert in_order(trace, PRINTER).trace is trace


def test_blank_rows_are_counted_and_change_nothing(rng: np.random.Generator) -> None:
    trace = measured_once(rng)
    plain, blank = (learn_model(replace(trace, blank_rows=rows), PRINTER).document for rows in (0, 12))
    found = [each for each in blank["misfit"]["found"] if each["kind"] == "rows-blank"]
    assert [(each["severity"], "passed over (12)" in each["words"]) for each in found] == [("note", True)]
    assert not any(each["kind"] == "rows-blank" for each in plain["misfit"]["found"])
    assert plain["motors"] == blank["motors"]
    again = update(learn_model(trace, PRINTER), replace(measured_once(rng), blank_rows=1), rng=rng).model
    assert "rows-blank" in {each["kind"] for each in again.document["misfit"]["found"]}


def test_a_table_that_is_reversed_as_a_whole_is_turned_round(rng: np.random.Generator) -> None:
    once = measured_once(rng)
    layer = np.repeat([-1, 0], [1, len(once) - 1])
    for more in ({"layer": layer[::-1]}, {}):  # home at the end shows it, too
        again = in_order(Trace(once.commanded_mm[::-1], once.measured_mm[::-1], **more), PRINTER)
        assert [found.kind for found in again.found] == ["rows-reversed"]
        assert again.trace.homed
        assert np.array_equal(again.trace.measured_mm, once.measured_mm)
        assert np.array_equal(again.trace.commanded_mm, once.commanded_mm)
    falling = replace(once, layer=layer[::-1])  # from the top down, but in the order of the print
    assert in_order(falling, PRINTER).trace is falling


def test_rows_in_no_order_are_refused_where_play_shows_without_its_direction(rng: np.random.Generator) -> None:
    corners = np.vstack([[PRINTER.home_mm], rng.uniform(10, 210, (30, 2))])
    along = np.linspace(0, 30, 500)
    points = np.stack([np.interp(along, np.arange(31), corners[:, axis]) for axis in range(2)], axis=1)
    twin = Twin.of(Corruption((Drive(belt=Play(0.3)), Drive())), PRINTER)
    measured = twin.follow(points) + rng.normal(0, 0.02, points.shape)
    for order, kinds in ((np.arange(500), []), (rng.permutation(500), ["rows-random"])):
        trace = Trace(points[order], measured[order])
        found = found_in(Greybox().fit(trace, PRINTER, rng=rng), trace, ())
        assert [each.kind for each in found if each.severity == "refusal"] == kinds
    targets = rng.uniform(10, 210, (300, 2))  # that a printer went to in this order, and drifted
    trace = Trace(targets, targets + np.linspace(0, 2, 300)[:, None] + rng.normal(0, 0.02, targets.shape))
    found = found_in(Greybox().fit(trace, PRINTER, rng=rng), trace, ())
    assert "rows-random" not in {each.kind for each in found}


def test_rows_back_and_forth_across_the_bed_are_in_an_order(rng: np.random.Generator) -> None:
    """They are farther apart than in a random order, and what they leave is said to be what it is."""
    points = np.stack([np.tile([10.0, 210.0], 100), np.linspace(10, 210, 200)], axis=1)
    measured = points + rng.choice([-0.1, 0.1], points.shape)
    trace = Trace(points, measured)
    found = found_in(Greybox().fit(trace, PRINTER, rng=rng), trace, ())
    assert "rows-random" not in [each.kind for each in found]


def test_another_turn_of_the_pulley_is_no_shift_of_rows(rng: np.random.Generator) -> None:
    """There and back along X with a pulley of 22 teeth, 2.3 mm off its centre, where the preset has 20."""
    large = replace(PRINTER, x=replace(PRINTER.x, mm_per_turn=44.0))
    along = np.concatenate([np.arange(24.0, 215.0), np.arange(214.0, 24.0, -1.0)])
    points = np.stack([along, np.full(len(along), 110.0)], axis=1)
    twin = Twin.of(Corruption((Drive(pulley=EccentricBore(2.3, 1.0), belt=Play(0.1)), Drive())), large)
    wandering = np.cumsum(rng.normal(0, 0.03, points.shape), axis=0) * [1, 0]
    trace = Trace(points, twin.follow(points) + wandering)
    assert in_order(trace, PRINTER).trace is trace
    assert misfit_rows.learned_roughly(trace, PRINTER).left_mm < 0.3  # else any shift looks better


AXES: dict[str, Change] = {
    "x and y swapped": lambda mm: mm[:, ::-1],
    "x mirrored": lambda mm: mm * [-1, 1] + [220, 0],
    "y mirrored": lambda mm: mm * [1, -1],
    "half a turn": lambda mm: 220 - mm,
    "a quarter, left": lambda mm: np.stack([220 - mm[:, 1], mm[:, 0]], axis=1),
    "a quarter, right": lambda mm: np.stack([mm[:, 1], 220 - mm[:, 0]], axis=1),
}


@pytest.mark.parametrize("wrong", AXES)
def test_wrong_axes_are_named(wrong: str, rng: np.random.Generator) -> None:
    trace = measured_once(rng)
    with pytest.raises(TraceError, match=wrong):
        in_order(Trace(trace.commanded_mm, AXES[wrong](trace.measured_mm)), PRINTER)


def moved_mm(at: np.ndarray) -> np.ndarray:
    return np.minimum(10.0, np.hypot(*np.diff(at, axis=0, prepend=at[:1]).T))


Off = Callable[[np.ndarray, np.ndarray], np.ndarray]  # commands [N, 2], share of the print that is done [N] → mm [N, 2]
CHANGES: dict[str, Off] = {
    "linear": lambda at, done: np.outer(done, [0.21, 0.0]),
    "step": lambda at, done: np.outer(done > 0.6, [0.0, 0.12]),
    "direction": lambda at, done: np.stack([0.06 * last_way(at[:, 1]), 0 * done], axis=1),
    "speed": lambda at, done: np.stack([0.2 * last_way(at[:, 0]) * moved_mm(at) / 10.0, 0 * done], axis=1),
    "halves": lambda at, done: np.outer(at[:, 0] > 110, [0.0, 0.14]),
    "creep": lambda at, done: np.outer(1 - np.exp(-done / 0.1), [0.0, 0.25]),
    "wear": lambda at, done: np.stack([-0.15 * last_way(at[:, 0]) * done, 0 * done], axis=1),
    "sticking": lambda at, done: 0.12 * np.stack([last_way(at[:, 0]) * done, last_way(at[:, 1]) * (1 - done)], axis=1),
    "racking-across": lambda at, done: np.stack([0.1 * last_way(at[:, 1]) * (at[:, 0] - 110) / 100, 0 * done], axis=1),
    "racking": lambda at, done: np.stack([0.1 * last_way(at[:, 0]) * (at[:, 1] - 110) / 100, 0 * done], axis=1),
}


def drifting(kind: str, rng: np.random.Generator) -> tuple[GreyboxModel, Trace]:
    trace = measured_once(rng, count=700)
    done = np.linspace(0, 1, len(trace))
    off = CHANGES[kind](trace.commanded_mm, done) if kind else 0.0
    trace = Trace(trace.commanded_mm, trace.measured_mm + off, homed=True)
    return Greybox().fit(trace, PRINTER, rng=rng), trace


@pytest.mark.parametrize("kind", CHANGES)
def test_what_no_part_follows_is_named(kind: str, rng: np.random.Generator) -> None:
    box, trace = drifting(kind, rng)
    causes = causes_of(box, trace)
    found = found_in(box, trace, causes)
    assert found[0].kind == kind
    assert 0.03 < found[0].size_mm < 0.1
    later = of_one_time(box, trace, causes)
    assert (later is not None) == (kind in ("linear", "step", "creep", "wear"))
    if later is not None and kind in ("linear", "step"):  # the last points go where the beginning would have put them
        moved = (later.measured_mm - trace.measured_mm)[[1, -1]]
        wanted = np.array([[0.02, 0.0], [-0.19, 0.0]]) if kind == "linear" else np.array([[0.0, 0.0], [0.0, -0.12]])
        assert moved == pytest.approx(wanted, abs=0.03)


def test_a_table_without_the_rows_of_one_end_says_nothing_of_speed() -> None:
    """Where rows were deleted the next one comes after a long move, and from another side than the table says."""
    rng, probe = np.random.default_rng(1), design_probe(PRINTER)
    trace = probe.trace(probe.marks_mm)
    places = Twin.of(Corruption((Drive(belt=Play(1.0)), Drive(belt=Play(1.0)))), PRINTER).follow(trace.commanded_mm)
    measured = places + rng.normal(0, 0.03, places.shape)
    measured[~trace.measured_rows] = np.nan
    kept = trace.commanded_mm[:, 1] >= 110
    trace = Trace(trace.commanded_mm[kept], measured[kept])
    box = Greybox().fit(trace, PRINTER, rng=rng)
    assert {each.kind for each in found_in(box, trace, causes_of(box, trace))} == {"left-out", "unseen"}
    residual = np.append(rng.normal(0, 0.03, 300), np.ones(80))
    for wild, looked_at in ((3, 300), (15, 315), (80, 300)):  # single rows, a pattern of few rows, too many
        assert len(_near(residual[: 300 + wild])) == looked_at


def test_a_healthy_printer_that_warms_up_a_little_is_left_alone() -> None:
    """0.04 mm at the far end after all of the print, too little to be told: the mean of it is no wrong pulley."""
    corexy, rng = read_printer("corexy"), np.random.default_rng(0)
    points = np.vstack([[corexy.home_mm], rng.uniform(20, 280, (600, 2))])
    grown = 0.00015 * (1 - np.exp(-2 * np.linspace(0, 1, 601)))[:, None] * (points - 20)
    trace = Trace(points, points + grown + rng.normal(0, 0.03, points.shape), homed=True)
    box = Greybox().fit(trace, corexy, rng=rng)
    assert box.drives[1].structure.scale
    assert 0.008 < unrest_mm(box, trace) < 0.018
    model = learn_model(trace, corexy)
    for table in model.mechanism.transmissions:
        assert table.is_taut
        np.testing.assert_allclose(table.lower_mm, table.motor_mm, atol=1e-9)
    left_out = model.document["promise"]["left_out"]
    assert [each["part"] for each in left_out] == ["A line", "B line"]
    assert model.document["promise"]["motors"]["b"]["unexplained_mm2"] > 0.45 * left_out[1]["value"] ** 2
    for left, words in zip(left_out, report(model).splitlines()[-2:], strict=True):
        assert f"{left['part'][0]} has an error of scale and place of {left['value']:.3f} mm" in words


@pytest.mark.parametrize(("most_mm", "share"), [(0.05, 0.12), (0.06, 0.2), (0.07, 0.2)])
def test_a_place_to_which_a_printer_drifts_early_is_not_its_own(most_mm: float, share: float) -> None:
    """What warms up in the first part of the print has its mean near its end: the next print begins without it."""
    corexy, rng = read_printer("corexy"), np.random.default_rng(0)
    points = np.vstack([[corexy.home_mm], rng.uniform(20, 280, (600, 2))])
    drifted = np.outer(most_mm * (1 - np.exp(-np.linspace(0, 1, 601) / share)), [1.0, 0.0])
    trace = Trace(points, points + drifted + rng.normal(0, 0.03, points.shape), homed=True)
    for table in learn_model(trace, corexy).mechanism.transmissions:
        np.testing.assert_allclose(table.lower_mm, table.motor_mm, atol=1e-9)


def test_a_walk_is_as_likely_as_its_covariance_says(rng: np.random.Generator) -> None:
    count, sigma_mm, step_mm = 80, 0.05, 0.02
    columns = np.stack([np.ones(count), np.linspace(-1, 1, count)], axis=1)
    residual = np.cumsum(rng.normal(0, step_mm, count)) + rng.normal(0, sigma_mm, count) + columns @ [0.3, 0.1]
    slow = []
    for ratio in (0.0, *RATIOS):
        walked = np.tril(np.ones((count, count)))
        covariance = np.diff(np.diff(np.eye(count) + ratio * walked @ walked.T, axis=0), axis=1)
        whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        seen = whiten @ np.diff(np.column_stack([residual, columns[:, 1]]), axis=0)
        left = seen[:, 0] - seen[:, 1] * (seen[:, 1] @ seen[:, 0]) / (seen[:, 1] @ seen[:, 1])
        slow.append(-0.5 * (np.linalg.slogdet(covariance)[1] + (count - 1) * np.log(left @ left / (count - 1))))
    walk = walk_of(residual, columns)
    assert walk.log_likelihood == pytest.approx(max(slow[1:]), abs=1e-6)
    assert walk.nats == pytest.approx(max(slow[1:]) - slow[0], abs=1e-6)
    assert walk_of(rng.normal(0, sigma_mm, 600), np.ones((600, 1))).nats < 3


@pytest.mark.parametrize("preset", ["ender3", "corexy"])
def test_a_measurement_that_wanders_moves_no_healthy_printer(preset: str, rng: np.random.Generator) -> None:
    """Steps of 4 µm from point to point, summed up: neither a sudden shift nor a wrong place of the printer's."""
    printer = read_printer(preset)
    plan = design_probe(printer)
    marks = plan.waypoints_mm[plan.rows]
    wander = np.cumsum(rng.normal(0, 0.004, marks.shape), axis=0)
    trace = plan.trace(marks + wander + rng.normal(0, 0.03, marks.shape))
    model = learn_model(Trace(trace.commanded_mm, trace.measured_mm, homed=True), printer)
    kinds = {each["kind"] for each in model.document["misfit"]["found"]}
    assert "walk" in kinds
    assert not kinds & set(IN_TIME)
    assert "the measurement of" in report(model)
    assert not model.document["diagnosis"]
    for table in model.mechanism.transmissions:
        np.testing.assert_allclose(table.lower_mm, table.motor_mm, atol=1e-9)


def test_where_a_belt_with_play_lies_is_known_from_home_not_from_what_wanders(rng: np.random.Generator) -> None:
    printer = read_printer("ender3")
    plan = design_probe(printer)
    twin = Twin.of(Corruption((Drive(belt=Play(0.2)), Drive())), printer)
    marks = twin.follow(plan.waypoints_mm)[plan.rows]
    wander = np.cumsum(rng.normal(0, 0.003, marks.shape), axis=0)
    trace = plan.trace(marks + wander + rng.normal(0, 0.03, marks.shape))
    model = learn_model(Trace(trace.commanded_mm, trace.measured_mm, homed=True), printer)
    assert "walk" in {each["kind"] for each in model.document["misfit"]["found"]}
    off = print_from_home(model.mechanism, plan.waypoints_mm)[plan.rows] - marks
    assert np.sqrt(np.mean(np.square(off))) < 0.02


@pytest.mark.parametrize("after", [0.3, 0.52, 0.77])
def test_one_sudden_shift_is_no_instrument_that_wanders(after: float, rng: np.random.Generator) -> None:
    """Twice the size at which it costs a print 0.03 mm, wherever in the print it is."""
    trace = measured_once(rng, count=700)
    way_mm = np.cumsum(np.hypot(*np.diff(trace.commanded_mm, axis=0, prepend=trace.commanded_mm[:1]).T))
    off = np.outer(way_mm > after * way_mm[-1], [0.0, 0.06 / np.sqrt(after * (1 - after))])
    trace = Trace(trace.commanded_mm, trace.measured_mm + off, homed=True)
    box = Greybox().fit(trace, PRINTER, rng=rng)
    (cause,) = causes_of(box, trace)
    assert cause.candidate.kind == "step"
    assert cause.candidate.detail == pytest.approx(after, abs=0.01)


def test_what_a_corexys_rails_do_is_no_noise(rng: np.random.Generator) -> None:
    """X has a wave, the gantry racks as Y moves: neither follows a motor."""
    corexy = read_printer("corexy")
    points = np.vstack([[corexy.home_mm], rng.uniform(20, 280, (500, 2))])
    wave, racked = 0.08 * np.sin(points[:, 0] / 4), -0.12 * last_way(points[:, 1]) * (points[:, 0] - 150) / 130
    trace = Trace(points, points + np.stack([wave, racked], axis=1) + rng.normal(0, 0.04, points.shape), homed=True)
    box = Greybox().fit(trace, corexy, rng=rng)
    causes = causes_of(box, trace)
    assert {cause.candidate.kind for cause in causes} == {"rail-wave", "rail-racking"}
    for cause in causes:
        one = cause.candidate
        is_wave = one.kind == "rail-wave"
        assert (one.detail, one.place) == (pytest.approx(8 * np.pi, rel=0.03) if is_wave else 1.0, 0.0)
    assert [each.words.count("along") for each in found_in(box, trace, causes) if each.kind == "rail-wave"] == [1]
    effects, _ = effects_of(box, trace, causes)
    still = np.ones((len(points), 2))
    places = PrintPlaces(corexy.to_motor(points), points, still, still, np.linspace(0, 100, len(points)))
    waves = [each.law(places.seen_by(each)) for each in effects if each.kind == "rail-wave"]
    assert np.std(corexy.from_motor(np.stack(waves, axis=1))[:, 0]) == pytest.approx(np.std(wave), rel=0.15)


@pytest.mark.parametrize("preset", ["corexy", "ender3"])
def test_wavy_guides_are_mended_and_the_motors_stay_healthy(preset: str, rng: np.random.Generator) -> None:
    """On a CoreXY pulleys and belts can follow them where the test print went, and would wave parts elsewhere."""
    printer, size = read_printer(preset), np.array([0.09, 0.06])
    low, high = np.array([[axis.min_mm, axis.max_mm] for axis in (printer.x, printer.y)]).T
    points = np.vstack([[printer.home_mm], rng.uniform(low + 10, high - 10, (900, 2))])

    def pushed(place: np.ndarray) -> np.ndarray:
        return size * np.sin(place[:, ::-1] * (2 * np.pi / np.array([134.0, 190.0])) + np.array([0.7, 2.0]))

    trace = Trace(points, points + pushed(points) + rng.normal(0, 0.03, points.shape), homed=True)
    learned = learn(trace, printer)
    waves = learned.saved.mechanism.frame.waves
    assert sorted(waves[:, :2].tolist()) == [[0.0, pytest.approx(190, rel=0.1)], [1.0, pytest.approx(134, rel=0.04)]]
    assert learned.box is not None
    assert all(drive.branches.is_healthy or not drive.structure.waves for drive in learned.box.drives)
    assert np.abs(learned.saved.mechanism.frame.apply(points) - points - pushed(points)).std() < 0.012
    assert report(learned.saved).count("The model carries it") == 2
    again = update(learned.saved, replace(trace, measured_mm=trace.measured_mm + 1e-4), rng=rng).model
    assert np.array_equal(again.mechanism.frame.waves, waves)
    scanned = replace(trace, placed=False, instrument=replace(FLATBED, wave_mm=0.01))
    assert not len(learn(scanned, printer).saved.mechanism.frame.waves)  # the scanner's carriage may be as uneven


@pytest.mark.parametrize("length_mm", [70.0, 140.0, 250.0])
@pytest.mark.parametrize("preset", ["ender3", "corexy"])
def test_a_wavy_guide_is_no_short_turn_of_the_motors(preset: str, length_mm: float, rng: np.random.Generator) -> None:
    """On a probe's lattice of dots a motor's place tells the column, and so where along the guide the head is."""
    printer = read_printer(preset)
    plan = design_probe(printer)
    way = plan.waypoints_mm
    off = np.zeros(way.shape)
    off[:, 1] = 0.1 * np.sin(way[:, 0] * (TURN_RAD / length_mm) + 0.4)
    measured = np.full(way.shape, np.nan)
    measured[plan.rows] = (way + off)[plan.rows] + rng.normal(0, 0.02, (len(plan.rows), 2))
    for rows in motor_rows(Trace(way, measured, homed=True), printer):
        assert roughly_turned(rows, rows)[0] == rows.period_mm


def of_two_halves(preset: str, axis: int, step_mm: np.ndarray, rng: np.random.Generator) -> Learned:
    printer = read_printer(preset)
    plan = design_probe(printer)
    way = plan.waypoints_mm
    middle = (way[:, axis].min() + way[:, axis].max()) / 2
    measured = np.full(way.shape, np.nan)
    measured[plan.rows] = (way + np.outer(way[:, axis] > middle + 7, step_mm) + rng.normal(0, 0.05, way.shape))[
        plan.rows
    ]
    return learn(Trace(way, measured, homed=True), printer)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("preset", ["ender3", "ender5", "corexy"])
def test_a_step_between_two_halves_bends_no_frame_and_no_belt(preset: str, axis: int, rng: np.random.Generator) -> None:
    """A CoreXY's motors would follow it by harmonics of short turns, others by a bent frame and an uneven belt."""
    learned = of_two_halves(preset, axis, np.array([-0.09, 0.1]), rng)
    assert learned.saved.mechanism.frame.is_identity
    for table in learned.saved.mechanism.transmissions:
        np.testing.assert_allclose(table.lower_mm, table.motor_mm, atol=1e-9)
    assert report(learned.saved).count("the model is without it") == 1
    step = [each for each in parse_effects(learned.saved.document) if each.kind == "halves"]
    assert {each.state for each in step} == {STAYS}
    off_mm = np.zeros(2)
    off_mm[[each.motor for each in step]] = [each.weights[0] for each in step]
    assert off_mm == pytest.approx([0.01, -0.19] if preset == "corexy" else [-0.09, 0.1], abs=0.02)
    told = re.findall(r"(?:warning: |and )([XY])(?: is off)? by ([-+][\d.]+) mm", report(learned.saved))
    assert [name for name, _ in told] == ["X", "Y"]  # also of a CoreXY, whose motors are no axes of the bed
    assert [float(by) for _, by in told] == pytest.approx([-0.09, 0.1], abs=0.02)
    assert f"in the upper part of {'XY'[axis]}, from " in report(learned.saved)


def test_a_step_along_a_belts_own_axis_may_be_the_belts(rng: np.random.Generator) -> None:
    learned = of_two_halves("ender3", 1, np.array([0.0, 0.12]), rng)
    x, y = learned.saved.mechanism.transmissions
    np.testing.assert_allclose(x.lower_mm, x.motor_mm, atol=1e-9)
    off_mm = np.interp([60.0, 160.0], y.motor_mm, y.lower_mm) - [60.0, 160.0]
    assert np.diff(off_mm) == pytest.approx(0.12, abs=0.02)
    assert [each.state for each in parse_effects(learned.saved.document) if each.kind == "halves"] == [LEARNED]
    assert re.search(
        r"Y is off by \+0\.1\d mm in the upper part of Y, from \d+ mm on\. The model", report(learned.saved)
    )


def test_both_motors_of_a_rail_say_it_once_and_each_length_is_said() -> None:
    def cause(motor: int, kind: str, size_mm: float, detail: float, weight: float = 0.1) -> Cause:
        return Cause(motor, Candidate(kind, 1, detail, 0.0), np.array([weight, 0.0]), size_mm, 20.0)

    seen = ((0, 0.05, 26.0), (1, 0.06, 26.8), (0, 0.04, 80.0), (1, 0.03, 79.0))
    waves = [cause(motor, "rail-wave", size, length) for motor, size, length in seen]
    assert [each.candidate.detail for each in _once((*waves, cause(0, "step", 0.02, 0.5)))] == [26.8, 80.0, 0.5]
    alike, against = (
        [cause(motor, "rail-racking", 0.05, 0.0, sign**motor * 0.1) for motor in range(2)] for sign in (1, -1)
    )
    assert _tilts(tuple(alike), "rail-racking") == {}
    assert _tilts(tuple(against), "rail-racking") == {0: pytest.approx(0.1)}
    words = _tilted(against[0], 0, 0.1).words
    assert words.startswith("where Y comes to lie depends on which way X moved before, the more the nearer to its ends")


@pytest.mark.parametrize("kind", ["second-period", "rail-wave"])
@pytest.mark.parametrize("motors", [("x", "y"), ("a", "b")])
def test_a_wave_is_told_by_its_amplitude_as_the_diagnosis_tells_it(kind: str, motors: tuple[str, str]) -> None:
    angle = np.linspace(0, TURN_RAD, 1000, endpoint=False)
    wave_mm = 0.06 * np.cos(angle) + 0.08 * np.sin(angle)
    cause = Cause(1, Candidate(kind, 1, 30.0, 0.0), np.array([0.06, 0.08]), float(np.std(wave_mm)), 20.0)
    assert f"{np.abs(wave_mm).max():.3f} mm to either side" in _words(cause, motors)


def test_two_motors_are_said_to_differ_by_the_most_over_a_turn() -> None:
    weights, one = np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.02]), Candidate("two-motors")
    angle = np.linspace(0, TURN_RAD, 2000)
    apart_mm = 2 * np.abs(0.05 * np.cos(angle) + 0.02 * np.sin(3 * angle)).max()  # at the ends of the other axis
    assert f"differ by up to {apart_mm:.2f} mm" in _words(Cause(1, one, weights, 0.02, 20.0), ("x", "y"))


def test_one_border_of_two_halves_is_said_once() -> None:
    def cause(motor: int, kind: str, size_mm: float, axis: float, place: float) -> Cause:
        return Cause(motor, Candidate(kind, 1, axis, place), np.array([0.1]), size_mm, 20.0)

    one, beside = cause(1, "halves", 0.06, 0.0, 0.0), cause(1, "halves", 0.02, 0.0, 0.1)
    others = (
        cause(0, "halves", 0.02, 0.0, 0.1), cause(1, "halves", 0.02, 1.0, 0.1), cause(1, "halves-play", 0.02, 0.0, 0.1),
        cause(1, "halves", 0.02, 0.0, -0.4), cause(1, "step", 0.02, 0.0, 0.1),
    )  # fmt: skip
    assert _one_border((beside, one, *others)) == (one, *others)


def test_home_shows_nothing_of_the_way_to_the_first_point(rng: np.random.Generator) -> None:
    points = np.vstack([[PRINTER.home_mm], rng.uniform(104, 116, (400, 2))])
    twin = Twin.of(sample("pulley-play", rng), PRINTER)
    trace = Trace(points, twin.follow(points) + rng.normal(0, 0.05, points.shape), homed=True)
    box = Greybox().fit(trace, PRINTER, rng=rng)
    (unseen,) = (each for each in found_in(box, trace, ()) if each.kind == "unseen")
    assert unseen.words.startswith("only X from 104 to 116 mm of 0 to 220 and Y from 104 to 116 mm of 0 to 220")
    for rows, drive in zip(motor_rows(trace, PRINTER, box.periods_mm), box.drives, strict=True):
        touch = drive.choice.fit.touch
        at, side = touch.at.copy(), touch.side.copy()
        at[0], side[0] = 0, 1  # a belt that rested against its pulley at home
        assert sight(rows, replace(touch, at=at, side=side)).turns < 0.35  # 12 mm of a turn of 40 mm


def test_play_that_wears_on_one_side_is_no_heap_of_wild_points(rng: np.random.Generator) -> None:
    points = measured_once(rng, count=700).commanded_mm
    at, places = points[0, 0], points.copy()
    for row, x in enumerate(points[:, 0].tolist()):
        at = min(max(at, x - 0.1 - 0.4 * row / len(points)), x)
        places[row, 0] = at
    trace = Trace(points, places + rng.normal(0, 0.01, points.shape), homed=True)
    found = causes_of(Greybox().fit(trace, PRINTER, rng=rng), trace)
    assert {cause.candidate.kind for cause in found} == {"wear", "linear"}


@pytest.mark.parametrize(("order", "grows"), [("as printed", True), ("from left to right", False), ("few", False)])
def test_growth_is_said_only_where_all_places_come_again(order: str, grows: bool, rng: np.random.Generator) -> None:
    points = np.vstack([[PRINTER.home_mm], rng.uniform(10, 210, (100 if order == "few" else 500, 2))])
    if order == "from left to right":
        points[1:] = points[1:][np.argsort(points[1:, 0])]
    done = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    warm = 1 - np.exp(-4 * done / done[-1])
    off = np.stack([0.6 * warm * (points[:, 0] - 220) / 100, 0 * warm], axis=1)
    trace = Trace(points, points + off + rng.normal(0, 0.03, points.shape), homed=True)
    causes = causes_of(Greybox().fit(trace, PRINTER, rng=rng), trace)
    assert ("thermal" in {cause.candidate.kind for cause in causes}) == grows
    assert not grows or {cause.candidate.kind for cause in causes} == {"thermal"}


def test_a_short_print_is_promised_to_be_as_warm_as_it_gets(rng: np.random.Generator) -> None:
    """The measured print went 10 m and grew by 0.2 mm from the end stop on; the model is of its first tenth."""
    effect = Effect(
        "thermal", 0, np.array([0.1, 0.1]), 0.25, 0.0, EARLY, np.zeros(3), np.array([[0.0, 220.0]] * 4), 40.0, 1e4
    )
    ends, still = np.array([[220.0, 110.0], [0.0, 110.0]]), np.ones((2, 2))
    off_mm = []
    for gone_mm in (1e3, 1e4):
        drawn = effect.drawn(PrintPlaces(ends, ends, still, still, np.full(2, gone_mm)), np.ones(400), rng)
        off_mm.append(np.median(np.abs(drawn.columns @ drawn.drawn), axis=1))
    assert off_mm[0][0] < 0.03
    assert off_mm[1][0] == pytest.approx(0.2 * (1 - 0.351), abs=0.01)
    assert max(off_mm[0][1], off_mm[1][1]) < 1e-9  # at the end stop
    worn = replace(effect, kind="wear", weights=np.array([0.1]), state=ENDED)  # it stops, or goes on as fast
    drawn = worn.drawn(PrintPlaces(ends, ends, still, still, np.array([0.0, 1e4])), np.ones(4000), rng)
    begins_mm, ends_mm = drawn.columns @ drawn.drawn
    assert np.abs(begins_mm).mean() < 0.02
    assert np.quantile(begins_mm - ends_mm, (0.25, 0.75)) == pytest.approx([0.0, 0.1], abs=0.01)


@pytest.mark.parametrize("kind", ["linear", "step", "creep"])
def test_a_shift_stays_or_begins_anew_with_the_next_homing(kind: str, rng: np.random.Generator) -> None:
    shift = Effect(
        kind, 0, np.array([0.1]), 0.25, 0.0, BEGUN, np.zeros(3), np.array([[0.0, 220.0]] * 4), 40.0, way_mm=1e4
    )
    ends, still = np.array([[220.0, 110.0], [0.0, 110.0]]), np.ones((2, 2))
    drawn = shift.drawn(PrintPlaces(ends, ends, still, still, np.array([0.0, 1e4])), np.ones(4000), rng)
    whole_mm = float(shift.law(PrintPlaces(ends, ends, still, still, np.zeros(2)).seen_by(shift))[0])
    rows = PrintPlaces(ends, ends, still, still, np.zeros(2)).seen_by(shift)
    begins_mm, ends_mm = drawn.columns @ drawn.drawn + float(shift.law(rows.all_at(EARLY_DONE))[0])
    stays = ~np.isclose(begins_mm, 0.0)
    assert np.median(begins_mm[stays]) == pytest.approx(whole_mm * np.exp(0.1), rel=0.05)
    assert stays.mean() == pytest.approx(SHIFT_STAYS, abs=0.03)
    assert np.median(ends_mm[~stays]) == pytest.approx(0.0 if kind == "step" else whole_mm, rel=0.05)
    assert ((ends_mm > begins_mm + 1e-9) | (kind != "linear"))[stays].mean() > 0.4  # half of what drifts evenly stops


@pytest.mark.parametrize("grown", [np.linspace, lambda a, b, n: b * (1 - np.exp(-np.linspace(0, 3, n)))])
def test_a_print_of_a_machine_that_shifted_is_no_farther_off_its_place(
    grown: Callable[..., np.ndarray], tmp_path: Path, rng: np.random.Generator
) -> None:
    """A screw that creeps begins anew when the next print is homed, and so does a machine that warmed up."""
    points = np.vstack([[PRINTER.home_mm], rng.uniform(10, 210, (600, 2))])
    off = np.stack([grown(0, 0.3, len(points)), np.zeros(len(points))], axis=1)
    trace = Trace(points, points + off + rng.normal(0, 0.02, points.shape), homed=True)
    model = learn_model(trace, PRINTER)
    middle = np.linspace(60, 160, 50)
    lower_mm, upper_mm = model.mechanism.transmissions[0].branches_mm(middle)
    early_mm = float(grown(0, 0.3, 1000)[108])
    assert np.abs((lower_mm + upper_mm) / 2 - middle - early_mm).max() < 0.03
    assert "the next one is homed anew" in report(model)
    budget = parse_budget(model)
    assert budget is not None
    assert [each.state for each in budget.effects] == ["begun"]


@pytest.mark.parametrize(("turn_mm", "said"), [(42.0, "a pulley of 21 teeth"), (39.5, "steps a millimetre")])
def test_the_turn_of_another_pulley_is_learned(turn_mm: float, said: str, rng: np.random.Generator) -> None:
    """A pulley of 21 teeth where the preset has 20, or steps that were calibrated: an uneven pulley again, and no belt
    that is uneven everywhere."""
    other = replace(PRINTER, x=replace(PRINTER.x, mm_per_turn=turn_mm), y=replace(PRINTER.y, mm_per_turn=turn_mm))
    points = np.vstack([[PRINTER.home_mm], rng.uniform(10, 210, (500, 2))])
    twin = Twin.of(Corruption((Drive(pulley=EccentricBore(0.4, 1.0), belt=Play(0.3)), Drive())), other)
    trace = Trace(points, twin.follow(points) + rng.normal(0, 0.05, points.shape), homed=True)
    box = Greybox().fit(trace, PRINTER, rng=rng)
    assert box.periods_mm == (pytest.approx(turn_mm, abs=0.05), 40.0)
    assert box.drives[0].structure.warp_mm == 0
    assert box.residual_after_mm < 0.08
    found = found_in(box, trace, ())
    assert [each.kind for each in found] == ["turn"]
    assert said in found[0].words


@pytest.mark.parametrize("turn_mm", [40 / 1.01, 40.0])
def test_a_wrong_scale_says_how_long_a_turn_is(turn_mm: float, rng: np.random.Generator) -> None:
    """All lengths are off by 1 %: by the steps a millimetre, with which a turn is shorter, too, or by the pulley."""
    points, others = (np.vstack([[PRINTER.home_mm], rng.uniform(10, 200, (count, 2))]) for count in (600, 1000))

    def printed(at: np.ndarray) -> np.ndarray:
        angle = (at - at[0]) * (TURN_RAD / turn_mm) + np.array([1.0, 3.0])
        return at + 0.01 * (at - at[0]) + 0.1 * (np.sin(angle) - np.sin(angle[0]))

    trace = Trace(points, printed(points) + rng.normal(0, 0.03, points.shape), homed=True)
    box = Greybox().fit(trace, PRINTER, rng=rng)
    assert box.periods_mm == pytest.approx((turn_mm, turn_mm), rel=3e-4)
    assert not any(drive.structure.elastic for drive in box.drives)
    off = (Twin(box.mechanism).follow(others) - printed(others))[1:]
    assert np.sqrt((off**2).sum(axis=1).mean()) < 0.01
    unsure = [turned(row, row, absolute=False)[0] for row in motor_rows(trace, PRINTER)]
    assert unsure == [40.0, 40.0]  # an instrument that knows no scale says nothing of the steps


def test_a_round_pulley_is_said_to_turn_by_nothing(rng: np.random.Generator) -> None:
    points = np.vstack([[PRINTER.home_mm], rng.uniform(10, 200, (600, 2))])
    trace = Trace(points, 1.01 * points + rng.normal(0, 0.03, points.shape), homed=True)
    box = Greybox().fit(trace, PRINTER, rng=rng)
    drives = [replace(each, branches=replace(each.branches, period_mm=39.6)) for each in box.drives]
    assert [each.structure.pulley for each in drives] == ["none", "none"]
    assert not found_in(replace(box, drives=(drives[0], drives[1])), trace, ())


@pytest.mark.parametrize(("name", "count", "seed"), [("ender3", 2000, 101), ("ender3", 601, 105), ("corexy", 601, 105)])
def test_corners_and_wide_play_are_no_other_turn(name: str, count: int, seed: int) -> None:
    """What a cornered pulley does when its belt hangs through by millimetres resembles another length of the turn."""
    rng, printer = np.random.default_rng(seed), read_printer(name)
    points = np.vstack([[0.0, 0.0], rng.uniform(10, 200, (count, 2))])
    twin = Twin.of(sample("pulley-loose", rng), printer)
    trace = Trace(points, twin.follow(points) + rng.normal(0, 0.03, points.shape), homed=True)
    box = Greybox().fit(trace, printer, rng=rng)
    assert box.periods_mm == (40.0, 40.0)
    assert box.residual_after_mm < 0.05


@pytest.mark.parametrize("teeth", [16, 19, 21])
@pytest.mark.parametrize(("size_mm", "play_mm"), [(0.06, 0.0), (0.2, 0.2)])
def test_a_whole_number_of_teeth_is_found_where_contacts_hide_it(
    teeth: int, size_mm: float, play_mm: float, rng: np.random.Generator
) -> None:
    axes = [replace(axis, mm_per_turn=2.0 * teeth) for axis in (PRINTER.x, PRINTER.y)]
    drives = tuple(Drive(pulley=EccentricBore(size_mm, phase), belt=Play(play_mm)) for phase in (1.0, 2.0))
    twin = Twin.of(Corruption((drives[0], drives[1])), replace(PRINTER, x=axes[0], y=axes[1]))
    points = np.vstack([[PRINTER.home_mm], rng.uniform(10, 200, (600, 2))])
    trace = Trace(points, twin.follow(points) + rng.normal(0, 0.03, points.shape), homed=True)
    box = Greybox().fit(trace, PRINTER, rng=rng)
    assert box.periods_mm == pytest.approx((2 * teeth, 2 * teeth), rel=0.002)


@pytest.mark.parametrize(("period_mm", "size_mm"), [(34.6, 0.1), (45.0, 0.1), (50.0, 0.2)])
@pytest.mark.parametrize("beside_mm", [0.0, 0.1])
def test_an_idler_is_no_pulley_however_strong(
    period_mm: float, size_mm: float, beside_mm: float, rng: np.random.Generator
) -> None:
    """With and without a pulley off its centre: what both do is learned, and goes on where nothing was measured."""
    points = np.vstack([[PRINTER.home_mm], rng.uniform(10, 210, (600, 2))])
    others = np.vstack([[PRINTER.home_mm], rng.uniform(10, 210, (1000, 2))])
    twin = Twin.of(Corruption((Drive(pulley=EccentricBore(beside_mm, 1.0)), Drive())), PRINTER)

    def printed(at: np.ndarray) -> np.ndarray:
        off = size_mm * np.sin((at[:, 0] - at[0, 0]) / period_mm * 2 * np.pi)
        return twin.follow(at) + np.stack([off, np.zeros(len(at))], axis=1)

    trace = Trace(points, printed(points) + rng.normal(0, 0.02, points.shape), homed=True)
    box = Greybox().fit(trace, PRINTER, rng=rng)
    missed = Twin(box.mechanism).follow(others)[1:] - printed(others)[1:]
    assert np.sqrt((missed**2).sum(axis=1).mean()) < 0.015
    if beside_mm:
        assert box.periods_mm[0] == 40.0
        assert box.drives[0].structure.second_mm == pytest.approx(period_mm, rel=0.05)


def test_an_idler_is_a_part_that_the_evidence_switches_on(rng: np.random.Generator, tmp_path: Path) -> None:
    """It is learned beside the pulley, goes on where nothing was measured, and comes back from the model's file."""
    trace = measured_once(rng, count=700)
    period_mm, size_mm = 10 * np.pi, 0.09
    off = np.stack([size_mm * np.sin(trace.commanded_mm[:, 0] / 5.0), np.zeros(len(trace))], axis=1)
    saved = learn_model(Trace(trace.commanded_mm, trace.measured_mm + off, homed=True), PRINTER)
    write_model(tmp_path / "p.json", saved)
    again = read_model(tmp_path / "p.json")
    branches, other = branches_of(again, 0), branches_of(again, 1)
    assert branches is not None
    assert other is not None
    assert branches.second_mm == pytest.approx(period_mm, rel=0.01)
    assert branches.second.amplitude_mm(1) == pytest.approx(size_mm, abs=0.01)
    assert other.second.is_zero
    assert not branches.warp_mm.any()
    at = np.linspace(-40.0, 260.0, 301)
    wave = branches.errors_mm(at)[0] - replace(branches, second=Wave()).errors_mm(at)[0]
    assert np.abs(wave - size_mm * np.sin(at / 5.0)).max() < 0.035  # the length is known to a hundredth
    assert f"every {branches.second_mm:.1f} mm" in saved.findings[0]
    budget = parse_budget(again)
    assert budget is not None
    assert budget.motors[0].design.second_mm == branches.second_mm
    assert remember(again, 0).design.second_mm == branches.second_mm
    fault = next(each for each in saved.document["diagnosis"] if each["kind"].startswith("period-"))
    assert "idler" in advise(NamedFault(**fault, words="")).meaning
    assert not saved.document["misfit"]["found"]


def test_a_rail_with_play_is_told_from_the_belts_of_a_corexy(rng: np.random.Generator) -> None:
    printer = read_printer("corexy")
    corners = np.vstack([[printer.home_mm], rng.uniform(20, 280, (40, 2))])
    along = np.linspace(0, 40, 500)
    points = np.stack([np.interp(along, np.arange(41), corners[:, axis]) for axis in range(2)], axis=1)
    lag = np.stack([0.06 * last_way(points[:, 0]), np.zeros(500)], axis=1)
    trace = Trace(points, points - lag + rng.normal(0, 0.03, points.shape), homed=True)
    box = Greybox().fit(trace, printer, rng=rng)
    causes = causes_of(box, trace)
    found = found_in(box, trace, causes)
    assert [each.kind for each in found] == ["rail-play"]
    assert found[0].words.startswith("the head lags along X by 0.1")
    assert found[0].words.count("lags") == 1  # though both motors show it
    effects, _ = effects_of(box, trace, causes)
    assert {effect.kind for effect in effects} == {"rail-play"}
    angle, nothing = np.linspace(0.01, 2 * np.pi, 100, endpoint=False), np.zeros((100, 2))
    wanted, tangent = (np.stack([np.cos(a), np.sin(a)], axis=1) for a in (angle, angle + np.pi / 2))
    path = predict.PathPlaces(100 * wanted + 150, tangent, nothing[:, 0], nothing, np.ones(100))
    aims = predict._aims(healthy_mechanism(printer), path, at_rest=False)
    round_part = PrintPlaces(aims.before_mm, path.wanted_mm, aims.side, aims.ways, np.linspace(0, 600, 100))
    promised = printer.from_motor(np.stack([each.law(round_part.seen_by(each)) for each in effects], axis=1))
    assert np.sqrt(np.mean(promised**2, axis=0)) == pytest.approx([0.06, 0.0], abs=0.01)  # also where Y is the faster
    marks = replace(path, tangent=np.tile([0.0, 1.0], (100, 1)), ways=np.sign(tangent))  # to which the nozzle came so
    assert predict._aims(healthy_mechanism(printer), marks, at_rest=True).ways.tolist() == np.sign(tangent).tolist()


@pytest.mark.parametrize(
    ("shift_mm", "said"),
    [((0.0, 0.25), ["Y was suddenly off by +0.25"]), ((0.12, 0.12), ["A was suddenly off by +0.24"]),
     ((0.3, -0.1), ["X was suddenly off by +0.3", "Y was suddenly off by -0.1"])],
)  # fmt: skip
def test_a_shift_of_a_corexys_axis_is_told_as_the_axis_own(
    shift_mm: tuple[float, float], said: list[str], rng: np.random.Generator
) -> None:
    """Both motors show it; what a motor alone shows stays its own."""
    printer = read_printer("corexy")
    points = np.vstack([[printer.home_mm], rng.uniform(20, 280, (600, 2))])
    measured = points + np.outer(np.arange(601) > 300, shift_mm) + rng.normal(0, 0.02, points.shape)
    trace = Trace(points, measured, homed=True)
    box = Greybox().fit(trace, printer, rng=rng)
    (found,) = (each for each in found_in(box, trace, causes_of(box, trace)) if each.kind == "step")
    told = found.words.split("; ")
    assert len(told) == len(said)
    assert all(words.startswith(start[:-1]) for words, start in zip(told, said, strict=True)), told


@pytest.mark.parametrize(("made_by", "said_of"), [("ender3", "corexy"), ("corexy", "cr10s")])
def test_a_table_of_the_other_kinematics_is_named(made_by: str, said_of: str, rng: np.random.Generator) -> None:
    """A table that names no printer, learned as a CoreXY's though a motor for each axis made it, or the reverse."""
    true, wrong = read_printer(made_by), read_printer(said_of)
    points = np.vstack([[true.home_mm], rng.uniform(10, 210, (400, 2))])
    noise = rng.normal(0, 0.05, points.shape)

    def learned(drive: Drive, printer: Printer) -> Learned:
        twin = Twin.of(Corruption((drive, replace(drive, belt=Play(0.2)))), true)
        return learn(Trace(points, twin.follow(points) + noise, homed=True), printer)

    uneven = Drive(pulley=EccentricBore(0.3, 1.0))
    for drive in (uneven,) if said_of == "corexy" else (uneven, Drive(belt=Play(0.3))):  # its rails may have play
        said = report(learned(drive, wrong).saved)
        assert ("made it, no CoreXY" if said_of == "corexy" else "as if a CoreXY made it") in said
        assert "learn again with that --printer" in said
        assert "made it" not in report(learned(drive, true).saved)
    assert "made it" not in report(learned(Drive(), wrong).saved)


def test_play_of_a_corexys_guides_is_not_taken_for_another_printers_belts(rng: np.random.Generator) -> None:
    """Sound belts and guides with play do what play in the belts of a printer with a motor for each axis does. Much
    more play than guides have is another printer's all the same."""
    corexy, cartesian = read_printer("corexy"), replace(read_printer("corexy"), kinematics="cartesian")
    dabs = np.repeat(rng.uniform(20, 280, (120, 2)), 4, axis=0) + rng.uniform(-0.5, 0.5, (480, 2))
    points = np.vstack([[corexy.home_mm], dabs])
    for play_mm, is_named in ((0.45, False), (1.2, True)):
        twin = Twin.of(Corruption((Drive(belt=Play(play_mm)), Drive())), cartesian)
        measured = twin.follow(points) + rng.normal(0, 0.01, points.shape)
        said = report(learn(Trace(points, measured, homed=True), corexy).saved)
        assert ("made it, no CoreXY" in said) == is_named
        if is_named:  # all else that does not fit follows from that, but for the other cause
            assert said.count("warning: ") == 1 + said.count("the head lags")


def test_a_table_that_begins_at_another_printers_home_is_said_to(rng: np.random.Generator) -> None:
    points = np.vstack([[PRINTER.home_mm], rng.uniform(10, 210, (60, 2))])
    measured = points + rng.normal(0, 0.03, points.shape)
    unknown = np.vstack([[np.nan, np.nan], measured[1:]])
    for seen, printer, said in (
        (unknown, read_printer("ender3"), True), (unknown, PRINTER, False), (measured, read_printer("ender3"), False),
        (unknown, read_printer("cr10s"), True),
    ):  # fmt: skip
        trace = Trace(points, seen, homed=printer is PRINTER)
        assert bool(another_home(trace, printer)) == said
        assert bool(another_home(Trace(points[1:], unknown[1:]), printer)) is False
    assert "begins at (220, 220), where other printers home, not at (0, 0)" in report(
        learn_model(Trace(points, unknown), read_printer("ender3"))
    )


@pytest.mark.parametrize("spoiled", [*CHANGES, "rail-play", "rail-wave"])
@pytest.mark.parametrize("preset", ["ender3", "corexy"])
def test_what_no_part_follows_is_not_taken_for_another_printers(
    spoiled: str, preset: str, rng: np.random.Generator
) -> None:
    printer = read_printer(preset)
    points = np.vstack([[printer.home_mm], rng.uniform(10, 210, (400, 2))])
    off = CHANGES.get(spoiled, lambda at, done: np.stack([0.1 * last_way(at[:, 0]), 0 * done], axis=1))
    if spoiled == "rail-wave":
        off = lambda at, done: np.stack([0 * done, 0.1 * np.sin(at[:, 0] * 2 * np.pi / 40)], axis=1)  # noqa: E731
    twin = Twin.of(Corruption((Drive(belt=Play(0.3)), Drive())), printer)
    measured = twin.follow(points) + off(points, np.linspace(0, 1, len(points))) + rng.normal(0, 0.03, points.shape)
    trace = Trace(points, measured, homed=True)
    box = Greybox().fit(trace, printer, rng=rng)
    assert not another_printers(box, trace, causes_of(box, trace, guides=True))


def test_a_good_trace_has_nothing_to_say(rng: np.random.Generator) -> None:
    box, trace = drifting("", rng)
    assert not causes_of(box, trace)


def test_points_left_out_a_turned_plate_and_unseen_places_are_said(rng: np.random.Generator) -> None:
    trace = measured_once(rng)
    plain = trace.measured_mm
    measured = (plain - 110) @ np.array([[1, 0.0175], [-0.0175, 1]]) + 110
    measured[::10] += rng.uniform(3, 9, (40, 2))
    measured[trace.commanded_mm[:, 0] > 120] = np.nan
    trace = Trace(trace.commanded_mm, measured, homed=True)
    box = Greybox().fit(trace, PRINTER, rng=rng)
    straight, moved = as_printed(box, trace)
    assert not straight.placed
    kept = straight.measured_rows & (np.arange(len(trace)) % 10 > 0)
    off = straight.measured_mm[kept] - plain[kept]
    assert np.abs(off - off.mean(axis=0)).max() < 0.3  # a degree is 1.9 mm here
    found = {each.kind: each for each in (*moved, *found_in(box, trace, ()))}
    assert {"left-out", "turned", "unseen"} <= set(found)
    assert "unfit" not in found  # a few points that are far off do not make the others unfit
    assert "+1.0" in found["turned"].words
    assert found["left-out"].severity == "warning"
    assert set(misfit_section(tuple(found.values()))) == {"found", "effects"}


def test_a_bent_and_skewed_frame_is_not_taken_for_a_turned_plate(rng: np.random.Generator) -> None:
    printer = read_printer("voron2-250")
    once = measured_once(rng, count=600)
    places = once.commanded_mm * 250 / 220
    u, v = (places - 120).T / 100
    bent = np.stack([-0.72 * v + 0.12 * v**2, 0.14 * u**2], axis=1)
    trace = Trace(places, places + bent - bent[0] + rng.normal(0, 0.02, places.shape), homed=True)
    assert as_printed(Greybox().fit(trace, printer, rng=rng), trace)[0].placed
    # nor one of a CoreXY with a wrong pulley, whose axes lean in one sense; unless it lies elsewhere, too
    corexy = read_printer("corexy")
    places = np.vstack([[corexy.home_mm], rng.uniform(20, 280, (400, 2))])
    for skew_deg, shift_mm in ((-1.0, 0.0), (-1.2, 0.0), (-1.0, 0.8)):  # at -1.2° both lean alike, by 0.6°
        machine = Corruption((Drive(pulley=WrongRadius(6.5)), Drive()), frame=CrookedFrame(skew_deg=skew_deg))
        measured = Twin.of(machine, corexy).follow(places) + rng.normal(0, 0.02, places.shape)
        trace = Trace(places, measured + shift_mm, homed=True)
        found = as_printed(Greybox().fit(trace, corexy, rng=rng), trace)[1]
        assert {each.kind for each in found} == ({"turned", "moved"} if shift_mm else set())


def test_a_shifted_plate_is_learned_as_one_whose_place_is_not_known(rng: np.random.Generator) -> None:
    once = measured_once(rng, count=300)
    shifted = replace(once, measured_mm=once.measured_mm + np.array([0.9, -0.6]))
    model = learn_model(shifted, PRINTER, model="greybox")
    other = learn_model(replace(shifted, placed=False, instrument=Instrument()), PRINTER, model="greybox")
    assert "moved" in {each["kind"] for each in model.document["misfit"]["found"]}
    assert not model.document["promise"]["placed"]
    for mine, theirs in zip(model.mechanism.transmissions, other.mechanism.transmissions, strict=True):
        assert mine.lower_mm == pytest.approx(theirs.lower_mm, abs=1e-9)
        assert mine.upper_mm == pytest.approx(theirs.upper_mm, abs=1e-9)


def test_a_probe_does_not_overwrite_another_plan(tmp_path: Path) -> None:
    output = tmp_path / "probe.gcode"
    asked = ["probe", "--printer", "ender3", "--marks", "40", "-o", str(output)]
    for more, code in (([], 0), ([], 0), (["--size", "100"], 2), (["--size", "100", "--overwrite"], 0)):
        before = output.read_text() if output.exists() else ""
        ran = CliRunner().invoke(group, [*asked, *more])
        assert isinstance(ran.exception, InputError) == (code == 2), ran.output
        assert (output.read_text() == before) == (code == 2 or (not more and bool(before)))
    with pytest.raises(InputError, match="another test print"):
        keep_plan(output.with_suffix(".json"), design_probe(PRINTER, marks=40))
