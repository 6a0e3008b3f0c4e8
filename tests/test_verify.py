"""A check print against its promise: kept, broken, or more than the measurement can tell."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.corruption import Corruption, Drive, EccentricBore, Ellipse, Play, Warp
from printmend.errors import ModelError, TraceError
from printmend.gcode.read import read_gcode
from printmend.learn.learned import learn_model
from printmend.measure.table import write_trace
from printmend.mend import mend_gcode
from printmend.mend.filament import printed_in, update_in, updated_in, verify_in
from printmend.mend.history import read_history, rows_of
from printmend.mend.update import Updated, update
from printmend.mend.verify import BROKEN, KEPT, UNSURE, Verdict, expectation, made, update_words, updated, verify
from printmend.model import SavedModel, exact_model, read_model, write_model
from printmend.path import FLATBED, Instrument, Trace, last_way
from printmend.printer import read_printer
from printmend.probe import design_probe
from printmend.probe.probe import write_probe
from printmend.twin import Twin
from printmend.twin.gcode import print_dots
from tests.test_greybox_learning import stairs
from tests.test_learn_nonsense import NONSENSE, Spoil

pytestmark = pytest.mark.usefixtures("once")
ENDER3 = read_printer("ender3")


def machine(play_x: float = 0.3, play_y: float = 0.2, phase: float = 1.0) -> Corruption:
    return Corruption((Drive(pulley=EccentricBore(0.4, phase), belt=Play(play_x)), Drive(belt=Play(play_y))))


BENT = machine()
OTHER = Corruption((Drive(pulley=Ellipse(7.0, 5.8, 0.3)), Drive(pulley=EccentricBore(0.5, 2.5), belt=Play(0.5))))
KNOWN_SCALE = Instrument(scale_sd=0.0003, axes_sd=0.001, lean_sd=0.0005)


@pytest.fixture(scope="module")
def bent() -> SavedModel:
    way = stairs(700)
    noise = np.random.default_rng(1).normal(0, 0.05, way.shape)
    return learn_model(Trace(way, Twin.of(BENT, ENDER3).follow(way) + noise, homed=True), ENDER3)


def mended_mm(model: SavedModel, wanted: np.ndarray) -> np.ndarray:
    """Return what mending commands [N, 2] for marks at wanted places [N, 2]."""
    motors = ENDER3.to_motor(model.mechanism.frame.invert(wanted)).copy()
    for motor, table in enumerate(model.mechanism.transmissions):
        side = last_way(motors[:, motor])
        branches = [np.interp(motors[:, motor], each, table.motor_mm) for each in (table.lower_mm, table.upper_mm)]
        motors[:, motor] = np.where(side > 0, branches[0], np.where(side < 0, branches[1], motors[:, motor]))
    motors[0] = wanted[0]
    return motors


def checked(
    model: SavedModel, corruption: Corruption, noise_mm: float, seed: int = 9, *, is_stated: bool = False,
    is_mended: bool = True, points: int = 200,
) -> Trace:  # fmt: skip
    """Return the check print of a machine, as its table has it."""
    wanted = np.round(stairs(points), 6)
    printed = Twin.of(corruption, ENDER3).follow(mended_mm(model, wanted) if is_mended else wanted)
    noise = np.random.default_rng(seed).normal(0, noise_mm, wanted.shape)
    return Trace(
        wanted, np.round(printed + noise, 6), homed=True, sigma_mm=np.full(len(wanted), noise_mm) if is_stated else None
    )


@pytest.mark.parametrize(
    ("noise_mm", "play_mm", "result", "is_stated"),
    [
        (0.05, 0.3, KEPT, True),
        (0.05, 0.4, BROKEN, False),
        (0.5, 0.3, UNSURE, False),
        (0.5, 0.3, UNSURE, True),
    ],
)
def test_a_tenth_more_play_breaks_a_promise_where_it_can_be_seen(
    bent: SavedModel, noise_mm: float, play_mm: float, result: str, is_stated: bool
) -> None:
    verdict = verify(bent, checked(bent, machine(play_mm), noise_mm, is_stated=is_stated))
    assert verdict.result == result, verdict.words
    assert f": {result}" in verdict.words
    assert bool(verdict.changed) == (result == BROKEN)
    if result == BROKEN:
        assert "Mend again with the model" in verdict.words
        wanted = stairs(200)
        printed = Twin.of(machine(play_mm), ENDER3).follow(mended_mm(bent, wanted))
        true_mm = float(np.linalg.norm((printed - wanted).std(axis=0)))  # each homing shifts all of a print
        assert 0.95 * verdict.now_low_mm < true_mm < 1.05 * verdict.now_high_mm
    if result == UNSURE:
        assert verdict.shows_from_mm > verdict.now_high_mm > 2 * verdict.promised_high_mm
        assert "the direction from which each was reached is a guess" in verdict.words
        assert ("say in sigma_mm" in verdict.words) != is_stated


@pytest.mark.parametrize("spoil", NONSENSE.values(), ids=NONSENSE)
def test_what_nobody_could_learn_from_is_not_judged(bent: SavedModel, spoil: Spoil, rng: np.random.Generator) -> None:
    trace = checked(bent, BENT, 0.05)
    with pytest.raises(TraceError) as refused:
        verify(bent, replace(trace, measured_mm=spoil(trace.measured_mm, rng)))
    assert "\n" not in str(refused.value)


def test_dots_whose_sides_are_not_known_keep_no_promise(bent: SavedModel) -> None:
    """A table without the ways between its dots: more play scatters them, and nobody can say whose that is."""
    trace = checked(bent, machine(0.5, 0.4), 0.05, points=600)
    order = np.random.default_rng(4).permutation(len(trace))
    verdict = verify(bent, Trace(trace.commanded_mm[order], trace.measured_mm[order]))
    assert verdict.result == UNSURE
    assert not verdict.ways_known


def test_a_smaller_change_is_told_beside_a_promise_that_is_kept(bent: SavedModel) -> None:
    verdict = verify(bent, checked(bent, machine(0.33), 0.02))
    assert verdict.result == KEPT
    assert "; but X belt play grew from 0.30" in verdict.words


@pytest.mark.parametrize(
    ("corruption", "grown", "instrument", "result"),
    [
        (BENT, 0.002, FLATBED, KEPT),  # no more than such a scanner may do
        (machine(0.4, 0.3), 0.0, FLATBED, BROKEN),
    ],
)
def test_a_scanners_doubt_hides_no_change_of_the_machine(
    bent: SavedModel, corruption: Corruption, grown: float, instrument: Instrument, result: str
) -> None:
    trace = checked(bent, corruption, 0.02)
    scan = replace(trace, measured_mm=(1 + grown) * trace.measured_mm, placed=False, instrument=instrument)
    verdict = verify(bent, scan)
    assert verdict.result == result, verdict.words
    if result == KEPT:
        assert verdict.stretch_percent == pytest.approx(100 * grown, abs=0.02)
    anew = update_words(verdict, Updated(bent, (), ("X",)))
    assert ("does not match the old model" in anew) == (result == BROKEN)  # what keeps its promise is of this machine


@pytest.mark.parametrize(("percents", "result"), [((0.15, 0.15), KEPT), ((0.15, 0.0), BROKEN)])
def test_a_rule_of_another_length_breaks_no_promise(
    bent: SavedModel, percents: tuple[float, float], result: str
) -> None:
    """Where both axes are off alike, the instrument is; where one is, the machine."""
    trace = checked(bent, BENT, 0.02)
    verdict = verify(bent, replace(trace, measured_mm=trace.measured_mm * (1 + np.array(percents) / 100)))
    assert verdict.result == result, verdict.words
    assert result == BROKEN or verdict.stretch_percent == pytest.approx(0.15, abs=0.02)


SHRINKS = np.array([0.006, 0.003])  # along X and Y


def in_plastic(trace: Trace) -> Trace:
    """Return the scan of a check print that shrank."""
    middle = np.array(ENDER3.middle_mm[:2])
    measured = trace.measured_mm - SHRINKS * (trace.measured_mm - middle)
    return replace(trace, measured_mm=measured + 3.0, placed=False, instrument=KNOWN_SCALE)


def test_what_a_check_print_shrank_breaks_no_promise(bent: SavedModel) -> None:
    scan = in_plastic(checked(bent, BENT, 0.02, points=200))
    assert verify(bent, scan).result == BROKEN
    verdict = verify_in(bent, scan, "pla-black")
    assert verdict.result == KEPT, verdict.words


def test_a_check_print_in_a_known_filament_was_mended_with_it(bent: SavedModel) -> None:
    first = in_plastic(Trace(stairs(200), Twin.of(BENT, ENDER3).follow(stairs(200)), homed=True))
    knows = update_in(bent, first, "pla-black", rng=np.random.default_rng(1)).model
    mended = mended_mm(printed_in(knows, "pla-black"), stairs(200))
    printed = Twin.of(BENT, ENDER3).follow(mended) + np.random.default_rng(2).normal(0, 0.02, mended.shape)
    again = in_plastic(Trace(stairs(200), printed, homed=True))
    verdict = verify_in(knows, again, "pla-black")
    assert verdict.result == KEPT, verdict.words
    assert not updated_in(knows, again, "pla-black").anew


@pytest.mark.parametrize(
    ("corruption", "is_mended", "words"),
    [
        (BENT, False, "Was the mended file printed"),
        (OTHER, False, "Is it another printer's"),
    ],
)
def test_a_broken_promise_says_what_may_be_wrong(
    bent: SavedModel, corruption: Corruption, is_mended: bool, words: str
) -> None:
    assert words in verify(bent, checked(bent, corruption, 0.03, is_mended=is_mended)).words


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        ({}, "kept (100 points); but it is farther off than before mending"),
        ({"promised_high_mm": 0.1}, "broken. It is farther off than before mending"),
        ({"promised_high_mm": 0.1, "before_mm": 0.16}, "broken, and as far off as before mending"),
        ({"now_low_mm": 0.0, "now_high_mm": 0.7}, "too coarse: it shows only errors above 0.762 mm. Scan the print"),
        (
            {"now_low_mm": 0.0, "now_high_mm": 0.7, "scanned": True},
            "This picture shows only errors above 0.762 mm. Mend",
        ),
    ],
)
def test_words_say_what_the_figures_say(figures: dict[str, Any], words: str) -> None:
    verdict = Verdict(100, 0.1, 0.15, 0.12, 0.18, 0.2, 0.1, 0.3, unlike_mm=0.2)
    assert words in replace(verdict, **figures).words


def test_what_measures_may_wander_and_breaks_no_promise(bent: SavedModel) -> None:
    trace = checked(bent, BENT, 0.02)
    walk = np.cumsum(np.random.default_rng(9).normal(0, 0.015, trace.commanded_mm.shape), axis=0)
    verdict = verify(bent, replace(trace, measured_mm=trace.measured_mm + walk))
    assert verdict.now_mm > verdict.promised_high_mm
    assert verdict.result == UNSURE, verdict.words
    assert "The instrument wanders" in verdict.words
    assert verify(bent, trace).wanders_mm < 0.002


def test_an_idlers_error_is_no_noise_of_the_table(bent: SavedModel) -> None:
    trace = checked(bent, BENT, 0.03)
    idler = 0.15 * np.sin(trace.commanded_mm * (2 * np.pi / 33.3)) * [1.0, 0.0]
    assert verify(bent, replace(trace, measured_mm=trace.measured_mm + idler)).result == BROKEN


def test_a_mended_test_print_shows_play_as_it_is_now(bent: SavedModel, tmp_path: Path) -> None:
    """Between its dots a mended file goes its own way, and from which side it reaches a dot is what play depends on."""
    plan = design_probe(ENDER3, size_mm=100)
    write_probe(tmp_path / "check.gcode", plan)
    mend_gcode(tmp_path / "check.gcode", bent, tmp_path / "mended.gcode", force=True)
    twin = Twin.of(machine(0.45, 0.0), ENDER3)
    dots_mm = print_dots(read_gcode(tmp_path / "mended.gcode", printer=ENDER3), twin, plan)
    newer = updated(bent, plan.trace(dots_mm + np.random.default_rng(5).normal(0, 0.01, dots_mm.shape)))
    plays_mm = [float(np.mean(table.upper_mm - table.lower_mm)) for table in newer.model.mechanism.transmissions]
    assert plays_mm == pytest.approx([0.45, 0.0], abs=0.01)
    assert {("X", "play")} <= {(change.part, change.kind) for change in newer.changes} <= {("X", "play"), ("Y", "play")}


def test_a_check_print_goes_as_its_file_does_where_home_lies_between_two_steps(tmp_path: Path) -> None:
    """The K1's home is no whole number of micro-steps away, and its test print begins with a line."""
    k1 = read_printer("k1")
    model = exact_model(Corruption((Drive(pulley=EccentricBore(0.2, 1.0)), Drive(belt=Play(0.15)))).lower(k1))
    plan = design_probe(k1, size_mm=100)
    write_probe(tmp_path / "check.gcode", plan)
    mend_gcode(tmp_path / "check.gcode", model, tmp_path / "mended.gcode", force=True)
    moves = read_gcode(tmp_path / "mended.gcode", printer=k1).moves
    goes = (moves.start_mm[:, :2] != moves.end_mm[:, :2]).any(axis=1)
    commanded, _ = made(model, plan.trace(plan.marks_mm))
    last = int(np.flatnonzero(commanded.measured_rows)[-1])
    off_mm = commanded.commanded_mm[1 : last + 1] - moves.end_mm[goes, :2][:last]
    assert np.abs(off_mm).max() < 0.01


