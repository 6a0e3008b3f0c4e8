"""Whose scale it is: the machine's or the filament's. Laws of `filament` and of models that know filaments."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from printmend.cli.learn import command
from printmend.cli.twin import command as twin
from printmend.effects import scene_of
from printmend.effects.effect import SCALE_MM
from printmend.errors import ConfigError, ModelError, RefusedError
from printmend.export.supported import export_supported
from printmend.filament import UNNAMED, material_of
from printmend.infer.machine import Sized, machine_of
from printmend.learn.learned import learn_model
from printmend.machine import healthy_mechanism
from printmend.measure import read_trace, write_trace
from printmend.mend.filament import learn_in, parse_travel, printed_in, shrunk, update_in
from printmend.mend.prediction import answer_to
from printmend.messages import is_one_of
from printmend.model import SavedModel, model_text, parse_model
from printmend.path import Instrument, Trace
from printmend.printer import Printer, read_printer
from printmend.promise.belief import parse_belief
from printmend.promise.filament import CLAIM_SD, UNTOLD, Entry, known_filaments, parse_entries, scale_cause, split
from printmend.promise.words import axis_scales
from printmend.report.examination import examine
from printmend.twin import Twin

pytestmark = pytest.mark.usefixtures("once")
MACHINE = np.array([0.25, -0.1]) / 100
SHRINKS = {"pla-black": np.array([0.45, 0.3]) / 100, "abs": np.array([0.7, 0.5]) / 100, None: np.zeros(2)}
NOISE_MM = 0.02
EXACT = Instrument(scale_sd=0.0001, axes_sd=0.0001, lean_sd=0.0001)


def measured(printer: Printer, filament: str | None, seed: int) -> Trace:
    """Return a walk over the bed by a machine with a scale and play, once it has shrunk."""
    rng = np.random.default_rng(seed)
    far = rng.uniform(30, 190, (50, 1, 2))
    path = np.vstack([printer.home_mm, (far + rng.uniform(-4, 4, (1, 3, 2))).reshape(-1, 2)])
    scene = scene_of(Trace(path, path, homed=True), printer, (40.0, 40.0))
    sizes = [Sized("scale", axis, (), 100 * MACHINE[[axis]]) for axis in range(2)]
    if printer.kinematics == "corexy":
        both = [Sized("scale", motor, (), np.array([100 * MACHINE.mean()])) for motor in range(2)]
        sizes = [*both, Sized("aspect", 0, (), np.array([100 * (MACHINE[0] - MACHINE[1])]))]
    machine, _ = machine_of(scene, [*sizes, Sized("play", 0, (), np.array([0.2]))])
    middle = np.array(printer.middle_mm[:2])
    printed = middle + (Twin(machine).follow(path) - middle) * (1 - SHRINKS[filament])
    noisy = printed + rng.normal(0, NOISE_MM, path.shape) + [3.0, 1.0]
    return Trace(path, noisy, homed=True, placed=False, instrument=EXACT)


@pytest.fixture(scope="module")
def one() -> SavedModel:
    printer = read_printer("ender3")
    return learn_in(measured(printer, "pla-black", 1), printer, "pla-black")


@pytest.fixture(scope="module")
def one_corexy() -> SavedModel:
    printer = read_printer("corexy")
    return learn_in(measured(printer, "pla-black", 1), printer, "pla-black")


def own_scale(model: SavedModel) -> np.ndarray:
    """Return the machine's scale along X and Y that acts, as shares."""
    belief = parse_belief(model)
    assert belief is not None
    return axis_scales(belief.scene, belief.parts)[0]


def test_one_filament_claims_nothing_and_exports_nothing(one):
    assert not own_scale(one).any()
    assert any(is_one_of(gap, UNTOLD) and "pla-black" in gap for gap in one.findings)
    with pytest.raises(RefusedError, match="from the machine or from the filament"):
        export_supported(one, "klipper")


def test_a_part_shrinks_though_nobody_names_its_filament():
    """Walls are those of a part: its scale is neither taken for the machine's nor exported."""
    printer, angle = read_printer("ender3"), np.random.default_rng(5).uniform(0, 2 * np.pi, 151)
    shown, normal = measured(printer, "pla-black", 1), np.column_stack([np.cos(angle), np.sin(angle)])
    off_mm = np.sum((shown.measured_mm - shown.commanded_mm) * normal, axis=1)
    walls = replace(shown, measured_mm=np.full_like(normal, np.nan), normal=normal, offset_mm=off_mm)
    model = learn_in(walls, printer, None)
    assert not own_scale(model).any()
    assert any(is_one_of(gap, UNTOLD) for gap in model.findings)
    with pytest.raises(RefusedError, match="from the machine or from the filament"):
        export_supported(model, "klipper")
    truth = MACHINE - SHRINKS["pla-black"]
    assert np.allclose([-part.acts_mm[0] for part in known_filaments(model)[UNNAMED]], SCALE_MM * truth, atol=0.05)
    assert scale_cause(model) == "filament"  # to name it would narrow more than another distance would
    assert "--filament" in str(answer_to(model, scale_cause(model)))
    doubted = replace(walls, instrument=Instrument(scale_sd=0.02), placed=False)
    assert scale_cause(learn_in(doubted, printer, None)) == "instrument"


