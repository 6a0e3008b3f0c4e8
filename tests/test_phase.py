"""After the belts were worked on: nothing is mended until a print shows where the motors stand."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.corruption import Corruption, Drive, EccentricBore, Play
from printmend.diagnosis.advice import work_words
from printmend.effects.words import Fault
from printmend.errors import InputError, RefusedError, TraceError
from printmend.learn.learned import learn_model
from printmend.machine import Mechanism, homed_again
from printmend.measure import write_trace
from printmend.measure.plan import ProbePlan
from printmend.mend import check_gcode, mend_gcode
from printmend.mend.update import learn_phase, refitted
from printmend.model import SavedModel, read_model, write_model
from printmend.model.model import exact_model, saved_model
from printmend.path import FLATBED, Trace
from printmend.printer import Printer, read_printer
from printmend.probe import PHASE_MARKS, cost, design_probe, phase_size_mm
from printmend.twin import Twin
from tests.mending import SQUARE
from tests.test_greybox_learning import stairs

PRESETS = ("ender3", "corexy")
MINUTES = 2.0


def machine(printer: Printer, eccentricity_mm: float = 0.3) -> Mechanism:
    drives = (Drive(pulley=EccentricBore(eccentricity_mm, 1.0), belt=Play(0.15)), Drive(pulley=EccentricBore(0.2)))
    made = Corruption(drives).lower(printer)
    assert isinstance(made, Mechanism)
    return made


def phase_plan(printer: Printer) -> ProbePlan:
    return design_probe(printer, size_mm=phase_size_mm(printer), marks=PHASE_MARKS)


def measured(true: Mechanism, seed: int, noise_mm: float = 0.02) -> Trace:
    plan = phase_plan(true.printer)
    marks = Twin(true).follow(plan.waypoints_mm)[plan.rows]
    return plan.trace(marks + np.random.default_rng(seed).normal(0, noise_mm, marks.shape))


@pytest.fixture(scope="module")
def models() -> dict[str, SavedModel]:
    found = {}
    for preset in PRESETS:
        printer = read_printer(preset)
        way = stairs(300)
        printed = Twin(machine(printer)).follow(way) + np.random.default_rng(0).normal(0, 0.02, way.shape)
        found[preset] = learn_model(Trace(way, printed, homed=True), printer)
    return found


def test_a_print_of_two_minutes_shows_where_the_motors_stand(models: dict[str, SavedModel]) -> None:
    """On a CoreXY, whose motors both move either axis; the other tests look at a printer with one motor an axis."""
    old = models["corexy"]
    assert cost(phase_plan(old.printer))[0] < MINUTES
    true = homed_again(machine(old.printer), np.array([14.0, 26.0]))
    found = learn_phase(old, measured(true, 3), rng=np.random.default_rng(0))
    shifts = {change.part: change.now for change in found.changes if change.kind == "phase"}
    first, second = (name.upper() for name in old.printer.motors)
    assert shifts == {first: pytest.approx(14.0, abs=0.4), second: pytest.approx(-14.0, abs=0.4)}
    way = stairs(200, 70.0, 150.0)
    left = [Twin(true).follow(way) - Twin(model.mechanism).follow(way) for model in (old, found.model)]
    before, after = (np.sqrt(np.mean(np.square(each - each.mean(axis=0)).sum(axis=1))) for each in left)
    assert after < 0.01 < 0.2 < before


def test_a_scanners_wave_leaves_the_angle_as_open_as_it_is(models: dict[str, SavedModel]) -> None:
    """A wave of 6 µm beside one of 0.2 mm that turns with its motor, by a scanner whose carriage may make it."""
    old = models["ender3"]
    trace = measured(homed_again(machine(old.printer), np.array([14.0, 6.0])), 3, 0.005)
    wave_mm = [0.0, 0.006] * np.sin(2 * np.pi / 35 * trace.measured_mm[:, 1:])
    scanned = replace(trace, placed=False, instrument=FLATBED, measured_mm=trace.measured_mm + wave_mm)
    exact = replace(old, document={**old.document, "noise_mm": 0.005})
    found = learn_phase(exact, scanned, rng=np.random.default_rng(0))
    (now,) = (change for change in found.changes if (change.part, change.kind) == ("Y", "phase"))
    assert 0.1 < abs(now.now - 6.0) < 3 * now.sd


def test_a_home_that_moved_with_the_belts_is_learned(models: dict[str, SavedModel], tmp_path: Path) -> None:
    true = homed_again(machine(read_printer("ender3")), np.array([14.0, 26.0]))
    trace = measured(true, 3)
    aside = trace.measured_mm + np.array([0.3, 0.0])
    found = learn_phase(models["ender3"], replace(trace, placed=True, homed=True, instrument=None, measured_mm=aside),
                        rng=np.random.default_rng(0))  # fmt: skip
    told = {(change.part, change.kind): change.now for change in found.changes}
    assert told["X", "phase"] == pytest.approx(14.0, abs=0.4)
    assert told["X", "offset"] == pytest.approx(0.3, abs=0.03)
    assert ("Y", "offset") not in told
    assert "end stop" in found.words
    part = tmp_path / "part.gcode"
    part.write_bytes(SQUARE)
    aside_mm, plain_mm = (check_gcode(part, model).shift_mm for model in (found.model, exact_model(true)))
    assert np.subtract(aside_mm, plain_mm) == pytest.approx([0.3, 0.0], abs=0.03)


def test_the_print_of_another_machine_is_refused(models: dict[str, SavedModel]) -> None:
    other = machine(read_printer("ender3"), 0.1)
    with pytest.raises(TraceError, match="the machine of the model, with its motors elsewhere"):
        learn_phase(models["ender3"], measured(other, 3), rng=np.random.default_rng(0))


def test_nothing_is_mended_between_the_work_and_the_print(models: dict[str, SavedModel], tmp_path: Path) -> None:
    model, part = refitted(models["ender3"], ["X"]), tmp_path / "part.gcode"
    part.write_bytes(SQUARE)
    with pytest.raises(RefusedError, match="belt or pulley of X was worked on"):
        check_gcode(part, model)
    with pytest.raises(RefusedError, match="probe --phase"):
        mend_gcode(part, model, tmp_path / "out.gcode")
    assert not (tmp_path / "out.gcode").exists()
    with pytest.raises(InputError, match="a motor of this printer: x, y"):
        refitted(model, ["z"])


def test_the_commands_of_an_owner_after_the_work(models: dict[str, SavedModel], tmp_path: Path) -> None:
    def run(*args: object, code: int = 0) -> str:
        done = CliRunner().invoke(group, [str(arg) for arg in args])
        assert done.exit_code == code, (done.output, done.exception)
        return done.output

    model, printer = tmp_path / "printer.mend.json", models["ender3"].printer
    write_model(model, models["ender3"])
    assert "x: worked on, to be measured again" in run("history", model, "--refitted", "x")
    run("history", model, "--refitted", "y")
    assert "81 dots" in run("probe", "--printer", "ender3", "--phase", "-o", tmp_path / "phase.gcode")
    run("probe", "--printer", "ender3", "--phase", "--size", "60", "-o", tmp_path / "other.gcode", code=2)
    write_trace(tmp_path / "trace.csv", measured(homed_again(machine(printer), np.array([8.0, 0.0])), 5))
    assert "X has moved by +" in run("learn", tmp_path / "trace.csv", "--phase", model)
    (part := tmp_path / "part.gcode").write_bytes(SQUARE)
    said = check_gcode(part, read_model(model))  # both motors are measured again
    assert said.after.rms_mm < said.before.rms_mm
    assert "misfit" not in read_model(model).document or "worked on" not in str(read_model(model).document["misfit"])
    run("learn", tmp_path / "trace.csv", "--phase", model, "--update", model, code=2)
    with pytest.raises(TraceError, match="a print after the work"):
        learn_phase(read_model(model), measured(homed_again(machine(printer), np.array([8.0, 0.0])), 5),
                    rng=np.random.default_rng(0))  # fmt: skip


def test_who_did_the_advised_work_is_told_to_measure_again(models: dict[str, SavedModel], tmp_path: Path) -> None:
    def told(*args: object) -> list[str]:
        done = CliRunner().invoke(group, [str(arg) for arg in args])
        return [line for line in done.output.splitlines() if "measure again" in line]

    loose, part = tmp_path / "loose.mend.json", tmp_path / "part.gcode"
    part.write_bytes(SQUARE)
    write_model(loose, models["ender3"])
    mended = tmp_path / "out.gcode"
    for words in (["check", part], ["mend", part, "-o", mended], ["mend", part, part, "--in-place"]):
        (line,) = told(*words, "-m", loose)
        assert "this model advises (X, Y)" in line
        assert f"`printmend history {loose} --refitted x --refitted y`" in line
        part.write_bytes(SQUARE)
    for words in (["check", part], ["check", part, "--against", mended], ["mend", part]):
        (line,) = told(*words, "-m", loose, "--json")
        said = json.loads(line)
        assert sum("measure again" in each for each in said.get("prediction", said)["advice"]) == 1
    told("history", loose, "--refitted", "x")
    assert work_words(read_model(loose)) == ()  # it refuses, and says so
    stiff = saved_model(
        models["ender3"].mechanism, learner="test", findings=("",),
        details={"diagnosis": [Fault("x", "friction", 0.3, 0.01, "mm", "").row]},
    )  # fmt: skip
    assert work_words(stiff) == ()  # guides that are oiled move no belt
