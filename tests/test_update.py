"""A model brought up to date: what changed is found, what did not stays, and nothing is ever lost by it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.corruption import Corruption, CrookedFrame, Drive, EccentricBore, Ellipse, Play, Polygon, corruption_of
from printmend.errors import ModelError
from printmend.learn.learned import learn_model
from printmend.measure import ProbePlan
from printmend.measure.table import read_trace, write_trace
from printmend.mend.history import read_history, remember_learned
from printmend.mend.update import update
from printmend.model import SavedModel, read_model, write_model
from printmend.path import Origin, Trace
from printmend.printer import Printer, read_printer
from printmend.probe import design_probe
from printmend.promise.belief import parse_belief
from printmend.twin import Twin
from tests.test_greybox_learning import stairs

pytestmark = pytest.mark.usefixtures("once")
ENDER3 = read_printer("ender3")
NOISE_MM = 0.03


def machine(play_x: float = 0.2, play_y: float = 0.3, phase: float = 1.0) -> Corruption:
    return Corruption(
        (
            Drive(pulley=EccentricBore(0.5, phase), belt=Play(play_x)),
            Drive(pulley=Ellipse(6.6, 6.1, 0.4), belt=Play(play_y)),
        )
    )


def printed(
    corruption: Corruption,
    points: int,
    seed: int,
    *,
    small: bool = True,
    printer: Printer = ENDER3,
    shift_mm: float = 0.0,
) -> Trace:
    way = stairs(points, 60, 130) if small else stairs(points)
    measured = Twin.of(corruption, printer).follow(way) + shift_mm
    return Trace(way, measured + np.random.default_rng(seed).normal(0, NOISE_MM, way.shape), homed=True)


def error_mm(model: SavedModel, corruption: Corruption, *, placed: bool = True) -> float:
    """Return the RMS error of all branches; without ``placed`` a shift of each axis is taken off."""
    motor, errors = np.linspace(10, 210, 801), []
    truth = corruption.lower(model.printer).homed()
    for have, want in zip(model.mechanism.transmissions, truth.transmissions, strict=True):
        off = np.stack(have.branches_mm(motor)) - np.stack(want.branches_mm(motor))
        errors.append(off if placed else off - off.mean())
    return float(np.sqrt(np.mean(np.square(errors))))


@pytest.fixture(scope="module")
def old() -> SavedModel:
    return learn_model(printed(machine(), 600, 0, small=False), ENDER3, rng=np.random.default_rng(0))


def test_four_dots_of_a_tower_say_nothing_new_of_all_the_bed(old: SavedModel) -> None:
    """What was seen of the turns stays seen, and noise at four places is no pattern of places."""
    way = np.concatenate([[ENDER3.home_mm], np.tile([[100.0, 90], [120, 90], [120, 110], [100, 110]], (40, 1))])
    measured = Twin.of(machine(), ENDER3).follow(way) + np.random.default_rng(7).normal(0, NOISE_MM, way.shape)
    model = update(old, Trace(way, measured, homed=True), rng=np.random.default_rng(0)).model
    now, before = parse_belief(model), parse_belief(old)
    assert now is not None
    assert before is not None
    assert now.scene.bed_span_mm == before.scene.bed_span_mm
    assert {part.effect for part in now.parts if part.acts_mm.any()} == {
        part.effect for part in before.parts if part.acts_mm.any()
    }


def test_the_same_machine_stays(old: SavedModel) -> None:
    updated = update(old, printed(machine(), 200, 1), rng=np.random.default_rng(0))
    assert updated.changes == ()
    assert updated.anew == ()
    assert error_mm(updated.model, machine()) < error_mm(old, machine()) + 0.1 * NOISE_MM


def test_a_healthy_printer_stays_healthy_after_a_small_print() -> None:
    healthy = Corruption((Drive(), Drive()))
    before = learn_model(printed(healthy, 300, 4, small=False), ENDER3)
    again = update(before, printed(healthy, 60, 14), rng=np.random.default_rng(0))
    model = again.model
    assert again.anew == ()  # a healthy motor that stays healthy was not replaced
    assert before.findings[0] == model.findings[0] == "X healthy; Y healthy"
    at = np.linspace(0, 220, 50)
    for table in model.mechanism.transmissions:
        assert np.abs(np.stack(table.branches_mm(at)) - at).max() < 1e-9  # mend copies every file
    # the first print saw the whole bed, and that stays known
    assert not any("elsewhere" in each["words"] for each in model.document["misfit"]["found"])


def test_what_a_print_left_open_is_open_until_another_shows_it() -> None:
    def learned(old: SavedModel | None, low: float, high: float) -> SavedModel:
        way = stairs(300, low, high)
        noise = np.random.default_rng(int(high)).normal(0, NOISE_MM, way.shape)
        trace = Trace(way, Twin.of(machine(), ENDER3).follow(way) + noise, homed=True)
        rng = np.random.default_rng(0)
        return learn_model(trace, ENDER3, rng=rng) if old is None else update(old, trace, rng=rng).model

    part = learned(None, 100, 125)
    *turns, screw = part.findings[1:]
    assert len(turns) == 2  # 25 of the 40 mm of a turn of X, and of Y
    assert learned(part, 101, 125).findings[1:] == part.findings[1:]
    assert learned(part, 60, 130).findings[1:] == (screw,)


def test_a_pulley_that_turned_is_found_as_one_angle_and_a_belt_that_was_put_back_is_thought_of(old: SavedModel) -> None:
    """A belt some teeth away looks like a pulley that turned on its shaft by a whole number of teeth."""

    def swing_mm(model: SavedModel) -> float:
        (fault,) = (each for each in model.document["diagnosis"] if (each["part"], each["kind"]) == ("x", "harmonic-1"))
        return float(fault["value"])

    for teeth, words in ((7, "or its belt was put back 7 teeth away"), (7.5, "(± 0.")):
        now = printed(machine(phase=1.0 + teeth * 2 * np.pi / 20), 200, 11)
        updated = update(old, now, rng=np.random.default_rng(0))
        (change,) = updated.changes
        assert (change.part, change.kind, updated.anew) == ("X", "phase", ())
        assert abs(change.now) == pytest.approx(teeth * 360 / 20, abs=3.0)
        assert swing_mm(updated.model) == pytest.approx(swing_mm(old), abs=0.01)
        assert "X pulley turned on its shaft" in change.words
        assert words in change.words
        assert ("teeth" in change.words) == (teeth == 7)


def test_play_and_skew_that_grew_are_found_and_no_oval_pulley_turned(old: SavedModel) -> None:
    """Though the print lies elsewhere, and however much the play grew: it is the same printer."""
    now = replace(machine(play_x=0.35, play_y=0.9), frame=CrookedFrame(skew_deg=0.3))
    trace = printed(now, 300, 5, shift_mm=3.0)
    updated = update(old, trace, rng=np.random.default_rng(0))
    assert updated.anew == ()
    found = {(change.part, change.kind): change for change in updated.changes}
    assert set(found) == {("X", "play"), ("Y", "play"), ("frame", "skew")}
    for key, now_is, most_sd in (
        (("X", "play"), 0.35, 0.01),
        (("Y", "play"), 0.9, 0.01),
        (("frame", "skew"), 0.3, 0.025),
    ):
        assert abs(found[key].now - now_is) < 4 * found[key].sd
        assert found[key].sd < most_sd
    assert "X belt play grew from 0.20 to 0.35 mm" in updated.words
    assert "skew grew from 0.00 to 0.3" in updated.words
    assert error_mm(updated.model, now, placed=False) <= 1.02 * error_mm(old, now, placed=False)


def test_backlash_compensation_that_was_switched_off_or_on_is_found() -> None:
    """It took up 0.12 mm that are not there, beside a pulley off its centre."""
    way, noise = stairs(400), np.random.default_rng(4).normal(0, NOISE_MM, (2, 500, 2))
    off, on = (Twin.of(corruption_of(["pulley:on=x,size_mm=0.1,harmonic=1,phase_rad=1", *more]), ENDER3).seen(way)
               for more in ([], ["play:on=x,size_mm=-0.12"]))  # fmt: skip
    for before, now, word in ((on, off, "shrank"), (off, on, "grew")):
        first, new = (Trace(way, place + each[: len(way)], homed=True)
                      for place, each in zip((before, now), noise, strict=True))  # fmt: skip
        old = learn_model(first, ENDER3, rng=np.random.default_rng(0))
        updated = update(old, new, rng=np.random.default_rng(0))
        (change,) = updated.changes
        assert (change.part, change.kind) == ("X", "overcompensation")
        assert abs(abs(change.now - change.before) - 0.12) < 4 * change.sd < 0.04
        assert updated.words.startswith(f"X excess backlash compensation {word}")
        drive = updated.model.mechanism.transmissions[0]
        assert np.abs(drive.upper_mm - drive.lower_mm).max() < 4 * change.sd


def test_another_printers_table_is_asked_whose_it_is(old: SavedModel) -> None:
    drives = (Drive(belt=Play(0.6)), Drive(pulley=EccentricBore(0.9, 3.0), belt=Play(0.1)))
    other = update(old, printed(Corruption(drives), 200, 5, small=False), rng=np.random.default_rng(0))
    assert other.words.endswith("is this measurement of the same printer?")
    assert other.model.document["update"]["anew"] == ["X", "Y"]


def test_another_scan_of_another_scale_is_no_change() -> None:
    """Neither of the motor with faults nor of the healthy one."""
    half, rng = Corruption((machine().drives[0], Drive())), np.random.default_rng(4)

    def scanned(plan: ProbePlan, stretch: float) -> Trace:
        marks = Twin.of(half, ENDER3).follow(plan.waypoints_mm)[plan.rows]
        return plan.trace(marks * stretch + rng.normal(0, 0.006, marks.shape))

    first = learn_model(scanned(design_probe(ENDER3), 1.0), ENDER3, rng=np.random.default_rng(0))
    again = update(first, scanned(design_probe(ENDER3, size_mm=90), 0.9985), rng=np.random.default_rng(0))
    assert (again.changes, again.anew) == ((), ())
    assert again.model.findings[0].endswith("Y healthy")


@pytest.mark.parametrize(("percents", "changed"), [((0.15, 0.15), []), ((0.15, 0.0), [("X", "scale")])])
def test_a_rule_of_another_length_is_no_change(
    old: SavedModel, percents: tuple[float, float], changed: list[tuple[str, str]]
) -> None:
    """Where both axes change alike, the instrument did; where one does, the machine."""
    again = printed(machine(), 200, 8)
    read = replace(again, measured_mm=again.measured_mm * (1 + np.array(percents) / 100))
    found = update(old, read, rng=np.random.default_rng(0))
    assert [(each.part, each.kind) for each in found.changes] == changed
    assert changed or error_mm(found.model, machine()) < 0.02


def test_never_worse_than_the_new_trace_alone(old: SavedModel) -> None:
    """X got another pulley, Y was repaired."""
    now = Corruption((Drive(pulley=Polygon((6.9, 6.2, 7.1, 6.5), 0.3), belt=Play(0.2)), Drive()))
    trace = printed(now, 200, 6)
    updated = update(old, trace, rng=np.random.default_rng(0))
    fresh = learn_model(trace, ENDER3, rng=np.random.default_rng(0))
    assert error_mm(updated.model, now) <= error_mm(fresh, now) + 0.1 * NOISE_MM
    assert updated.changes or updated.anew


def test_skew_and_wavy_guides_are_remembered() -> None:
    printer = read_printer("corexy")  # where a frame mixes both motors
    frame = CrookedFrame(0.5, x_wave_mm=0.3, x_wave_period_mm=120.0)
    crooked = Corruption((machine().drives[0], Drive()), frame)
    way = np.vstack([stairs(300), np.random.default_rng(3).uniform(10, 210, (200, 2))])
    places = Twin.of(crooked, printer).follow(way)
    first, second = (
        Trace(way, places + np.random.default_rng(seed).normal(0, NOISE_MM, way.shape), homed=True) for seed in (1, 2)
    )
    old = learn_model(first, printer)
    again = update(old, second, rng=np.random.default_rng(0))
    assert len(old.mechanism.frame.waves) == len(again.model.mechanism.frame.waves) == 1
    assert (again.changes, again.anew) == ((), ())
    bed = np.array([[20.0, 20.0], [20.0, 200.0], [200.0, 20.0], [200.0, 200.0]])
    frames = [model.mechanism.frame.apply(bed) for model in (old, again.model)]
    assert np.abs(frames[0] - frames[1] - (frames[0] - frames[1]).mean(axis=0)).max() < 0.05


def run(*args: object):
    return CliRunner().invoke(group, [str(arg) for arg in args])


def test_the_command_says_what_changed_and_what_it_wrote_is_brought_up_to_date_again(
    old: SavedModel, tmp_path: Path
) -> None:
    write_model(tmp_path / "old.mend.json", old)
    write_trace(tmp_path / "trace2.csv", printed(machine(0.35), 200, 9))
    new, learned = tmp_path / "new.mend.json", remember_learned(tmp_path / "old.mend.json", old, "trace.csv")
    past = learned.read_text()
    result = run("learn", "--update", tmp_path / "old.mend.json", tmp_path / "trace2.csv", "-o", new)
    assert result.exit_code == 0, result.output
    assert "X belt play grew from 0.20 to 0.3" in result.output
    assert json.loads(new.read_text())["update"]["from"] == old.digest
    assert read_model(new).findings[0].startswith("X pulley eccentric")
    assert [event["event"] for event in read_history(new)] == ["learned", "updated"]
    day = "2031-02-03"  # the same again, with a date: it counts once
    again = run("learn", "--update", tmp_path / "old.mend.json", tmp_path / "trace2.csv", "-o", new, "--date", day)
    assert "The history has this measurement already: it counts once" in again.output
    assert [event["time"][:10] for event in read_history(new)][1:] == [day]
    assert learned.read_text() == past
    (change,) = update(read_model(new), printed(machine(0.45), 200, 8), rng=np.random.default_rng(0)).changes
    assert (change.before, change.now) == (pytest.approx(0.35, abs=0.02), pytest.approx(0.45, abs=0.02))


def test_bad_input_ends_in_one_line(old: SavedModel, tmp_path: Path) -> None:
    trace = printed(machine(), 200, 9)
    write_trace(tmp_path / "trace2.csv", trace)
    write_model(tmp_path / "naive.mend.json", learn_model(trace, ENDER3, model="naive", rng=np.random.default_rng(0)))
    write_model(tmp_path / "old.mend.json", old)
    for arguments in (
        ["--update", tmp_path / "naive.mend.json"],
        ["--update", tmp_path / "none.mend.json"],
        ["--update", tmp_path / "old.mend.json", "--printer", "ender5"],
    ):
        result = run("learn", tmp_path / "trace2.csv", *arguments, "-o", tmp_path / "new.mend.json")
        assert isinstance(result.exception, ModelError)
        assert "\n" not in str(result.exception)
    result = run("learn", tmp_path / "trace2.csv", "--update", tmp_path / "trace2.csv")
    assert "expected a printer.mend.json, found another kind of file; give the file that" in str(result.exception)
    write_trace(tmp_path / "corexy.csv", replace(trace, origin=Origin("CoreXY 300", "corexy")))
    newer = update(old, read_trace(tmp_path / "trace2.csv", ENDER3), rng=np.random.default_rng(0))
    write_model(tmp_path / "newer.mend.json", newer.model)
    result = run("learn", tmp_path / "corexy.csv", "--update", tmp_path / "old.mend.json")
    assert "found one of CoreXY 300" in str(result.exception)
    result = run("learn", tmp_path / "trace2.csv", "--update", tmp_path / "newer.mend.json")
    assert "counts once" in result.output
    assert read_model(tmp_path / "newer.mend.json").digest == newer.model.digest
    assert run("learn", tmp_path / "trace2.csv").exit_code == 2
    assert not (tmp_path / "new.mend.json").exists()
