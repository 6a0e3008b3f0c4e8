"""Mending a bent Z screw: heights through the inverse of the screw, x and y against where it pushes the nozzle."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from printmend.corruption import HEALTHY, Corruption, Drive
from printmend.corruption.frame import Screw
from printmend.corruption.transmission import EccentricBore, Play
from printmend.errors import ModelError
from printmend.machine import Mechanism
from printmend.mend import check_gcode, mend_gcode
from printmend.mend.against import judged
from printmend.model import ScrewSeries, exact_model, model_text, parse_model, read_model, with_screw, write_model
from printmend.plan import is_identity, lookup, start
from printmend.plan.kernels import height as kernels
from printmend.plan.kernels.lookup import LOWER, UPPER, backward, forward
from printmend.plan.kernels.travel import arriving_push
from tests import naive_mend
from tests.mending import COREXY, ENDER3, START, Judged, judge, mended

SCREW = Screw(0.004, 0.06, 1.0, 0.25, 0.4, 0.12)
SHORT, SHORT_COREXY = (replace(printer, z=replace(printer.z, max_mm=20.0)) for printer in (ENDER3, COREXY))
BENT_SCREW = Corruption(screw=SCREW).lower(SHORT).homed()
DRIVES = (Drive(pulley=EccentricBore(0.5, 1.0), belt=Play(0.4)), Drive(pulley=EccentricBore(0.3), belt=Play(0.6)))
ALL = Corruption(DRIVES, screw=SCREW).lower(SHORT).homed()
NEAR_MM = 0.01


def tower(layers: int = 10, *, relative: bool = False) -> bytes:
    """Squares on top of each other, with a z-hop in each layer, up and down."""
    lines = ["G21", "G90", "M83", "G28"]
    for layer in range(layers):
        z = 0.2 + 0.8 * layer
        up, down = f"G1 Z{z + 0.4:.2f} F600", f"G1 Z{z:.2f} F600"
        if relative:
            up, down = "G91\nG1 Z0.4 F600\nG90", "G91\nG1 Z-0.4\nG90"
        lines += [f"G1 Z{z:.2f} F600", "G1 X60 Y60 F6000", "G1 X80 Y60 E1 F1800", "G1 X80 Y80 E1", "G1 E-1 F2400"]
        lines += [up, "G0 X60 Y80 F6000", down, "G1 E1 F2400", "G1 X60 Y60 E1 F1800"]
    return "\n".join(lines).encode() + b"\n"


def spiral(turns: int = 8) -> bytes:
    """A cylinder in vase mode, then a line that climbs a whole lead at once, and comes down again."""
    angles = np.linspace(0, 2 * np.pi * turns, 48 * turns)
    rows = [
        f"G1 X{100 + 20 * math.cos(a):.3f} Y{100 + 20 * math.sin(a):.3f} Z{0.2 + 0.3 * a / (2 * np.pi):.4f} E0.1"
        for a in angles
    ]
    rows += ["G1 X160 Y120 Z10 E3", "G1 X100 Y130 Z4 E3"]
    return START + b"G1 X120 Y100 F6000\nG1 F1800\n" + "\n".join(rows).encode() + b"\n"


def height_errors_mm(result: Judged, mechanism: Mechanism) -> np.ndarray:
    """Return how far each drawing move ends from the height that the file wants after as much filament."""
    wanted = [move for move in result.wanted if move.draws]
    fed = np.cumsum([move.filament for move in wanted])
    total, errors = 0.0, []
    for move, height in zip(result.given, naive_mend.lift_moves(result.given, mechanism), strict=True):
        if move.draws:
            total += move.filament
            i = min(int(np.searchsorted(fed, total - 1e-6)), len(fed) - 1)
            part = 1 - (fed[i] - total) / wanted[i].filament
            errors.append(height - wanted[i].start[2] - part * (wanted[i].end[2] - wanted[i].start[2]))
    return np.array(errors)


@pytest.mark.parametrize("mechanism", [BENT_SCREW, ALL], ids=["screw", "belts and screw"])
@pytest.mark.parametrize("text", [tower(), tower(relative=True), spiral()], ids=["hops", "relative hops", "spiral"])
def test_the_broken_printer_prints_what_was_wanted(text: bytes, mechanism: Mechanism) -> None:
    result = judge(text, mechanism)
    assert naive_mend.rms(result.before) > 0.15
    assert result.after.max() < NEAR_MM
    assert result.rms_mm < 0.002
    assert np.abs(height_errors_mm(result, mechanism)).max() < NEAR_MM / 2
    assert result.prediction.heights is not None
    before, after = result.prediction.heights
    assert before.rms_mm > 0.05
    assert after.max_mm < NEAR_MM / 2
    assert result.prediction.after.rms_mm == pytest.approx(result.rms_mm, abs=0.001)


@pytest.mark.parametrize(
    "text",
    [
        b"G21\nG90\nM83\nG28\nG1 Z0.3 F600\nG0 X60 Y60 F6000\nG2 X80 Y60 I10 J0 E2 F1800\nG3 X60 Y60 Z3 I-10 J0 E2\n",
        b"G20\nG90\nM83\nG28\nG1 Z0.02 F20\nG0 X3 Y3 F200\nG1 X4 Y3 E0.1 F60\nG92 Z0\nG1 Z0.1\nG1 X4 Y4 E0.1\n",
        b"G21\nG90\nM83\nG28\nG1 Z5 F600\nG1 X60 Y60\nG92 Z1\nG1 Z2\nG1 X80 Y60 E1\nG28 Z\nG1 Z3\nG1 X60 E1\n",
    ],
    ids=["arcs", "inches and G92", "G92 and homing Z"],
)
def test_states_of_the_file(text: bytes) -> None:
    result = judge(text, ALL)
    assert result.after.max() < NEAR_MM
    assert result.prediction.after.max_mm < NEAR_MM


def test_an_upright_arc_becomes_lines() -> None:
    text = START + b"G1 X60 Y60\nG18\nG2 X80 Z0.2 I10 K0 E2 F1800\nG17\n"
    written, prediction = mended(text, ALL)
    assert written.count(b"\nG1 X") > 60
    assert b"K" not in written
    assert prediction.after.max_mm < NEAR_MM


def test_a_travel_that_rises_and_comes_down_is_followed_at_its_end_alone() -> None:
    """x and y stand while Z hops: the push of the height between is nobody's concern."""
    legs = [(82, 61), (84, 60), (86, 61), (88, 60), (90, 62)]
    hop = [b"G1 Z1.6 F600", *(b"G0 X%d Y%d F6000" % leg for leg in legs), b"G1 Z0.2 F600"]
    text = START + b"\n".join([b"G1 X80 Y60 E1 F1800", *hop, b"G1 X70 Y62 E1 F1800", b"G1 X70 Y70 E1"]) + b"\n"
    result = judge(text, ALL)
    assert result.after.max() <= NEAR_MM
    risen = [move for move in result.given if move.start[2] != move.end[2] and not move.homing][1:]
    assert len(risen) == 2
    assert all(math.dist(move.start[:2], move.end[:2]) < 0.003 for move in risen)
    travelled = [
        sum(math.dist(m.start[:2], m.end[:2]) for m in moves if not m.draws) for moves in (result.wanted, result.given)
    ]
    assert travelled[1] - travelled[0] < 2.4  # 5.2 where each leg is followed