def test_the_model_is_brought_up_to_date_with_what_was_really_commanded(bent: SavedModel) -> None:
    trace = checked(bent, machine(0.4), 0.05)
    commanded, wanted_mm = made(bent, trace)
    rows = commanded.measured_rows
    assert np.array_equal(wanted_mm[rows], trace.commanded_mm)
    assert np.abs(commanded.commanded_mm[rows] - mended_mm(bent, trace.commanded_mm)).max() < 0.01
    newer = updated(bent, trace)
    assert updated(newer.model, trace).is_known
    assert [(change.part, change.kind) for change in newer.changes] == [("X", "play")]
    again = verify(newer.model, checked(newer.model, machine(0.4), 0.02, seed=11))
    assert again.result == KEPT
    models = [newer.model, *(updated(bent, checked(bent, machine(0.4), 0.05, seed=seed)).model for seed in (19, 29))]
    before_mm, *now_mm = (promised_high_mm(model) for model in (bent, *models))
    assert np.mean(now_mm) <= 1.1 * before_mm  # the end of a range of few drawn machines scatters


@pytest.mark.parametrize("seed", [1, 4])
def test_a_new_belt_after_an_uneven_one_is_noticed(seed: int) -> None:
    """Of an uneven belt, its scale and its bend a print tells little more than the sum, and that is what changed."""
    rng = np.random.default_rng(seed)
    bumps = rng.standard_normal(12)
    bumps *= 0.08 / Warp(tuple(bumps), 25.0, -30.0).error_mm(np.linspace(10.0, 210.0, 201)).std()
    uneven = Warp(tuple(bumps), 25.0, -30.0)
    worn, new = (Corruption((drive, Drive(belt=Play(0.1)))) for drive in (Drive(warp=uneven), Drive()))
    way = stairs(600)
    known = Trace(way, Twin.of(worn, ENDER3).follow(way) + rng.normal(0, 0.05, way.shape), homed=True)
    model = learn_model(known, ENDER3)
    assert verify(model, checked(model, worn, 0.05, points=600)).result == KEPT
    verdict = verify(model, checked(model, new, 0.05, points=600))
    assert verdict.result == BROKEN
    few = stairs(400, 50.0, 170.0)
    for machine_, anew in ((worn, ()), (new, ("X",))):
        seen = Twin.of(machine_, ENDER3).follow(few) + rng.normal(0, 0.05, few.shape)
        newer = update(model, Trace(few, seen, homed=True), rng=np.random.default_rng(0))
        assert (newer.anew, newer.changes) == (anew, ())
        wanted = stairs(300, 55.0, 165.0)
        printed = Twin.of(machine_, ENDER3).follow(mended_mm(newer.model, wanted))
        true_mm = float(np.linalg.norm((printed - wanted)[1:].std(axis=0)))
        promise = expectation(newer.model, Trace(wanted, wanted, homed=True))
        assert promise is not None
        assert true_mm <= promise.rms_high_mm


