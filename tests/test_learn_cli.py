"""`printmend learn` and `printmend export`, as a user calls them."""

import json
import re
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from printmend.cli.main import group, main
from printmend.cli.terminal import usual_language
from printmend.corruption import HEALTHY, Corruption, Drive, EccentricBore, Ellipse, LooseBelt, Play, WrongRadius
from printmend.corruption.frame import CrookedFrame
from printmend.errors import ConfigError, PrintmendError
from printmend.export.firmware import EXPORTS, simple_part
from printmend.learn.learned import learn_model
from printmend.machine import Mechanism
from printmend.measure import write_trace
from printmend.messages import ENGLISH, GERMAN
from printmend.model import exact_model, read_model, write_model
from printmend.model.model import NOTE, WARNING, Misfit
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.probe import design_probe
from printmend.twin import Twin
from printmend_lab.sampling import sample
from tests.mending import PLAY, SQUARE, coarsely, text_of

pytestmark = pytest.mark.usefixtures("once")
ENDER3 = read_printer("ender3")
PLAN = design_probe(ENDER3, marks=250)
BENT = Corruption((Drive(pulley=EccentricBore(0.21, 1.0), belt=Play(0.35)), Drive()))


def trace_file(folder: Path, corruption: Corruption, noise_mm: float = 0.05, seed: int = 0) -> Path:
    marks = Twin.of(corruption, ENDER3).follow(PLAN.waypoints_mm)[PLAN.rows]
    noise = np.random.default_rng(seed).normal(0, noise_mm, marks.shape)
    write_trace(folder / "trace.csv", PLAN.trace(marks + noise))
    return folder / "trace.csv"


def run(*args: object) -> Result:
    return CliRunner().invoke(group, [str(arg) for arg in args])


def test_results_and_errors_come_in_the_language_of_the_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for named, spoken in (({}, ENGLISH), ({"LANG": "de_AT.UTF-8"}, GERMAN), ({"LANG": "de", "LC_ALL": "C"}, ENGLISH)):
        assert usual_language(named) == spoken
    trace, model = trace_file(tmp_path, BENT), tmp_path / "m.json"
    done = run("--lang", "de", "learn", trace, "--printer", "ender3", "-o", model)
    assert done.exit_code == 0, done.exception
    assert "Spiel des Riemens 0," in done.output
    assert "Fehler vor der Korrektur: 0," in done.output
    assert not re.search(r"\b(the|before|points|written)\b", done.output)
    assert "belt play 0." in read_model(model).findings[0]  # a file is the same for every reader
    monkeypatch.setattr(
        "sys.argv", ["printmend", "--lang", "de", "learn", str(tmp_path / "absent.csv"), "--printer", "ender3"]
    )
    with pytest.raises(SystemExit, match="2"):
        main()
    assert capsys.readouterr().err.endswith("gefunden: keine solche Datei. Den Pfad prüfen\n")


def test_a_trace_without_any_error_is_learned(tmp_path: Path) -> None:
    """As exact machines make it: what an axis measures is what it was told, to the last digit."""
    at = np.vstack([[0.0, 0.0], np.random.default_rng(0).uniform(10, 210, (300, 2))])
    off = np.stack([0.3 * np.sin(2 * np.pi * at[:, 0] / 40), np.zeros(len(at))], axis=1)
    write_trace(tmp_path / "trace.csv", Trace(at, at + off, homed=True))
    done = run("learn", tmp_path / "trace.csv", "--printer", "ender3", "-o", tmp_path / "m.json")
    assert done.exit_code == 0, done.exception
    assert done.output.startswith("X pulley eccentric 0.3000")
    assert "; Y healthy" in done.output
    write_trace(tmp_path / "trace.csv", Trace(at, at, homed=True))  # repaired: nothing is shifted by 0.0000 mm
    done = run("learn", tmp_path / "trace.csv", "--update", tmp_path / "m.json", "-o", tmp_path / "now.json")
    assert "X healthy; Y healthy" in done.output, done.output


