"""Learning a Z screw from a table with heights beside the planar machine; saying, saving and updating it."""

import itertools
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.corruption import Corruption, Drive
from printmend.corruption.frame import CrookedFrame, Screw
from printmend.corruption.transmission import EccentricBore, Play
from printmend.diagnosis.named import find_lift
from printmend.effects import scene_of
from printmend.effects.sized import pushed_mm
from printmend.errors import TraceError
from printmend.infer.fit import fitted
from printmend.infer.machine import DRAWS
from printmend.infer.posterior import posterior_of
from printmend.learn.learned import Learned, learn, learn_model, report
from printmend.measure import read_trace
from printmend.measure.table import write_trace
from printmend.mend import check_gcode, mend_gcode
from printmend.mend.against import judge_gcode
from printmend.mend.history import read_history, remember_learned
from printmend.mend.update import believed, update
from printmend.model import SavedModel, screw_of, with_screw, write_model
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.report.examination import examine, summary
from printmend.report.examination_file import write_examination
from printmend.twin import Twin

ENDER3 = read_printer("ender3")
SHORT = replace(ENDER3, z=replace(ENDER3.z, max_mm=40.0))
SCREW = Screw(0.004, 0.06, 1.0, 0.25, 0.4, 0.12)
DRIVES = (Drive(pulley=EccentricBore(0.3, 1.2), belt=Play(0.3)), Drive(belt=Play(0.2)))
SOUND = (Drive(), Drive())
NOISE_MM = 0.03


def measured(
    screw: Screw | None,
    waypoints_mm: np.ndarray,
    *,
    noise_mm: float = NOISE_MM,
    heights: bool = True,
    seed: int = 1,
    frame: CrookedFrame | None = None,
    drives: tuple[Drive, ...] = DRIVES,
) -> Trace:
    """Print way-points [N, 3] after homing and measure them."""
    rng = np.random.default_rng(seed)
    path = np.concatenate([[[*SHORT.home_mm, SHORT.z.home_mm]], waypoints_mm])
    printed = Twin.of(Corruption(drives, frame, screw), SHORT).follow(path)
    seen = printed + rng.normal(0, noise_mm, printed.shape)
    return Trace(
        path[:, :2], seen[:, :2], z_mm=path[:, 2], z_measured_mm=seen[:, 2] if heights else None, homed=True,
    )  # fmt: skip


def body(layers: int = 16, pitch_mm: float = 1.15) -> np.ndarray:
    """A square with a cross, a hop, and a line back, on each layer."""
    ring = [[60, 60], [140, 60], [140, 140], [60, 140], [60, 60], [140, 140], [100, 100], [120, 80], [60, 60]]
    ways = [a + (b - a) * t for a, b in itertools.pairwise(np.array(ring, float)) for t in (0.5, 1.0)]
    rows = []
    for layer in range(layers):
        z = 0.2 + pitch_mm * layer
        rows += [(x, y, z) for x, y in ways] + [(60.0, 60.0, z + 0.4), (70.0, 60.0, z), (60.0, 60.0, z)]
    return np.array(rows)


def tower(layers: int = 20, pitch_mm: float = 0.9) -> np.ndarray:
    """What an owner measures by hand: the corners of a small tower, and the way down again."""
    corners = [(100.0, 100.0), (120.0, 100.0), (120.0, 120.0), (100.0, 120.0)]
    heights = [*range(layers), *range(layers - 3, layers - 9, -1)]
    return np.array([(x, y, 0.2 + pitch_mm * k) for k in heights for x, y in corners])


def learned(trace: Trace) -> SavedModel:
    return learn_model(trace, SHORT, rng=np.random.default_rng(0))