def test_the_command_notes_the_verdict(bent: SavedModel, tmp_path: Path) -> None:
    model, new = tmp_path / "printer.mend.json", tmp_path / "new.mend.json"
    write_model(model, bent)
    again = ("coarse", BENT, 0.5, 0)  # the last measurement is read twice, and noted once
    cases = (("same", BENT, 0.05, 0), ("slipped", machine(phase=2.0), 0.05, 3), again, again)
    for name, corruption, noise_mm, code in cases:
        write_trace(tmp_path / f"{name}.csv", checked(bent, corruption, noise_mm, is_stated=name == "same"))
        done = CliRunner().invoke(group, ["verify", str(tmp_path / f"{name}.csv"), "-m", str(model), "-o", str(new)])
        assert done.exit_code == code, done.output
        assert "distances on the bed, about 1.4 times the distance across a line" in done.output
        assert read_model(new).document["update"]["from"] == bent.digest
        assert (f"Mend again with {new}" in done.output) == (name == "slipped")
    history = [json.loads(line) for line in (tmp_path / "printer.mend.history.jsonl").read_text().splitlines()]
    assert [each["result"] for each in history] == [KEPT, BROKEN, UNSURE]
    wanted = stairs(200)
    raw_mm = Twin.of(BENT, ENDER3).follow(wanted) - wanted
    assert history[0]["before_mm"] == pytest.approx(np.linalg.norm(raw_mm.std(axis=0)), rel=0.02)
    assert history[0]["now_mm"] < 0.03
    assert history[1]["now_mm"] > 0.1
    assert rows_of(read_history(model))[-1][2].endswith("cannot tell")