def test_says_what_is_wrong_and_how_sure_it_is(tmp_path: Path) -> None:
    path = tmp_path / "left Ender.json"
    done = run("learn", trace_file(tmp_path, BENT), "--printer", "ender3", "-o", path)
    assert done.exit_code == 0, done.output
    first, second, not_shown, tower, written, last = done.output.strip().splitlines()
    assert re.match(r"X (?=.*pulley eccentric 0\.2\d+ ± )(?=.*belt play 0\.3\d+ ± )", first)
    assert first.endswith("; Y healthy")
    assert float(second.split("scatters by ")[1].split()[0]) == pytest.approx(np.hypot(0.05, 0.05), rel=0.1)
    assert not_shown.startswith("Not shown by this trace: Z wobble")
    assert "tower" in tower
    assert written == f"Written: {path}"
    assert last == f"Next: printmend mend part.gcode -m '{path}' --report part.html"
    model = read_model(path)
    assert not model.is_healthy
    values = {fault["kind"]: fault for fault in model.document["diagnosis"]}
    assert values["harmonic-1"]["value"] == pytest.approx(0.21, abs=4 * values["harmonic-1"]["sd"])
    assert values["play"]["value"] == pytest.approx(0.35, abs=4 * values["play"]["sd"])


def test_json_is_for_programs(tmp_path: Path) -> None:
    path = trace_file(tmp_path, HEALTHY)
    done = run("learn", path, "--printer", "ender3", "-o", tmp_path / "m.json", "--json")
    value = json.loads(done.output)
    assert (value["healthy"], value["misfit"]) == (True, [])
    model = read_model(tmp_path / "m.json")
    assert value["digest"] == model.digest
    summary, of_z = value["findings"]
    assert summary == "X healthy; Y healthy"
    assert of_z.startswith("Z wobble")
    for severity, healthy in ((NOTE, True), (WARNING, False)):
        told = [asdict(Misfit("racking", severity, 0.05, 9.0, "the gantry racks"))]
        said = replace(model, document={**model.document, "misfit": {"found": told}}).summary
        assert (said["healthy"], said["misfit"]) == (healthy, told)
    assert value["trace"]["measured"] == len(PLAN)


def test_the_saved_machine_is_the_learned_one(tmp_path: Path, rng: np.random.Generator) -> None:
    drives = (Drive(pulley=EccentricBore(0.9, 1.0), belt=Play(0.6)), Drive())
    twin = Twin.of(Corruption(drives, CrookedFrame(skew_deg=1.0, x_wave_mm=0.3, x_wave_period_mm=120.0)), ENDER3)
    marks = twin.follow(PLAN.waypoints_mm)[PLAN.rows]
    marks += np.random.default_rng(5).normal(0, 0.01, marks.shape)
    trace = replace(PLAN.trace(marks), placed=True)  # else the end stops say where it is
    model = learn_model(trace, ENDER3, rng=np.random.default_rng(0))
    write_model(tmp_path / "m.json", model)
    learned, saved = model.mechanism, read_model(tmp_path / "m.json").mechanism
    for a, b in zip(learned.transmissions, saved.transmissions, strict=True):
        np.testing.assert_allclose(a.lower_mm, b.lower_mm, atol=1e-7)
        np.testing.assert_allclose(a.upper_mm, b.upper_mm, atol=1e-7)
    np.testing.assert_allclose(learned.frame.coefficients_mm, saved.frame.coefficients_mm, atol=1e-8)
    way = np.vstack([[ENDER3.home_mm], rng.uniform(30, 190, (300, 2))])
    off_mm = (Twin(saved).follow(way) - twin.follow(way))[1:]
    assert np.sqrt(np.square(off_mm).sum(axis=1).mean()) < 0.05  # of millimetres that marks are off


def test_a_scan_learns_its_place_from_the_end_stops() -> None:
    """To 0.024 mm on 200: of an oval pulley's scale of 1.4 % a hundredth may be the scanner's own stretch (0.13 %)."""
    fault = Corruption((Drive(pulley=EccentricBore(0.9, 1.0), belt=Play(0.6)), Drive(pulley=Ellipse(7.0, 5.9))))
    twin = Twin.of(fault, ENDER3)
    marks = twin.follow(PLAN.waypoints_mm)[PLAN.rows]
    middle = np.median(marks - PLAN.marks_mm, axis=0)  # what a scan cannot see
    model = learn_model(PLAN.trace(marks - middle), ENDER3, rng=np.random.default_rng(0))
    way = PLAN.waypoints_mm[::50]
    np.testing.assert_allclose(Twin(model.mechanism).follow(way), twin.follow(way), atol=0.024)