def test_a_corexy_too() -> None:
    result = judge(tower(), Corruption(DRIVES, screw=SCREW).lower(SHORT_COREXY).homed())
    assert result.after.max() < NEAR_MM


def test_a_healthy_screw_leaves_every_byte() -> None:
    healthy = Corruption(screw=Screw()).lower(SHORT).homed()
    assert is_identity(healthy)
    for text in (tower(), spiral()):
        assert mended(text, healthy)[0] == text


def test_a_bad_screw_leaves_what_has_no_place() -> None:
    """Before homing nobody knows the height: nothing is touched."""
    text = b"G21\nG91\nM83\nG1 Z5 F600\nM104 S200 ; heat\nG1 Z-2\n"
    assert mended(text, BENT_SCREW)[0] == text


def test_no_nozzle_goes_below_what_was_wanted() -> None:
    """Taking up the slack never drives the nozzle into the print, wherever the nut was before."""
    text = tower(6).replace(b"G1 Z1.00 F600\n", b"M600\nG1 Z1.00 F600\n")
    result = judge(text, BENT_SCREW)
    lifted = naive_mend.lift_moves(result.given, BENT_SCREW)
    wanted = [move.end[2] for move in result.wanted if move.draws]
    for move, height in zip(result.given, lifted, strict=True):
        if move.draws:
            assert min(abs(height - z) for z in wanted) < NEAR_MM
        if not move.homing and move.end[2] > 1.0:
            assert height > 0.99