def test_what_is_no_check_print_is_refused(bent: SavedModel) -> None:
    wanted = stairs(300)
    with pytest.raises(ModelError):
        verify(exact_model(BENT.lower(ENDER3)), Trace(wanted, wanted))
    with pytest.raises(TraceError, match="at least 10 measured points"):
        verify(bent, Trace(wanted[:5], wanted[:5]))


def promised_high_mm(model: SavedModel) -> float:
    """Return up to how far the marks of a check print are promised to lie off."""
    promise = expectation(model, Trace(stairs(200), stairs(200), homed=True))
    assert promise is not None
    return promise.rms_high_mm


def test_marks_are_expected_as_they_turn_out(bent: SavedModel) -> None:
    verdict = verify(bent, checked(bent, BENT, 0.02))
    assert promised_high_mm(bent) == pytest.approx(verdict.promised_high_mm)
    assert expectation(exact_model(BENT.lower(ENDER3)), Trace(stairs(300), stairs(300))) is None


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["a.png"], "a.png is no .csv"),
        (["a.png", "--probe", "check.json", "--gcode", "part.gcode"], "add --probe"),
        (["a.png", "b.png", "--gcode", "part.gcode"], "for one scan of a part --gcode"),
    ],
)
def test_scans_need_what_was_printed(bent: SavedModel, tmp_path: Path, given: list[str], said: str) -> None:
    model = tmp_path / "printer.mend.json"
    write_model(model, bent)
    done = CliRunner().invoke(group, ["verify", *given, "-m", str(model)])
    assert done.exit_code == 2
    assert said in " ".join(done.output.split())