def test_what_is_printed_in_the_filament_is_mended_all_the_same(one):
    truth = MACHINE - SHRINKS["pla-black"]
    away = np.array([[60.0, 60.0], [160.0, 160.0]])
    inside, plain = (each.mechanism.frame.apply(away) for each in (printed_in(one, "pla-black"), one))
    assert np.allclose((np.diff(inside, axis=0) / np.diff(plain, axis=0))[0] - 1, truth, atol=4e-4)


def test_a_print_that_cannot_shrink_tells_them_apart(one_corexy):
    one = one_corexy
    again = update_in(one, measured(one.printer, None, 2), None, rng=np.random.default_rng(0))
    assert np.allclose(own_scale(again.model), MACHINE, atol=5e-4)
    known = again.model.document["filaments"]["known"]["pla-black"]
    shrinks = np.array([known[axis]["acts"] for axis in "xy"]) / SCALE_MM
    assert np.allclose(shrinks, SHRINKS["pla-black"], atol=5e-4)
    assert not any(is_one_of(gap, UNTOLD) for gap in again.model.findings)


def test_a_rule_on_the_travel_tells_two_filaments_apart(one):
    rng = np.random.default_rng(0)
    two = update_in(one, measured(one.printer, "abs", 3), "abs", rng=rng).model
    assert not own_scale(two).any()
    rules = [parse_travel(f"{axis}=200:{200 * (1 + scale):.2f}") for axis, scale in zip("xy", MACHINE, strict=True)]
    told = update_in(two, None, None, rules, rng=rng).model
    assert np.allclose(own_scale(told), MACHINE, atol=5e-4)
    for name in ("pla-black", "abs"):
        known = told.document["filaments"]["known"][name]
        shrinks = np.array([known[axis]["acts"] for axis in "xy"]) / SCALE_MM
        assert np.allclose(shrinks, SHRINKS[name], atol=5e-4)
    assert "rotation_distance" in dict(export_supported(told, "klipper").files)["klipper.cfg"]
    read = parse_model(model_text(told), subject="model")
    assert read.digest == told.digest
    assert printed_in(read, "abs").document == read.document


def test_without_a_filament_all_is_as_before():
    printer = read_printer("ender3")
    trace = measured(printer, None, 4)
    plain = learn_model(trace, printer)
    assert learn_in(trace, printer, None).document == plain.document
    assert "filaments" not in plain.document


def test_a_pulley_of_another_size_is_no_filaments():
    entry = Entry("pla", (-0.05, -0.05), (0.0002, 0.0002))
    assert abs(split([entry], 0).mean + 0.047) < 0.002


def test_more_prints_in_one_filament_tell_nothing_new():
    entry = Entry("pla", (-0.003, -0.003), (0.0001, 0.0001))
    once, often = split([entry], 0), split([entry] * 9, 0)
    assert once.sd == pytest.approx(often.sd, rel=0.05)
    assert not often.is_told
    assert split([entry, Entry(None, (0.001, np.nan), (0.0002, 1.0), "rule")], 0).sd < CLAIM_SD


def test_a_shrunk_machine_is_smaller_about_the_middle():
    machine = healthy_mechanism(read_printer("ender3"))
    middle = np.array(machine.printer.middle_mm[:2])
    places = middle + np.random.default_rng(0).uniform(-90, 90, (20, 2))
    share = np.array([0.01, 0.002])
    assert np.allclose(shrunk(machine, share).frame.apply(places) - middle, (places - middle) * (1 - share))


@pytest.mark.parametrize(
    ("name", "polymer"), [("PLA+", "pla"), ("pa6-cf", "pa"), ("nylon", "pa"), ("petg_blue", "petg")]
)
def test_a_name_begins_with_its_polymer(name, polymer):
    assert material_of(name).polymer == polymer


@pytest.mark.parametrize("name", ["", "wood", "pla black", "../pla", "x" * 50])
def test_other_names_are_refused(name):
    with pytest.raises(ConfigError, match="begins with its polymer"):
        material_of(name)


