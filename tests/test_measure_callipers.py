"""Callipers: few distances, honest about what they can tell."""

from copy import deepcopy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner

from printmend.cli.calliper_talk import _doubt, talk
from printmend.cli.measure import command
from printmend.effects.effect import SCALE_MM
from printmend.errors import ModelError, RefusedError, TraceError
from printmend.export.supported import export_supported
from printmend.infer.distances import choose_distances, machines_by_hand, printer_of
from printmend.infer.gram import Block
from printmend.infer.posterior import SWEEPS, Few, drawn_sizes
from printmend.learn import by_hand
from printmend.learn.by_hand import Estimate, model_by_hand
from printmend.machine import Frame, Mechanism, Transmission, healthy_transmission
from printmend.measure import write_plan
from printmend.measure.callipers import (
    LONGEST_MM,
    MOST_DISTANCES,
    READING_SD_MM,
    describe,
    number_in,
    parse_readings,
)
from printmend.mend.prediction import advice_of
from printmend.mend.update import update
from printmend.mend.verify import verify
from printmend.model import exact_model, read_model
from printmend.printer import read_printer
from printmend.probe import design_probe
from printmend.promise.belief import parse_belief
from printmend.promise.predict import Errors, PathPlaces, Promise, promised
from printmend.twin import Twin


def broken(printer, *, scale=0.0, play=0.0, sine=0.0, skew=0.0) -> Mechanism:
    sides = []
    for motor in range(2):
        grid = healthy_transmission(printer, motor).motor_mm
        middle = grid * (1 + scale) + sine * np.sin(2 * np.pi * grid / printer.axes[motor].mm_per_turn)
        sides.append(Transmission(grid[0], grid[1] - grid[0], middle - play / 2, middle + play / 2))
    coefficients = np.zeros((2, 10))
    coefficients[0, Frame.exponents.index((0, 1))] = skew * Frame().scale_mm
    return Mechanism(printer, tuple(sides), Frame(coefficients))


def read_off(distances, machine, rng=None, width=0.05) -> np.ndarray:
    marks = Twin(machine).follow(distances.plan.waypoints_mm)[distances.plan.rows]
    across = np.hypot(*(marks[distances.pairs[:, 1]] - marks[distances.pairs[:, 0]]).T)
    noise = 0.0 if rng is None else rng.normal(0, READING_SD_MM, len(across))
    return across + distances.plan.big_dot_mm + width + noise


def estimates_by_hand(distances, readings) -> list[Estimate]:
    return by_hand._estimates(by_hand._machines(distances, readings, printer_of(distances.plan)))


@cache
def case_of(preset):
    printer = read_printer(preset)
    return printer, choose_distances(design_probe(printer))


@pytest.fixture(params=["ender3", "corexy"])
def case(request):
    return case_of(request.param)