def test_kernels_are_the_inverse_of_the_screw() -> None:
    model = lookup(BENT_SCREW)
    assert BENT_SCREW.screw is not None
    table = BENT_SCREW.screw.transmission
    grid, wobble = table.motor_mm, BENT_SCREW.screw.wobble_mm
    for m in np.random.default_rng(1).uniform(0, 19, 200):
        for branch, values in ((LOWER, table.lower_mm), (UPPER, table.upper_mm)):
            height = forward(model, kernels.ZED, branch, m)
            assert height == pytest.approx(np.interp(m, grid, values), abs=1e-9)
            assert backward(model, kernels.ZED, branch, height) == pytest.approx(m, abs=1e-9)
        assert kernels.push(model, m) == pytest.approx([np.interp(m, grid, wobble[:, i]) for i in range(2)], abs=1e-12)


def test_the_nut_follows_as_the_slow_version_says() -> None:
    model, state, counts = lookup(BENT_SCREW), start(BENT_SCREW).state, start(BENT_SCREW).counts
    counts.height = 1
    heights = np.random.default_rng(2).uniform(0.0, 3.0, 300)
    moves = [naive_mend.Move((0, 0, a), (0, 0, b), 0.0, 0.0, 0) for a, b in zip([0.0, *heights], heights, strict=False)]
    assert [kernels.lift_raw(model, state, counts, z)[2] for z in heights] == pytest.approx(
        naive_mend.lift_moves(moves, BENT_SCREW), abs=1e-9
    )


def test_the_push_at_the_end_of_a_travel_is_what_the_slow_version_says() -> None:
    from tests.naive_travel import arriving_push_mm

    model, state = lookup(BENT_SCREW), start(BENT_SCREW).state
    rng = np.random.default_rng(6)
    for motor, z, way in zip(rng.uniform(0, 19, 300), rng.uniform(0, 19, 300), rng.integers(-1, 2, 300), strict=True):
        state.mended.m[kernels.ZED] = motor
        wanted = arriving_push_mm(BENT_SCREW, motor, z, float(way))
        assert arriving_push(model, state, z, float(way)) == pytest.approx(wanted, abs=1e-9)


def test_a_saved_series_is_the_screw_again(tmp_path: Path) -> None:
    series = ScrewSeries(
        8.0, 0.004, 0.12, np.array([0.03, 0.05, 0.0, 0.02]), np.array([[0.2, 0.0], [0.1, 0.2], [0.0, 0.01], [0, 0]])
    )
    healthy = HEALTHY.lower(SHORT).homed()
    model = with_screw(exact_model(healthy), series, findings=("a screw",), details={})
    write_model(tmp_path / "m.json", model)
    assert (tmp_path / "m.json").stat().st_size < 4000
    again = read_model(tmp_path / "m.json")
    assert not again.is_healthy
    ours, theirs = series.lower(SHORT), again.mechanism.screw
    assert theirs is not None
    assert np.abs(ours.transmission.lower_mm - theirs.transmission.lower_mm).max() < 1e-6
    assert np.array_equal(ours.wobble_mm, theirs.wobble_mm)
    assert theirs.wobble_at_mm(np.array([0.0])) == pytest.approx(0.0, abs=1e-12)  # at home it is at home


def test_saved_tables_are_the_screw_again() -> None:
    model = exact_model(Corruption(screw=SCREW).lower(SHORT))
    again = parse_model(model_text(model), subject="the model").mechanism.screw
    wanted = Corruption(screw=SCREW).lower(SHORT).homed().screw
    assert again is not None
    assert wanted is not None
    assert np.abs(again.transmission.upper_mm - wanted.transmission.upper_mm).max() < 1e-8
    assert np.abs(again.wobble_mm - wanted.wobble_mm).max() < 1e-8