def errors_mm(model: SavedModel, screw: Screw) -> tuple[float, float]:
    """Return how far the learned heights, and the learned push, are from the true ones."""
    ours, truth = model.mechanism.screw, Corruption(screw=screw).lower(SHORT).homed().screw
    assert ours is not None
    assert truth is not None
    z_mm = np.linspace(0.5, 30, 300)
    branches = zip(ours.transmission.branches_mm(z_mm), truth.transmission.branches_mm(z_mm), strict=True)
    push = ours.wobble_at_mm(z_mm) - truth.wobble_at_mm(z_mm)
    return max(float(np.abs(a - b).max()) for a, b in branches), float(np.abs(push).max())


@pytest.fixture(scope="module")
def told() -> Learned:
    return learn(measured(SCREW, body()), SHORT, rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def bent(told: Learned) -> SavedModel:
    return told.saved


@pytest.fixture(scope="module")
def low() -> Learned:
    """Five layers of 1.15 mm: little more than half a turn of the screw."""
    return learn(measured(SCREW, body(5), drives=SOUND), SHORT, rng=np.random.default_rng(0))


def test_the_screw_is_found_beside_the_belts(bent: SavedModel) -> None:
    heights, push = errors_mm(bent, SCREW)
    assert heights < 0.025
    assert push < 0.01
    kinds = {(fault["part"], fault["kind"]): fault["value"] for fault in bent.document["diagnosis"]}
    assert kinds["z", "lead"] == pytest.approx(0.4, abs=0.08)
    assert kinds["z", "backlash"] == pytest.approx(0.12, abs=0.01)
    assert kinds["z", "wobble-1"] == pytest.approx(0.25, abs=0.01)
    assert kinds["x", "play"] == pytest.approx(0.3, abs=0.02)
    words = report(bent)
    assert re.search(r"X pulley eccentric 0\.(29|3)", words)
    for part in (
        "belt play 0.",
        "Z lead 0.4",
        "too long",
        "lifts unevenly by 0.0",
        "once a turn",
        "aside by 0.2",
    ):
        assert part in words


def test_without_noise_it_is_exact() -> None:
    model = learned(measured(SCREW, body(12, 1.4), noise_mm=0.0))
    assert max(errors_mm(model, SCREW)) < 0.003


def test_a_healthy_screw_is_healthy() -> None:
    model = learned(measured(None, body(12, 1.4), drives=SOUND))
    assert model.mechanism.screw is None
    assert "Z healthy" in model.findings[0]
    assert model.document["version"] == 1


def test_no_heights_no_lead() -> None:
    """Layers lying aside show the wobble; what they cannot show is said."""
    model = learned(measured(SCREW, body(), heights=False, drives=SOUND))
    assert errors_mm(model, replace(SCREW, lead_error=0.0, periodic_mm=0.0, backlash_mm=0.0))[1] < 0.01
    assert any("no heights were measured" in gap for gap in model.findings[1:])


def test_an_ordinary_print_says_nothing_of_z() -> None:
    silent = learned(measured(None, body(4), heights=False, drives=SOUND))
    assert "Z" not in silent.findings[0]
    (gap,) = (finding for finding in silent.findings if "Z" in finding)
    assert gap.startswith("Z wobble")


def test_half_a_turn_is_too_little(low: Learned) -> None:
    model = low.saved
    gaps = [gap for gap in model.findings[1:] if gap.startswith("Z ")]
    assert any("lead" in gap and "8 mm" in gap for gap in gaps)
    assert any("wobble" in gap for gap in gaps)
    assert screw_of(model) is None or not screw_of(model).push_mm.any()  # type: ignore[union-attr]
    assert "tower" in report(model).lower()


def test_whole_turns_show_one_angle_only() -> None:
    model = learned(measured(SCREW, body(4, 8.0), drives=SOUND))
    for kind in ("wobble", "unevenness"):
        assert any(f"Z {kind}: known only to" in gap for gap in model.findings[1:])


def test_a_tower_completes_a_planar_model(bent: SavedModel) -> None:
    flat, loose = body(1), (Drive(belt=Play(0.3)), DRIVES[1])  # the models below have a pulley's fault, too
    planar = learned(measured(SCREW, np.concatenate([flat, flat[::-1]] * 3), heights=False, drives=loose))
    assert planar.mechanism.screw is None
    done = update(planar, measured(SCREW, tower(), seed=2, drives=loose), rng=np.random.default_rng(0))
    heights, push = errors_mm(done.model, SCREW)
    assert heights < 0.06
    assert push < 0.035
    assert "Z wobble was 0.000" in done.words
    again = update(bent, measured(SCREW, tower(), seed=3), rng=np.random.default_rng(0))
    assert "Z " not in again.words
    heights, push = errors_mm(bent, SCREW)
    assert errors_mm(again.model, SCREW)[0] == pytest.approx(heights)  # the old one knew it better
    assert errors_mm(again.model, SCREW)[1] < push + 0.001
    other = replace(SCREW, wobble_phase_rad=2.0)
    turned = update(bent, measured(other, tower(), heights=False, seed=4), rng=np.random.default_rng(0))
    assert errors_mm(turned.model, other)[1] < 0.025


def test_a_bent_screw_is_no_change_of_healthy_axes_but_a_straight_one_is_one_of_the_screw() -> None:
    """A flat print shows no push, so a tower that does says nothing of X and Y; nor does a screw that was replaced."""
    flat = body(1)
    bow = replace(SCREW, wobble_mm=0.12)
    planar = learned(measured(None, np.concatenate([flat, flat[::-1]] * 3), heights=False, drives=SOUND))
    done = update(planar, measured(bow, tower(), seed=2, drives=SOUND), rng=np.random.default_rng(0))
    assert done.anew == ()
    assert believed(done.model).scene.bed_span_mm == believed(planar).scene.bed_span_mm
    straight = measured(replace(bow, wobble_mm=0.0), tower(), seed=3, drives=SOUND)
    assert update(done.model, straight, rng=np.random.default_rng(0)).anew == ()


def test_a_flat_print_leaves_the_screw_as_it_was(bent: SavedModel) -> None:
    done = update(bent, measured(SCREW, body(1), heights=False), rng=np.random.default_rng(0))
    (heights, push), (old_heights, _) = errors_mm(done.model, SCREW), errors_mm(bent, SCREW)
    assert heights == pytest.approx(old_heights, abs=0.001)
    assert push < 0.01  # as at first; it may say more of where X and Y lie
    assert "Z lead" in done.model.findings[0]


def test_heights_of_another_machine_are_refused() -> None:
    trace = measured(SCREW, body(3))
    assert trace.z_measured_mm is not None
    with pytest.raises(TraceError, match="z_measured_mm"):
        learned(replace(trace, z_measured_mm=trace.z_measured_mm * 254))


@pytest.mark.parametrize("kind", ["none", "mirrored", "shuffled", "layers"])
def test_heights_that_do_not_follow_are_refused(kind: str) -> None:
    trace = measured(SCREW, tower())
    height_mm = trace.z_measured_mm
    assert height_mm is not None
    shuffled = np.random.default_rng(0).permutation(height_mm)
    nonsense = {
        "none": np.zeros_like(height_mm),
        "mirrored": 20 - height_mm,
        "shuffled": shuffled,
        "layers": 5 * height_mm,
    }[kind]
    with pytest.raises(TraceError, match="follows z_mm"):
        find_lift(replace(trace, z_measured_mm=nonsense), SHORT)


@pytest.mark.parametrize("kind", ["a dial gauge", "one place"])
def test_heights_alone_complete_a_model_and_leave_x_and_y(bent: SavedModel, kind: str, tmp_path: Path) -> None:
    planar = with_screw(bent, None, findings=bent.findings[:1], details={"z": {}})
    trace = measured(SCREW, tower(), seed=5)
    if kind == "one place":
        trace = replace(trace, commanded_mm=np.full_like(trace.commanded_mm, 100.0), homed=False)
    else:
        trace = replace(trace, measured_mm=np.full_like(trace.measured_mm, np.nan))
    done = update(planar, trace, rng=np.random.default_rng(0))
    assert errors_mm(done.model, replace(SCREW, wobble_mm=0.0))[0] < 0.06
    for before, now in zip(planar.mechanism.transmissions, done.model.mechanism.transmissions, strict=True):
        assert np.array_equal(before.lower_mm, now.lower_mm)
        assert np.array_equal(before.upper_mm, now.upper_mm)
    assert "Z lead was 0.000" in done.words
    remember_learned(tmp_path / "printer.mend.json", done.model, "heights.csv", updated=True)
    (event,) = read_history(tmp_path / "printer.mend.json")
    assert "faults" not in event  # X and Y were not measured
    assert {each["part"] for each in event["heights"]} == {"z"}
    with pytest.raises(TraceError, match="three measured heights, each with its z_mm"):
        update(planar, replace(trace, z_mm=None), rng=np.random.default_rng(0))
    with pytest.raises(TraceError, match="at several places"):
        learn_model(trace, SHORT)


def test_the_owner_is_told_what_to_repair(told: Learned, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("printmend.report.examination.learn", lambda *_, **__: told)
    examination = examine(told.trace, SHORT, rng=np.random.default_rng(0))
    said = summary(examination)
    assert "The Z screw is bent" in said
    assert "The Z nut has play" in said
    assert "Z lead" in examination.saved.findings[0]


def test_an_owner_whose_tower_is_too_low_is_told_so(
    low: Learned, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("printmend.report.examination.learn", lambda *_, **__: low)
    examination = examine(low.trace, SHORT, rng=np.random.default_rng(0))
    assert not examination.saved.findings[0].rstrip().endswith(";")
    assert any(gap.startswith("Z lead") for gap in examination.saved.findings[1:])
    write_examination(tmp_path / "said.html", examination)
    assert "A tower of two turns" in (tmp_path / "said.html").read_text()


def test_the_table_keeps_heights(tmp_path: Path) -> None:
    trace = measured(SCREW, body(3))
    write_trace(tmp_path / "t.csv", trace)
    again = read_trace(tmp_path / "t.csv", SHORT)
    assert again.z_measured_mm == pytest.approx(trace.z_measured_mm, abs=1e-6)


def test_the_whole_chain_by_commands(bent: SavedModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """twin → learn → mend → twin: what the broken printer does with the mended file is what was wanted."""
    monkeypatch.chdir(tmp_path)
    lines = ["G21", "G90", "M83", "G28"]
    for layer in range(30):
        z = 0.2 + 0.6 * layer
        lines += [f"G1 Z{z:.2f} F600", "G1 X60 Y60 F6000", "G1 X80 Y60 E1 F1800", "G1 X80 Y80 E1", f"G1 Z{z + 0.4:.2f}"]
        lines += ["G0 X60 Y80 F6000", f"G1 Z{z:.2f}", "G1 X60 Y60 E1 F1800"]
    Path("part.gcode").write_text("\n".join(lines) + "\n")
    Path("broken.toml").write_text(
        "[x.pulley]\nkind = 'eccentric'\neccentricity_mm = 0.3\nphase_rad = 1.2\n[x.belt]\nkind = 'play'\n"
        "play_mm = 0.3\n[y.belt]\nkind = 'play'\nplay_mm = 0.2\n[z.screw]\nlead_error = 0.004\nperiodic_mm = 0.06\n"
        "periodic_phase_rad = 1.0\nwobble_mm = 0.25\nwobble_phase_rad = 0.4\nbacklash_mm = 0.12\n"
    )
    write_model("printer.mend.json", bent)

    def run(*arguments: str) -> str:
        result = CliRunner().invoke(group, arguments, catch_exceptions=False)
        assert result.exit_code == 0, result.output
        return result.output

    said = run("mend", "part.gcode", "-m", "printer.mend.json")
    assert "in height" in said
    assert "in height" in run("check", "part.gcode", "-m", "printer.mend.json", "--against", "part.mended.gcode")
    run(
        "twin",
        "part.mended.gcode",
        "--printer",
        "ender3",
        "--corruption",
        "broken.toml",
        "--noise-mm",
        "0",
        "-o",
        "t.csv",
    )
    run("twin", "part.gcode", "--printer", "ender3", "--corruption", "broken.toml", "--noise-mm", "0", "-o", "raw.csv")
    corners = np.array([(x, y, 0.2 + 0.6 * layer) for layer in range(30) for x, y in ((60, 60), (80, 60), (80, 80))])
    for name, low, high in (("t.csv", 0.0, 0.04), ("raw.csv", 0.3, 9.0)):
        trace = read_trace(name, ENDER3)
        assert trace.z_measured_mm is not None
        printed = np.column_stack([trace.measured_mm, trace.z_measured_mm])
        off = np.array([np.linalg.norm(printed - corner, axis=1).min() for corner in corners])
        assert low <= off.max() <= high


def test_the_doubt_of_the_push_is_in_the_promise(bent: SavedModel, tmp_path: Path) -> None:
    part, mended = tmp_path / "vase.gcode", tmp_path / "out.gcode"
    lines = [
        f"G1 X{110 + 10 * np.cos(t):.3f} Y{110 + 8 * np.sin(t):.3f} Z{0.2 + 1.1 * np.floor(t / 6.2832):.3f} E0.05"
        for t in np.linspace(0, 20 * np.pi, 300)
    ]
    part.write_text("\n".join(["G21", "G90", "M83", "G28", "G1 Z0.2 F600", "G0 X120 Y110 F6000", *lines, ""]))
    done = mend_gcode(part, bent, mended)
    truth = judge_gcode(part, mended, Twin.of(Corruption(DRIVES, screw=SCREW), SHORT)).after
    after = done.prediction.after
    assert 0.5 * after.rms_low_mm < truth.rms_mm < after.rms_high_mm
    promise = bent.document["promise"]
    known = [each for each in promise["parts"] if each["effect"] != "wobble"]
    sure = replace(bent, document={**bent.document, "promise": {**promise, "parts": known}})
    assert check_gcode(part, sure).after.made_of["parameters"] < after.made_of["parameters"]


def test_drawn_screws_push_as_their_doubt_says(rng: np.random.Generator) -> None:
    """Roughly measured towers: the true push lies within the drawn machines' 90 % ranges, about as often."""
    at, inside = np.linspace(1.0, 14.0, 5), []
    points = np.concatenate([[[*SHORT.home_mm, 0.0]], tower(14)])
    for _ in range(12):
        screw = Screw(wobble_mm=float(rng.uniform(0.15, 0.4)), wobble_phase_rad=float(rng.uniform(0, 6)))
        truth = Corruption(screw=screw).lower(SHORT).homed().screw
        assert truth is not None
        seen = points[:, :2] + truth.wobble_at_mm(points[:, 2]) + rng.normal(0, 0.1, (len(points), 2))
        trace = Trace(points[:, :2], seen, z_mm=points[:, 2], homed=True)
        scene = scene_of(trace, SHORT)
        posterior = posterior_of(fitted(trace, scene, names=("wobble", "layer", "place")), rng)
        drawn = [
            pushed_mm(scene, [part.acting().of(sizes_mm=part.draws_mm[:, draw])], at)
            - pushed_mm(scene, [part.acting().of(sizes_mm=part.draws_mm[:, draw])], np.zeros(1))
            for part in posterior.parts if part.effect == "wobble" for draw in range(DRAWS)
        ]  # fmt: skip
        both = np.reshape(drawn, (2, DRAWS, len(at), 2)).sum(axis=0)
        low, high = np.quantile(both, (0.05, 0.95), axis=0)
        true_mm = truth.wobble_at_mm(at)
        inside.append(np.mean((low < true_mm) & (true_mm < high)))
    assert 0.75 <= np.mean(inside) <= 0.99