@pytest.fixture(scope="module", autouse=True)
def drawn_once():
    """The same readings give the same machines: they are drawn once for all tests that ask, in few sweeps where no test
    is of the draws."""
    drawn, machines_of = {}, by_hand._machines

    def machines(distances, readings_mm, printer):
        key = printer.name, distances.pairs.tobytes(), readings_mm.tobytes()
        if key not in drawn:
            drawn[key] = machines_of(distances, readings_mm, printer)
        found = drawn[key]  # a plan's printer has no Z axis, and no distance tells of it
        return replace(found, scene=replace(found.scene, printer=printer))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(by_hand, "_machines", machines)
        patch.setattr("printmend.infer.distances.PASSES", (0, SWEEPS // 4))
        yield


@pytest.fixture
def sound():
    """The model of a printer without a fault."""
    printer, distances = case_of("ender3")
    return model_by_hand(distances, read_off(distances, broken(printer)), printer)


def test_the_list_is_short_and_fits_the_callipers(case):
    _, distances = case
    assert len(distances.pairs) <= 12
    assert distances.across_mm.max() < LONGEST_MM + 2
    assert distances.plan.big[distances.pairs].all()
    assert len(describe(distances)) == len(distances.pairs)


def test_a_fault_is_found_and_told(case):
    printer, distances = case
    values = {
        item.name: item for item in estimates_by_hand(distances, read_off(distances, broken(printer, scale=0.02)))
    }
    for motor in printer.motors:
        scale = values[f"{motor.upper()} scale error (+: prints too large)"]
        assert abs(scale.value - 2.0) < 3 * scale.sd
        assert scale.supported
        assert scale.corrected
        assert not values[f"{motor.upper()} belt's play"].corrected
    assert abs(values["dot width"].value) < 2 * values["dot width"].sd


def test_a_lean_is_told_from_two_opposite_scales():
    printer, distances = case_of("corexy")
    (skew,) = (item for item in estimates_by_hand(distances, read_off(distances, broken(printer, skew=0.01)))
               if item.name == "skew")  # fmt: skip
    assert skew.corrected
    assert np.radians(skew.value) == pytest.approx(0.01, abs=2 * np.radians(skew.sd))
    assert np.radians(skew.sd) < 0.005


@pytest.mark.parametrize(("play", "absent"), [(0.0, True), (0.8, False)])
def test_distances_that_find_none_say_so(play, absent):
    printer, distances = case_of("ender3")
    readings = read_off(distances, broken(printer, play=play))
    said = estimates_by_hand(distances, readings)
    for item in said:
        if item.words == f"{item.name}: none found":
            assert not item.corrected
        elif item.unit == "mm" and not item.corrected and item.name != "dot width":
            assert item.sd >= READING_SD_MM / np.sqrt(len(readings))
        assert "0.000 ± 0.000" not in item.words
    assert all(item.words.endswith("none found") for item in said if "scale" in item.name)
    assert all(item.absent == absent and item.corrected != absent for item in said if "play" in item.name)


def test_a_single_slip_is_not_believed():
    printer, distances = case_of("ender3")
    readings = read_off(distances, broken(printer))
    readings[1] += 0.16
    assert model_by_hand(distances, readings, printer).is_healthy


def test_a_misread_distance_is_named():
    printer, distances = case_of("ender3")
    readings = read_off(distances, broken(printer), np.random.default_rng(0))
    assert not any("misread" in line for line in model_by_hand(distances, readings, printer).findings)
    readings[4] += 1.0
    (said,) = (line for line in model_by_hand(distances, readings, printer).findings if "misread" in line)
    assert said.startswith("distance 5 may be misread by +")


def test_few_distances_say_what_they_cannot_tell():
    printer, distances = case_of("ender3")
    readings = read_off(distances, broken(printer))
    readings[1:] = np.nan
    found = estimates_by_hand(distances, readings)
    assert not all(item.supported for item in found)
    assert any(item.words.endswith("(these distances cannot tell)") for item in found)


def test_sets_are_drawn_as_brute_force_draws_them():
    rng = np.random.default_rng(4)
    columns, error_mm, sigma_mm = rng.standard_normal((3, 5)), np.array([0.5, -0.2, 0.9]), 0.2
    odds, sds = (0.4, 0.3, 0.2), (np.ones(2), 0.5 * np.ones(1), np.ones(2))
    first = np.cumsum([0, *map(len, sds)])
    blocks = [
        Block(name, 0, (), slice(first[at], first[at + 1]), sds[at][None], np.log(odds[at] / (1 - odds[at]))[None])
        for at, name in enumerate("abc")
    ]
    there = rng.uniform(size=(3, 200_000)) < np.array(odds)[:, None]
    drawn = np.concatenate(sds)[:, None] * rng.standard_normal((5, there.shape[1])) * there[[0, 0, 1, 2, 2]]
    away2 = ((error_mm[:, None] - columns @ drawn) / sigma_mm) ** 2
    weight = np.prod((1 + away2 / 5) ** -3.0, axis=0)  # Student's t of five degrees of freedom
    few = Few(blocks, columns, error_mm, sigma_mm)
    found = [drawn_sizes(few, np.random.default_rng(seed)) for seed in range(20)]
    for b in range(3):
        chance = np.average(there[b], weights=weight)
        seen = np.mean([sizes[b].any(axis=0).mean() if b in sizes else 0.0 for sizes in found])
        assert seen == pytest.approx(chance, abs=0.03)
    wanted = np.average(columns[2] @ drawn, weights=weight)
    mean = np.mean([sum(columns[2, block.at] @ sizes[b].mean(axis=1) for b, block in enumerate(blocks) if b in sizes)
                    for sizes in found])  # fmt: skip
    assert mean == pytest.approx(wanted, abs=0.03)


def test_machines_hold_the_truth_as_often_as_they_say(monkeypatch):
    monkeypatch.setattr("printmend.infer.distances.PASSES", (0, SWEEPS))
    printer, distances = case_of("ender3")
    rng = np.random.default_rng(8)
    held = []
    for seed in range(8):
        scale, play = rng.normal(0, 0.02), abs(rng.normal(0, 0.5)) * (rng.uniform() < 0.5)
        readings = read_off(distances, broken(printer, scale=scale, play=play), rng)
        readings[6:] = np.nan
        parts = machines_by_hand(distances, readings, printer, np.random.default_rng(seed)).parts
        for motor in range(2):
            for effect, true in (("scale", scale * SCALE_MM), ("play", play)):
                drawn = sum((part.draws_mm[0] for part in parts if (part.effect, part.where) == (effect, motor)), 0.0)
                low, high = np.quantile(drawn, (0.05, 0.95))
                held.append(low - 1e-9 <= true <= high + 1e-9)
    assert np.mean(held) >= 0.75


def test_a_sound_printer_is_not_promised_badly_nor_a_loose_one_well():
    printer, distances = case_of("ender3")

    def promised_mm(machine: Mechanism, count: int) -> Promise:
        readings = read_off(distances, machine)
        readings[count:] = np.nan
        belief = parse_belief(model_by_hand(distances, readings, printer))
        assert belief is not None  # of a file as it is, on a machine of which nothing is known
        belief = replace(belief, parts=tuple(replace(part, acts_mm=0 * part.acts_mm) for part in belief.parts))
        angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
        tangent = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
        ring = PathPlaces(
            np.array(printer.middle_mm) + 30 * np.stack([np.cos(angle), np.sin(angle)], axis=1),
            tangent, np.zeros(400), np.sign(tangent), np.full(400, 0.5),
        )  # fmt: skip
        outlook = promised(broken(printer), belief, ring, Errors(0.0, 0.0, 0.0), Errors(0.0, 0.0, 0.0))
        assert outlook is not None
        return outlook.before

    sound, few = (promised_mm(broken(printer), count) for count in (12, 1))
    loose = promised_mm(broken(printer, play=0.8), 12)
    assert sound.rms_low_mm < 0.004
    assert sound.rms_mm < 0.03 < few.rms_high_mm
    assert few.rms_high_mm > 3 * sound.rms_high_mm  # one distance tells little
    assert loose.rms_low_mm > 0.1


def test_readings_that_no_play_explains_let_none_act():
    printer, distances = case_of("ender3")
    readings = read_off(distances, broken(printer, play=-1.5))
    parts = machines_by_hand(distances, readings, printer, np.random.default_rng(0)).parts
    assert all(np.isfinite(part.draws_mm).all() for part in parts)
    assert not any(part.acts_mm.any() for part in parts if part.effect == "play")


def test_machines_of_both_motors_must_be_as_many(sound):
    assert parse_belief(sound) is not None
    section = deepcopy(sound.document["promise"])
    section["parts"][0]["draws"][0].append(0.0)
    with pytest.raises(ModelError, match="draws of each size"):
        parse_belief(replace(sound, document={**sound.document, "promise": section}))


def test_the_doubt_of_a_firmware_setting_is_that_of_the_machines():
    printer, distances = case_of("ender3")
    readings = read_off(distances, broken(printer, play=0.8))
    model = model_by_hand(distances, readings, printer)
    belief = parse_belief(model)
    assert belief is not None
    (play,) = belief.of("play", 0)
    acts, drawn = float(play.acts_mm[0]), play.draws_mm[0]
    assert acts == pytest.approx(drawn.mean(), abs=drawn.std())
    export = export_supported(model, "marlin")
    assert export.doubt_mm > 0.25 * np.sqrt(np.mean((drawn - acts) ** 2))  # half of it on either side, of one axis


def test_the_machine_has_the_corrected_faults_only(case):
    printer, distances = case
    model = model_by_hand(distances, read_off(distances, broken(printer, scale=0.02)), printer)
    truth = broken(printer, scale=0.02).homed()
    way = distances.plan.waypoints_mm
    assert np.abs(Twin(model.mechanism).follow(way) - Twin(truth).follow(way)).max() < 0.3
    assert np.abs(way - Twin(truth).follow(way)).max() > 3


@pytest.mark.parametrize(
    ("fault", "now", "changed"), [({}, {}, False), ({"play": 0.3}, {"play": 0.3}, False), ({}, {"play": 0.8}, True)]
)
def test_what_callipers_left_open_is_no_change_when_a_scan_tells_it(fault, now, changed):
    printer, distances = case_of("ender3")
    rng = np.random.default_rng(0)
    model = model_by_hand(distances, read_off(distances, broken(printer, **fault), rng), printer)
    plan = distances.plan
    marks = Twin(broken(printer, **now).homed()).follow(plan.waypoints_mm)[plan.rows]
    marks[np.arange(len(marks)) % 3 > 0] = np.nan  # a third of them shows it as well
    found = update(model, plan.trace(marks + rng.normal(0, 0.006, marks.shape)), rng=np.random.default_rng(0))
    assert bool(found.changes or found.anew) == changed
    (left,) = found.model.findings[1:]  # what was left open of X and Y is not any more
    assert left.startswith("Z wobble")


def test_a_print_that_nothing_mends_is_as_far_off_as_before(sound):
    """What acts is nothing, what is believed is not."""
    printer, distances = case_of("ender3")
    marks = Twin(broken(printer).homed()).follow(distances.plan.waypoints_mm)[distances.plan.rows]
    verdict = verify(sound, distances.plan.trace(marks))
    assert verdict.before_mm == pytest.approx(verdict.promised_mm, rel=0.1)


def test_a_third_of_a_prints_dots_show_the_play_that_distances_left_open():
    printer, distances = case_of("ender3")
    machine, rng = broken(printer, play=0.2), np.random.default_rng(0)
    model = model_by_hand(distances, read_off(distances, machine, rng), printer)
    marks = Twin(machine.homed()).follow(distances.plan.waypoints_mm)[distances.plan.rows]
    marks[np.arange(len(marks)) % 3 > 0] = np.nan
    verdict = verify(model, distances.plan.trace(marks + rng.normal(0, 0.01, marks.shape)))
    assert verdict.now_high_mm < 1.5 * verdict.now_mm  # more play than that would have shown


def test_the_play_of_a_corexy_motor_is_no_axis_of_marlins():
    known = exact_model(broken(case_of("corexy")[0], play=0.8))
    with pytest.raises(RefusedError, match="the backlash of a CoreXY only if built with CORE_BACKLASH, so no M425"):
        export_supported(known, "marlin")


def test_what_distances_leave_open_is_a_scans_to_tell(sound):
    """Neither `learn` nor a scanner was asked: nothing of theirs is advised."""
    for cause in ("play", "instrument", "parameters"):
        (advice,) = advice_of(sound, Promise(0.05, 0.1, 0.2, 0.02, 0.09, 0.0, 0.001, {cause: 0.049}))
        assert "whole `printmend probe`" in advice
    assert any(words.endswith("none found") for words in sound.findings)
    assert Estimate("X", 0.074, 0.046, "mm", supported=True, corrected=False, absent=False).words.endswith(
        "(not corrected)"
    )


def test_odd_readings_end_in_one_line(case):
    _, distances = case
    good = [f"{value:.2f}" for value in distances.across_mm]
    assert np.isfinite(parse_readings("mm\n" + "\n".join(good), distances, subject="list")).all()
    assert np.isnan(parse_readings("\n" + "\n".join(good[1:]), distances, subject="list")[0])
    for empty in ("2,131,", "2,a,", "2;"):
        assert np.isnan(parse_readings("\n".join([good[0], empty, *good[2:]]), distances, subject="list")[1]), empty
    units = "\n".join(f"{each} mm" for each in good)
    assert np.isfinite(parse_readings(units, distances, subject="list")).all()  # the first is no header
    for text, named in (
        ("\n".join(["nan", *good[1:]]), "distance 1"),
        ("\n".join([f"{good[0][:-2]}o{good[0][-1]}", *good[1:]]), "distance 1"),
        ("\n".join([*good, "5"]), "12 distances"),
        ("\n".join([good[0], "long"]), "distance 2"),
        (f"{distances.across_mm[0] / 25.4:.3f}", "25.4"),
        ("3", "distance 1"),
        (f"9-{good[0].replace('.', ',')}", f"'9-{good[0].replace('.', ',')}'.*like 123.45"),
        (f"2;{good[0]}", "distance 1 in mm.*in the order of the list"),
    ):
        with pytest.raises(TraceError, match=named):
            parse_readings(text, distances, subject="list")


def test_the_command_lists_reads_and_learns(tmp_path):
    printer, distances = case_of("ender3")
    write_plan(tmp_path / "probe.json", distances.plan)
    arguments = ["--callipers", "--probe", str(tmp_path / "probe.json"), "--overlay", str(tmp_path / "map.png")]
    arguments += ["--printer", "ender3", "-o", str(tmp_path / "printer.mend.json")]
    listed = CliRunner().invoke(command, arguments, input="", catch_exceptions=False)
    assert "12." in listed.output
    assert (tmp_path / "map.png").exists()
    assert not (tmp_path / "printer.mend.json").exists()
    readings = read_off(distances, broken(printer, scale=0.01))
    typed = "\n".join(f"{value:.2f}" for value in readings)
    CliRunner().invoke(command, arguments, input=typed, catch_exceptions=False)
    model = read_model(tmp_path / "printer.mend.json")
    assert not model.is_healthy
    belief = parse_belief(model)
    assert belief is not None
    assert not belief.placed
    (scale,), (play,) = (belief.of(name, 0) for name in ("scale", "play"))
    assert 0.01 < scale.draws_mm.std() < 0.2  # mm in 100 mm
    assert scale.draws_mm.mean() == pytest.approx(1.0, abs=3 * scale.draws_mm.std())
    assert play.draws_mm.max() < 0.3


def test_a_reading_far_off_is_doubted_though_a_fault_might_explain_it():
    assert "(9 %) off" in _doubt(133.0, 146.5, 146.5, 5.0, False)
    assert "no fault" in _doubt(149.5, 146.5, 146.5, 0.1, False)
    assert "inches" in _doubt(5.75, 146.5, 146.5, 5.0, False)
    assert "distances so far" in _doubt(146.5, 146.5, 150.0, 0.1, True)
    assert _doubt(146.0, 146.5, 146.5, 0.5, False) == _doubt(149.8, 146.5, 150.0, 0.1, True) == ""


def test_callipers_talk(tmp_path):
    """An owner with a decimal comma, one slip, one undo, some inner edges: the answers end by themselves and tell."""
    plan = design_probe(read_printer("ender3"), size_mm=160, marks=200)
    machine = broken(read_printer("ender3"), scale=0.01, play=0.4)
    said: list[str] = []
    marks = Twin(machine).follow(plan.waypoints_mm)[plan.rows]
    asked = {"slip": True, "undo": True, "count": 0}

    def ask(question: str) -> str:
        asked["count"] += 1
        assert asked["count"] < 40
        spots = [word.split() for word in said[-1].splitlines()[-1].replace(":", "").split("dot at ")[1:]]
        places = np.array([[float(one[0][1:]), float(one[1][1:])] for one in spots])
        a, b = (marks[plan.big][np.argmin(np.hypot(*(plan.marks_mm[plan.big] - spot).T))] for spot in places)
        between = float(np.hypot(*(a - b)))
        if asked["slip"] and asked["count"] == 3:
            asked["slip"] = False
            return f"{between + plan.big_dot_mm + 4:.2f}"
        if asked["undo"] and asked["count"] == 5:
            asked["undo"] = False
            return "u"
        if asked["count"] % 3 == 0:
            return f"i{between - plan.big_dot_mm - 0.1:.2f}".replace(".", ",")
        return f"{between + plan.big_dot_mm + 0.1:.2f}".replace(".", ",")

    distances, readings = talk(plan, ask, said.append, picture=tmp_path / "map.png")
    # what fits the distances before it is not doubted, however far that is from what was wanted
    assert sum("Measure again" in line for line in said) == 1
    assert any("taken back" in line for line in said)
    assert said[-1].startswith("Enough")
    assert 6 <= len(readings) <= MOST_DISTANCES + 12
    found = {item.name: item for item in estimates_by_hand(distances, readings)}
    scale = found["X scale error (+: prints too large)"]
    assert abs(scale.value - 1.0) < 3 * scale.sd
    assert abs(found["dot width"].value - 0.1) < 3 * found["dot width"].sd
    assert (tmp_path / "map.png").exists()


@pytest.mark.parametrize(("line", "value"), [("146,25", 146.25), ("146.25", 146.25), ("3,146.25", 146.25),
                                             ("146,25 mm", 146.25), ("so", None), ("9.146,25", 25.0),
                                             ("146.25 147.25", None)])  # fmt: skip
def test_a_decimal_comma_is_read(line, value):
    assert number_in(line, 146.0) == value


@pytest.mark.parametrize("front", ["{};", "{}: ", "{}. ", "{}\t", "{}  ", "{} ; ", "{},", "{})"])
@pytest.mark.parametrize("comma", [".", ","])
def test_a_line_may_begin_with_its_number(front, comma):
    _, distances = case_of("ender3")
    about = enumerate(distances.across_mm, start=1)
    lines = [front.format(at) + f"{mm:.2f}".replace(".", comma) for at, mm in about]
    lines[3] = front.format(4)  # not measured
    came = parse_readings("\n".join(lines), distances, subject="list")
    assert np.flatnonzero(np.isnan(came)).tolist() == [3]
    assert np.delete(came, 3) == pytest.approx(np.delete(distances.across_mm, 3), abs=0.006)
