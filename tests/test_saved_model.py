"""printer.mend.json: what is written is read back, and everything else ends in one clear line."""

import json
from dataclasses import replace

import numpy as np
import pytest

from printmend.corruption import HEALTHY, Corruption, Drive
from printmend.errors import ModelError
from printmend.files import MAX_TEXT_BYTES
from printmend.machine import Frame, Mechanism
from printmend.model import Branches, Wave
from printmend.model.model import (
    MOST_WRITTEN,
    branches_of,
    exact_model,
    model_text,
    parse_model,
    printer_section,
    read_model,
    saved_model,
    write_model,
)
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend_lab.sampling import sample
from tests.mending import coarsely

ENDER3 = read_printer("ender3")
AXIS = printer_section(ENDER3)["x"]


def branches(play_mm: float = 0.4) -> Branches:
    k = np.arange(1, 9)
    mean = Wave(np.array([0.3, -0.2]), k, 0.2 / k**3, -0.1 / k**3)
    return Branches(40.0, 110.0, (0.0, 220.0), mean, Wave(np.array([play_mm])))


@pytest.mark.parametrize(
    ("family", "name"), [("healthy", "ender5"), ("healthy", "corexy"), ("play", "ender3"), ("everything", "corexy")]
)
def test_exact_models_are_read_back(family: str, name: str, tmp_path) -> None:
    printer = read_printer(name)
    broken = sample(family, np.random.default_rng(3)) if family != "healthy" else None
    truth = HEALTHY.lower(printer) if broken is None else coarsely(broken, printer)
    model = exact_model(truth)
    write_model(tmp_path / "printer.mend.json", model)
    text = model_text(model)
    assert text == json.dumps(json.loads(text), indent=1, ensure_ascii=False) + "\n"
    again = read_model(tmp_path / "printer.mend.json")
    assert again.is_healthy == (family == "healthy")
    assert again.printer == printer
    assert again.digest == model.digest
    for want, got in zip(truth.homed().transmissions, again.mechanism.transmissions, strict=True):
        assert np.abs(want.lower_mm - got.lower_mm).max() < 1e-8
        assert np.abs(want.upper_mm - got.upper_mm).max() < 1e-8
        assert (np.diff(got.lower_mm) >= 0).all()
        assert (got.lower_mm <= got.upper_mm).all()
    assert np.abs(truth.frame.coefficients_mm - again.mechanism.frame.coefficients_mm).max() < 1e-8


def test_tables_of_a_printer_with_fine_steps_are_read_back() -> None:
    """They are written as coarsely as a file may have them: 220 mm at 256 to each of 400 steps are 1.7 million."""
    fine = {"microsteps": 256, "steps_per_turn": 400}
    printer = replace(ENDER3, x=replace(ENDER3.x, **fine), y=replace(ENDER3.y, **fine))
    worn = sample("smooth", np.random.default_rng(3)).drives[0]
    truth = Corruption((worn, Drive())).lower(printer)
    text = model_text(exact_model(truth))
    assert 4 * len(text) < MAX_TEXT_BYTES  # tables of both sides of both motors
    again = parse_model(text, subject="text").mechanism
    got = again.transmissions[0]
    assert len(got.lower_mm) <= MOST_WRITTEN
    start, controls = np.array([300, 300]), np.random.default_rng(4).integers(-1, 2, (400, 2)).cumsum(axis=0)
    ways = [Twin(each).run(np.diff(controls, axis=0, prepend=0), start) for each in (truth.homed(), again)]
    np.testing.assert_allclose(*ways, atol=1e-4)  # on the lattice, too, where entries stand for full steps
    bed_mm = np.linspace(0.0, 220.0, 5001)
    want, read = (each.branches_mm(bed_mm)[0] for each in (truth.homed().transmissions[0], got))
    assert np.abs(want - read).max() < 1e-6


def test_series_are_read_back_to_the_same_tables() -> None:
    drives = (branches(), Branches(40.0, 110.0, (0.0, 220.0)))
    tables = (drives[0].lower(ENDER3, 0), drives[1].lower(ENDER3, 1))
    model = saved_model(Mechanism(ENDER3, tables, Frame()), learner="greybox", branches=drives, findings=("fine",))
    again = parse_model(model_text(model), subject="text")
    read = branches_of(again, 0)
    assert read is not None
    assert np.abs(read.mean.cos_mm - drives[0].mean.cos_mm).max() < 1e-9
    assert np.abs(again.mechanism.transmissions[0].upper_mm - tables[0].upper_mm).max() < 1e-8
    assert again.document["motors"]["y"] == {"kind": "healthy"}
    assert not again.is_healthy
    assert again.findings == ("fine",)