def test_a_table_says_where_a_belt_rests_in_its_play_even_where_home_was_not_measured() -> None:
    """Less what that homing may have done to it, which is all of the shift of a belt without play."""
    fault = Corruption((Drive(belt=Play(0.9)), Drive()))
    twin = Twin.of(fault, ENDER3)
    aside = np.array([0.3, -0.06])
    marks = twin.follow(PLAN.waypoints_mm)[PLAN.rows] + aside
    marks += np.random.default_rng(5).normal(0, 0.005, marks.shape)
    model = learn_model(replace(PLAN.trace(marks), placed=True), ENDER3, rng=np.random.default_rng(0))
    motor = np.linspace(30, 190, 9)
    for axis, (rests_mm, atol) in enumerate(((aside[0], 0.03), (aside[1] / 2, abs(aside[1]) / 2 + 0.01))):
        true, learnt = (m.transmissions[axis].branches_mm(motor) for m in (twin.mechanism.homed(), model.mechanism))
        np.testing.assert_allclose(np.array(learnt), np.array(true) + rests_mm, atol=atol)


def test_says_what_the_trace_could_not_tell(tmp_path: Path) -> None:
    way = np.tile([110.0, 110.0], (200, 1))
    way[:, 1] = np.concatenate([[0.0], np.linspace(5, 215, 199)])
    way[:, 0] = 110 + 8 * np.sin(np.arange(200))
    way[0] = 0.0
    printed = Twin.of(HEALTHY, ENDER3).follow(way)
    trace = tmp_path / "trace.csv"
    write_trace(trace, Trace(way, printed))
    output = run("learn", trace, "--printer", "ender3", "-o", tmp_path / "m.json").output
    assert "Y was measured moving forwards only" in output
    assert "X was seen on" in output
    assert "printmend probe" in output


def test_other_learners(tmp_path: Path) -> None:
    path = trace_file(tmp_path, sample("eccentric", np.random.default_rng(1)), 0.0)
    assert run("learn", path, "--printer", "ender3", "--learner", "naive", "-o", tmp_path / "n.json").exit_code == 0
    assert read_model(tmp_path / "n.json").is_healthy
    done = run("learn", path, "--printer", "ender3", "--learner", "crystal-ball")
    assert isinstance(done.exception, ConfigError)
    assert not (tmp_path / "printer.mend.json").exists()


def test_models_have_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`learn --name` keeps one, `printers` lists it, -m takes it; a file here of that name comes first."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.chdir(tmp_path)
    assert run("printers").output.startswith("No *.mend.json here or in ")
    path = trace_file(tmp_path, sample("eccentric", np.random.default_rng(1)), 0.0)
    arguments = ("learn", path, "--printer", "ender3", "--learner", "naive", "--name", "e3-07")
    kept = tmp_path / "config" / "printmend" / "models" / "e3-07.mend.json"
    assert f"Written: {kept}" in run(*arguments).output.splitlines()
    assert f"Written: {kept} (the old file is replaced)" in run(*arguments).output.splitlines()
    (tmp_path / "part.gcode").write_bytes(SQUARE)
    assert run("mend", "part.gcode", "-m", "e3-07").exit_code == 0
    (tmp_path / "other.mend.json").write_text("{}")
    (tmp_path / "exact.mend.json").write_text(text_of(PLAY))
    listed = [json.loads(line) for line in run("printers", "--json").output.splitlines()]
    assert [item["name"] for item in listed] == ["exact", "other", "e3-07"]
    assert "known exactly" in listed[0]["finding"]
    assert "expected" in listed[1]["error"]
    assert listed[2]["printer"] == ENDER3.name
    assert listed[2]["digest"] == read_model(kept).digest
    (tmp_path / "e3-07.mend.json").write_text("{}")
    assert isinstance(run("check", "part.gcode", "-m", "e3-07").exception, PrintmendError)
    assert run("learn", path, "--printer", "ender3", "--name", "../x").exit_code == 2