@pytest.mark.parametrize("text", ["", "z=200:199", "x=200", "x=10:10", "x=200:300", "x=nan:1"])
def test_travels_that_are_none_are_refused(text):
    with pytest.raises(ConfigError, match="how far"):
        parse_travel(text)


def test_a_filament_that_was_never_measured_is_refused(one):
    with pytest.raises(ModelError, match="pla-black"):
        printed_in(one, "petg-red")


MEASURED = [1, [3], [{"kind": "x"}], [{"kind": "print", "filament": "wood"}], [{"kind": "rule", "x": 1}]]
KNOWN = [[], {"wood": {}}, {"pla": {"x": {"acts": 1, "draws": [1]}}}, {"pla": 2}]


@pytest.mark.parametrize(
    "section", [3, *({"measured": each, "known": {}} for each in MEASURED), *({"known": each} for each in KNOWN)]
)
def test_a_section_that_is_none_of_ours_is_refused(section):
    model = SavedModel(healthy_mechanism(read_printer("ender3")), "test", "0", {"filaments": section})
    read = known_filaments if isinstance(section, dict) and "measured" not in section else parse_entries
    with pytest.raises(ModelError, match="filaments"):
        read(model)


def test_a_table_counts_once_whatever_filament_it_is_said_to_be_of(one):
    again = update_in(one, measured(one.printer, "pla-black", 1), "abs", rng=np.random.default_rng(0))
    assert again.is_known


def test_heights_alone_say_nothing_of_a_scale(one):
    places, heights = np.full((30, 2), 100.0), np.linspace(0.2, 20.0, 30)
    tower = Trace(places, np.full_like(places, np.nan), z_mm=heights, z_measured_mm=1.004 * heights)
    done = update_in(one, tower, None, rng=np.random.default_rng(0))
    assert done.changes
    assert parse_entries(done.model) == parse_entries(one)


def test_the_command_line_says_what_is_known(tmp_path):
    printer = read_printer("ender3")
    write_trace(tmp_path / "a.csv", measured(printer, "pla-black", 1))
    out = tmp_path / "p.mend.json"
    run = CliRunner().invoke(
        command, [str(tmp_path / "a.csv"), "--printer", "ender3", "--filament", "pla-black", "-o", str(out)]
    )
    assert run.exit_code == 0, run.output
    assert "from the machine or from the filament" in run.output
    assert "--filament pla-black" in run.output
    ruled = ["--update", str(out), "--travel", "x=200:200.5", "--travel", "y=200:199.8"]
    told = CliRunner().invoke(command, ruled)
    assert told.exit_code == 0, told.output
    assert "Nothing changed" not in told.output
    assert "ettled by the rule: the scale of X and Y" in told.output
    assert re.search(r"The machine's own scale: \+0\.2. ± 0\.02 % in X and -?−?0\.1", told.output)
    assert json.loads(out.read_text())["filaments"]["measured"][1]["kind"] == "rule"
    for bad in (["--filament", "wood"], ["--travel", "x=1:1"], ["--travel", "x=200.5:200"]):
        wrong = CliRunner().invoke(command, [*ruled, *bad])
        assert isinstance(wrong.exception, ConfigError)


def test_diagnose_says_whose_the_scale_is():
    printer = read_printer("ender3")
    trace = measured(printer, "pla-black", 1)
    found = examine(trace, printer, filament="pla-black", rng=np.random.default_rng(0))
    assert any(is_one_of(gap, UNTOLD) for gap in found.gaps)
    assert not any("%" in advice.title for advice in found.advice)


def test_the_twin_shrinks_about_the_middle_of_its_bed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "healthy.toml").write_text("")
    walk = [f"G1 X{x} Y{y} E1" for x in (60, 110, 160) for y in (60, 100, 160, 120)]
    (tmp_path / "part.gcode").write_text("\n".join(["G28", "G90", "M83", "G1 Z0.2", *walk]))
    arguments = ["part.gcode", "--printer", "ender3", "--corruption", "healthy.toml", "--noise-mm", "0"]
    traces = []
    for more in ([], [f"--corruption=shrinkage:on={axis},percent={by}" for axis, by in (("x", 1), ("y", 0.5))]):
        done = CliRunner().invoke(twin, [*arguments, *more])
        assert done.exit_code == 0, done.output
        traces.append(read_trace(tmp_path / "trace.csv", read_printer("ender3")).measured_mm)
    plain, small = traces
    known = np.isfinite(plain).all(axis=1)
    middle = np.array(read_printer("ender3").middle_mm[:2])
    assert np.allclose(small[known] - middle, (plain[known] - middle) * [0.99, 0.995], atol=1e-4)
