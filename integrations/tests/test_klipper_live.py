"""The live transform for Klipper, judged by Klippy: where the plastic lands without any rewriting."""

import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hosts import INTEGRATIONS
from parts import part

from klippy_judge import judge_both
from klippy_run import RefusedByPlanner, plan
from printmend.corruption import Corruption, Drive, corruption_toml, sample
from printmend.corruption.shaft import Ripple
from printmend.printer import read_printer
from printmend.repair import mend_gcode
from printmend.saved.model import exact_model, read_model, write_model
from true_printer import TruePrinter

ENDER3, COREXY = read_printer("ender3"), read_printer("corexy")


def extra():
    spec = importlib.util.spec_from_file_location("printmend_live", INTEGRATIONS / "klipper/printmend.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


CASES = [("pulley-play", ENDER3, 1.0), ("pulley-loose", COREXY, 1.0), ("elastic", COREXY, 0.5)]


@pytest.mark.parametrize(
    ("family", "printer", "segment_mm"), CASES, ids=lambda value: getattr(value, "name", str(value))
)
def test_the_plastic_lands_where_it_should(family: str, printer, segment_mm: float, tmp_path: Path) -> None:
    corruption = sample(family, np.random.default_rng([5, *family.encode()]), "realistic")
    model = tmp_path / "printer.mend.json"
    write_model(model, exact_model(corruption.lower(printer)))
    text = part(1, arcs=True)
    original = plan(text, printer, tmp_path / "a")
    extras = f"[printmend]\nmodel: {model}\nsegment: {segment_mm}\n"
    live = plan(text, printer, tmp_path / "b", around=original, extras=extras)
    true = TruePrinter.of(corruption_toml(corruption), printer)
    before, after, complaints = judge_both(original, live, printer, true, text, text)
    assert not complaints
    assert after.rms_mm < 0.012
    assert after.max_mm < 0.05
    assert before.rms_mm > 4 * after.rms_mm
    assert after.samples == pytest.approx(before.samples, rel=1e-3)


RIPPLES = [(0.0, 0.0), (0.1, 0.2), (0.3, 0.05)]


@pytest.mark.parametrize("shift_mm", RIPPLES)
def test_a_ripple_stays_locked_where_the_end_stops_scatter(shift_mm: tuple[float, float], tmp_path: Path) -> None:
    """Homing takes the place of the end stop for another one: the motors' phase tells by how much."""
    ripple = Ripple((0.15,), (10.0,), (1.0,))  # 0.03 mm a belt tooth
    corruption = Corruption((Drive(ripple), Drive(replace(ripple, phase_rad=(2.5,)))))
    model = tmp_path / "printer.mend.json"
    write_model(model, exact_model(corruption.lower(ENDER3)))
    x, y = (replace(axis, home_mm=by) for axis, by in zip((ENDER3.x, ENDER3.y), shift_mm, strict=True))
    missed = replace(ENDER3, x=x, y=y)  # where the firmware thinks that the carriage is at home
    text, true = part(1), TruePrinter.of(corruption_toml(corruption), ENDER3)
    original = plan(text, ENDER3, tmp_path / "a")
    left = {}
    for name, phases in (("locked", "phase_x: 0\nphase_y: 0\n"), ("plain", "")):
        extras = f"[printmend]\nmodel: {model}\nsegment: 0.25\n{phases}"
        live = plan(text, missed, tmp_path / name, around=original, extras=extras)
        steps = dict(live.steps)
        moves = live.moves.copy()
        for column, (motor, by) in enumerate(zip("xy", shift_mm, strict=True)):
            steps[motor] = (steps[motor][0], steps[motor][1] - by)
            moves[:, [7 + column, 11 + column]] -= by
        _, after, complaints = judge_both(original, replace(live, steps=steps, moves=moves), ENDER3, true, text, text)
        assert not complaints
        left[name] = after.rms_mm
    assert left["locked"] < 0.01
    assert any(shift_mm) == (left["plain"] > 1.5 * left["locked"])


def test_the_phases_are_said_and_kept(tmp_path: Path) -> None:
    model = tmp_path / "printer.mend.json"
    write_model(model, exact_model(sample("play", np.random.default_rng(1), "realistic").lower(ENDER3)))
    extras = f"[printmend]\nmodel: {model}\n"
    x = replace(ENDER3.x, home_mm=0.1)
    plan(b"PRINTMEND_PHASE SAVE=1\nG1 X10 F600\n", replace(ENDER3, x=x), tmp_path, extras=extras)
    log = (tmp_path / "log").read_text(errors="replace")
    assert "phases at zero are x 56/64, y 0/64; kept" in log


def test_what_it_cannot_hold_is_refused_in_words(tmp_path: Path) -> None:
    model = tmp_path / "printer.mend.json"
    lines = f"[printmend]\nmodel: {model}\n"

    def refusal(printer) -> str:
        with pytest.raises(RefusedByPlanner):
            plan(b"G28\nG1 X10 F600\n", printer, tmp_path, extras=lines)
        return (tmp_path / "log").read_text(errors="replace")

    assert "cannot be read" in refusal(ENDER3)
    write_model(model, exact_model(sample("screw", np.random.default_rng(1)).lower(ENDER3)))
    assert "bad Z screw" in refusal(ENDER3)
    write_model(model, exact_model(sample("play", np.random.default_rng(1)).lower(ENDER3)))
    assert "not corexy" in refusal(COREXY)
    write_model(model, exact_model(sample("ripple", np.random.default_rng(1)).lower(ENDER3)))
    assert "waves that are too short" in refusal(ENDER3)
    document = json.loads(model.read_text())
    model.write_text(json.dumps({**document, "noise_mm": 1.0}))
    assert "changed or damaged" in refusal(ENDER3)


@pytest.mark.parametrize("family", ["pulley-loose", "elastic", "smooth", "ripple"])
def test_its_tables_are_the_models(family: str, tmp_path: Path) -> None:
    path = tmp_path / "printer.mend.json"
    write_model(path, exact_model(sample(family, np.random.default_rng(2), "realistic").lower(ENDER3)))
    live, model = extra(), read_model(path)
    machine = live.Machine(live.read_model(path))
    places = np.linspace(3.0, 215.0, 997)
    for drive, transmission in zip(machine.drives, model.mechanism.transmissions, strict=True):
        lower, upper = transmission.branches_mm(places)
        assert np.abs(lower - [drive.at(drive.lower, m) for m in places]).max() < 2e-4
        assert np.abs(upper - [drive.at(drive.upper, m) for m in places]).max() < 2e-4
        back = [drive.inverse(drive.lower, drive.at(drive.lower, m)) for m in places]
        assert np.abs(places - back).max() < 1e-6


def test_a_file_of_another_model_or_changed_since_is_not_begun(tmp_path: Path) -> None:
    (cards := tmp_path / "cards").mkdir()
    machine = sample("play", np.random.default_rng(1)).lower(ENDER3)
    other = sample("play", np.random.default_rng(2)).lower(ENDER3)
    write_model(model := tmp_path / "printer.mend.json", exact_model(machine))
    (source := tmp_path / "part.gcode").write_bytes(part(1))
    for name, who in (("own", machine), ("foreign", other)):
        mend_gcode(source, exact_model(who), cards / f"{name}.gcode")
    (cards / "forged.gcode").write_bytes((cards / "own.gcode").read_bytes().replace(b"F1800", b"F1900"))

    def said(name: str, *more: str) -> str:
        lines = "\n".join([f"[printmend]\nmodel: {model}", *more, f"[virtual_sdcard]\npath: {cards}\n"])
        plan(f"SDCARD_PRINT_FILE FILENAME={name}.gcode\n".encode(), ENDER3, tmp_path, extras=lines)
        return (tmp_path / "log").read_text(errors="replace")

    with pytest.raises(RefusedByPlanner, match="was mended with model"):
        said("foreign")
    with pytest.raises(RefusedByPlanner, match="was changed after it was mended"):
        said("forged")
    for name, more in (("own", ()), ("foreign", ("if_foreign: print",)), ("forged", ("if_forged: print",))):
        log = said(name, *more)
        assert "the file is mended; moves stay as they are" in log
        assert "mend its original again" not in log