def test_bad_traces_write_nothing(tmp_path: Path) -> None:
    (tmp_path / "trace.csv").write_text("x_mm,y_mm,x_measured_mm,y_measured_mm\n0,0,0,0\n")
    done = run("learn", tmp_path / "trace.csv", "--printer", "ender3", "-o", tmp_path / "m.json")
    assert isinstance(done.exception, PrintmendError)
    assert "\n" not in str(done.exception)
    assert str(done.exception).startswith(f"{tmp_path / 'trace.csv'}: expected")
    assert not (tmp_path / "m.json").exists()


@pytest.fixture(scope="module")
def simple(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of a machine with nothing but scale, play and skew, known exactly."""
    path = tmp_path_factory.mktemp("model") / "m.json"
    write_model(path, exact_model(coarsely(SIMPLE)))
    return path


SIMPLE = Corruption(
    (Drive(pulley=WrongRadius(6.3), belt=Play(0.4)), Drive(belt=LooseBelt(0.1, 0.2))), CrookedFrame(skew_deg=0.5)
)


def test_the_simple_part_is_found() -> None:
    mechanism = SIMPLE.lower(ENDER3)
    assert isinstance(mechanism, Mechanism)
    part = simple_part(mechanism)
    assert part.gain[0] == pytest.approx(6.3 / ENDER3.x.radius_mm, abs=1e-6)
    assert part.gain[1] == pytest.approx(1.0, abs=1e-6)
    assert part.play_mm == pytest.approx((0.4, 0.3), abs=1e-6)
    assert part.skew == pytest.approx(np.tan(np.radians(0.5)), abs=1e-6)


@pytest.mark.parametrize(("firmware", "limit_mm"), [("klipper", 0.4), ("marlin", 0.005), ("rrf", 0.005)])
def test_firmware_takes_what_it_can(firmware: str, limit_mm: float) -> None:
    """With scale, skew and play only, a firmware that knows all three leaves nothing; Klipper leaves the play."""
    mechanism = SIMPLE.lower(ENDER3)
    assert isinstance(mechanism, Mechanism)
    export = EXPORTS[firmware](mechanism.homed())
    assert export.before_mm > 0.5
    assert export.after_mm < limit_mm
    assert export.after_mm > 0.1 or firmware != "klipper"


def test_linuxcnc_tables_hold_pulleys_and_play() -> None:
    mechanism = sample("pulley-loose", np.random.default_rng(4)).lower(ENDER3)
    assert isinstance(mechanism, Mechanism)
    export = EXPORTS["linuxcnc"](mechanism.homed())
    files = dict(export.files)
    rows = np.array([line.split() for line in files["joint0.comp"].splitlines()], float)
    assert rows.shape == (256, 3)
    assert (np.diff(rows[:, 0]) > 0).all()
    assert export.after_mm < 0.02 < export.before_mm


@pytest.mark.parametrize(
    ("firmware", "words"),
    [
        ("klipper", ["[stepper_x]", "rotation_distance: 39.58", "SET_SKEW XY="]),
        ("marlin", ["M92 X80.8", "M852 I0.0087", "M425 F1 X0.4000 Y0.3000", "; to undo now: M92 X80.0"]),
        ("rrf", ["M92 X80.8", "M556 S100 X-0.87", "M425 X0.4000 Y0.3000 S1"]),
        ("linuxcnc", ["COMP_FILE = joint0.comp", "COMP_FILE_TYPE = 0"]),
    ],
)
def test_export_prints_lines_and_what_remains(simple: Path, firmware: str, words: list[str]) -> None:
    done = run("export", "-m", simple, "--to", firmware)
    assert done.exit_code == 0, done.output
    for word in words:
        assert word in done.stdout
    assert len(done.stderr.strip().splitlines()) == 1 + (firmware == "klipper")
    assert "learn a new model" in done.stderr
    assert ("Klipper has no setting for backlash" in done.stderr) == (firmware == "klipper")


def test_export_writes_files(simple: Path, tmp_path: Path) -> None:
    done = run("export", "-m", simple, "--to", "linuxcnc", "-o", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["joint0.comp", "joint1.comp", "joints.ini"]