def edited(**changes: object) -> str:
    """A whole model with some keys changed, digested anew: what a careful forger would write."""
    from printmend.model.model import _text

    document = json.loads(model_text(exact_model(HEALTHY.lower(ENDER3))))
    document.pop("digest")
    for name, value in changes.items():
        if value is None:
            document.pop(name)
        else:
            document[name] = value
    return _text(document)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("", "another kind of file"),
        ("x_mm,y_mm\n1,2\n", "another kind of file"),
        ('{\n "format": ', r"broken JSON \(line 2, column 12\)"),
        ('{"a":' * 100_000, "nesting|broken JSON"),
        ("[" * 100_000, "another kind of file|nesting|broken JSON"),
        ("[]", "another kind"),
        ("{}", "another kind"),
        (edited(version=3), "version 3"),
        (edited(version="1"), "version"),
        (edited(printer=None), "printer"),
        (edited(printer={"name": "x"}), "kinematics"),
        (edited(printer={"name": [None]}), "printer"),
        (edited(motors={}), "motors"),
        (edited(motors={"x": 1, "y": 2}), "section"),
        (edited(motors={"x": {"kind": "magic"}, "y": {"kind": "healthy"}}), "kind"),
        (edited(noise_mm="much"), "noise_mm"),
        (edited(noise_mm=-1.0), "noise_mm"),
        (edited(noise_mm=10**400), "noise_mm"),
        (edited(printer={"kinematics": "cartesian", "x": {**AXIS, "min_mm": -(10**400)}}), "min_mm"),
        (edited(printer={"kinematics": "cartesian", "x": {**AXIS, "mm_per_turn": 1e-300}}), "mm_per_turn"),
        (edited(findings=[1]), "findings"),
        (edited(diagnosis=7), "diagnosis as list"),
        (edited(diagnosis=[{"part": "z", "kind": "lead", "value": 1.0, "sd": 0.1}]), "unit as str"),
        (
            edited(diagnosis=[{"part": "z", "kind": "lead", "value": "1", "sd": 0.1, "unit": "%"}]),
            "a number .* for value",
        ),
        (edited(z={"lead": 1}), "lead as str"),
        (edited(trace={"measured": -4}), "for measured, found -4"),
        (edited(promise=7), "promise as dict"),
        (edited(promise={"instrument": {"scale_sd": True}}), "for scale_sd, found True"),
        (edited(promise={"parts": [{"effect": ["play"]}]}), "effect as str"),
        (edited(misfit={"found": 1}), "found as list"),
        (edited(misfit={"found": [{"kind": "unfit", "severity": "note"}]}), "words as str"),
        (edited(measurements=[7]), "an entry of measurements as str"),
        (edited(frame={"scale_mm": 100.0, "x_mm": [0.0], "y_mm": [0.0]}), "ten coefficients"),
        (edited().replace('"learner": "exact"', '"learner": "forged"'), "digest"),
        (edited().replace('"noise_mm": 0.0', '"noise_mm": NaN'), "NaN"),
    ],
)
def test_bad_models_end_in_one_line(text: str, names: str) -> None:
    with pytest.raises(ModelError, match=names) as caught:
        parse_model(text, subject="printer.mend.json")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "section",
    [
        {"lower_error_mm": [0.0, float("1e300")]},
        {"lower_error_mm": [0.0, -5.0]},
        {"lower_error_mm": [0.0]},
        {"lower_error_mm": "much"},
        {"lower_error_mm": [0, 10**400]},
        {"lower_error_mm": [0.0, True]},
        {"lower_error_mm": [0.0, 0.0], "upper_error_mm": [0.0, -1.0]},
        {"lower_error_mm": [0.0, 0.0], "pitch_mm": 0.0},
    ],
)
def test_bad_tables_end_in_one_line(section: dict) -> None:
    table = {"kind": "table", "first_mm": 0.0, "pitch_mm": 1.0, **section}
    with pytest.raises(ModelError):
        parse_model(edited(motors={"x": table, "y": {"kind": "healthy"}}), subject="printer.mend.json")


def test_missing_and_binary_files(tmp_path) -> None:
    with pytest.raises(ModelError, match="no such file"):
        read_model(tmp_path / "none.json")
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ModelError, match="UTF-8"):
        read_model(tmp_path / "binary.json")


def test_play_never_turns_negative() -> None:
    lower, upper = (t := branches(-0.3).lower(ENDER3, 0)).lower_mm, t.upper_mm
    assert (upper >= lower).all()


def test_powers_do_not_explode_beyond_what_was_seen() -> None:
    drive = Branches(40.0, 110.0, (90.0, 130.0), Wave(np.array([0.0, 0.0, 1.0])))
    mean, _ = drive.errors_mm(np.array([90.0, 0.0]))
    slope_per_mm = 2 * (-0.2) / 100
    assert mean[1] == pytest.approx(mean[0] + slope_per_mm * -90.0)