@pytest.mark.parametrize(
    ("section", "names"),
    [
        (7, "a section"),
        ({"kind": "spiral"}, "series or table"),
        ({"kind": "table", "lower_error_mm": [0.0, 1.0], "push_x_mm": [0.0], "push_y_mm": [0.0]}, "tables of"),
        ({"kind": "series", "lead_mm": 0.0}, "height_mm"),
        ({"lead_mm": 1e-9}, "a lead of"),
        ({"backlash_mm": -0.1}, "backlash"),
        ({"lead_error": -1.0}, "lead_error"),
        ({"height_mm": [0.1]}, "sines and cosines"),
        ({"push_y_mm": [0.1] * 6}, "a list of at most"),
        ({"push_x_mm": [1e4, 0.0, 0.0, 0.0]}, "sines and cosines"),
        ({"push_y_mm": ["a", 0.0]}, "numbers"),
    ],
)
def test_hostile_screws_end_in_one_line(section: object, names: str) -> None:
    import json

    from printmend.model.model import DIGITS, seal_key

    good = {"kind": "series", "lead_mm": 8.0, "lead_error": 0.0, "backlash_mm": 0.0}
    good |= {name: [0.1, 0.0, 0.0, 0.0] for name in ("height_mm", "push_x_mm", "push_y_mm")}
    document = dict(exact_model(HEALTHY.lower(SHORT)).document)
    bare = not isinstance(section, dict) or "kind" in section
    document |= {"screw": section if bare else good | section}  # type: ignore[operator]
    text = json.dumps({**document, "digest": seal_key(document)[:DIGITS]})
    with pytest.raises(ModelError, match=names):
        parse_model(text, subject="the model")


def test_what_is_reported_is_what_the_files_do(tmp_path: Path) -> None:
    model = exact_model(Corruption(DRIVES, screw=SCREW).lower(SHORT))
    for name, text in (("tower", tower()), ("spiral", spiral())):
        source, output = tmp_path / f"{name}.gcode", tmp_path / f"{name}.out.gcode"
        source.write_bytes(text)
        said = mend_gcode(source, model, output).prediction
        found = judged(said, str(source), str(output), model.mechanism)
        assert said.heights is not None
        assert found.heights is not None
        assert "in height" in said.summary()
        for one, other in zip((said.before, *said.heights[:1]), (found.before, *found.heights[:1]), strict=True):
            assert one.rms_mm == pytest.approx(other.rms_mm, rel=0.1)
        assert found.after.max_mm < NEAR_MM
        assert found.heights[1].max_mm < NEAR_MM
        assert check_gcode(source, model).after.rms_mm == pytest.approx(said.after.rms_mm)


def test_heights_alone_are_worth_mending(tmp_path: Path) -> None:
    """A screw that pushes nothing aside but lifts unevenly: x and y stay, Z is written anew."""
    model = exact_model(Corruption(screw=Screw(periodic_mm=0.06)).lower(SHORT))
    source, output = tmp_path / "part.gcode", tmp_path / "out.gcode"
    source.write_bytes(tower())
    mend_gcode(source, model, output)
    given = [line for line in output.read_text().splitlines() if not line.startswith(";")]
    for old, new in zip(tower().decode().splitlines(), given, strict=True):
        assert old == new or old.split("Z")[0] == new.split("Z")[0]
    source.write_bytes(START.replace(b"Z0.2", b"Z8") + b"G1 X80 E1 F1800\n")  # a whole turn: no error there
    assert mend_gcode(source, model, output).prediction.is_untouched
    assert output.read_bytes() == source.read_bytes()


def test_a_sliced_file_of_the_corpus(corpus: Path, tmp_path: Path) -> None:
    files = sorted((corpus / "gcode").rglob("*.gcode"), key=lambda path: path.stat().st_size)
    sliced = [path for path in files if path.stat().st_size > 200_000 and b"LAYER" in path.read_bytes()[:20_000]]
    if not sliced:
        pytest.skip("no sliced file in the corpus")
    model = exact_model(Corruption(DRIVES, screw=SCREW).lower(replace(ENDER3, z=replace(ENDER3.z, max_mm=120.0))))
    output = tmp_path / "out.gcode"
    said = mend_gcode(sliced[0], model, output, force=True).prediction
    found = judged(said, str(sliced[0]), str(output), model.mechanism)
    assert found.before.rms_mm > 0.2
    assert found.after.rms_mm < 0.005
    assert found.heights is not None
    assert found.heights[1].rms_mm < 0.002
