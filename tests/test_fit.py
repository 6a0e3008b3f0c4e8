"""Does it fit? What `fit` says of a part that a foreign renderer drew, and what it tells slicers."""

import configparser
import io
import json
import shutil
import subprocess
import zipfile
from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from PIL import Image
from scipy.special import ndtr

from printmend.cli.fit import command
from printmend.cli.measure import command as measure
from printmend.cli.twin import command as twin
from printmend.corruption import Corruption
from printmend.errors import ConfigError, GcodeError, ScanError
from printmend.fit import SLICERS, Estimate, outline_of, settings_for, write_profiles
from printmend.fit.estimate import Side
from printmend.fit.setting import Wanted, how_to_import, wanted
from printmend.fit.words import after_size_mm
from printmend.gcode.container import open_gcode
from printmend.gcode.read import read_gcode
from printmend.gcode.sliced import sliced
from printmend.measure.distance import choose_widths
from printmend.measure.silhouette import Silhouette, find_edges
from printmend.measure.walls import read_walls
from printmend.mend.fit import fits, measured_part
from printmend.mend.mend import refuse_grown
from printmend.mend.part import measure_part
from printmend.messages import GERMAN, translated
from printmend.path import RESIZED
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend.twin.beads import print_beads
from tests import foreign_part as foreign

pytestmark = pytest.mark.usefixtures("once")
PRINTER = read_printer("ender3")
LAYERS = 4  # the first, whose foot is wider, and some above it
OUTLINE_MM, HOLE_MM, FOOT_MM, SHRINKS = 0.05, 0.12, 0.15, np.array([0.005, 0.002])
SLICER = shutil.which("prusa-slicer")


def fit_part(scan, path, filament=None, **measuring):
    return fits(measured_part(scan, path, PRINTER, **measuring), path, PRINTER, None, filament)


def test_the_twin_prints_what_fit_finds(tmp_path):
    """Two renderers that share no code: `fit` finds in the twin's scans what the command line put there."""
    shape, _ = foreign.part(np.random.default_rng(3), sizes=(29, 30))
    (tmp_path / "part.gcode").write_text(foreign.gcode(shape, LAYERS))
    scans = tmp_path / "under.png", tmp_path / "top.png"
    filament = "filament:polymer=pla,x_percent=0.5,y_percent=0.2,outline_mm=0.05,hole_mm=0.12,foot_mm=0.15"
    done = CliRunner().invoke(twin, [
        str(tmp_path / "part.gcode"), "--printer", "ender3", "--corruption", filament, "-o", str(tmp_path / "t.csv"),
        "--scan", str(scans[0]), "--top", str(scans[1]), "--dpi", "300",
    ])  # fmt: skip
    assert done.exit_code == 0, done.output
    estimate = fit_part(scans[0], tmp_path / "part.gcode", "pla", top=scans[1]).estimate
    assert estimate.upper is not None
    assert estimate.foot_mm is not None
    assert estimate.upper.outline_mm == pytest.approx(0.05, abs=0.03)
    assert estimate.upper.hole_mm == pytest.approx(0.12, abs=0.03)
    assert estimate.foot_mm[0] == pytest.approx(0.15, abs=0.03)
    assert len(estimate.upper.rounds) == len(foreign.DIAMETERS_MM)


def test_corners_that_bulge_widen_no_wall(tmp_path):
    """All four corners of a plate bulge in its scan, the one where its outline begins and ends too. `fit` reads the
    walls beside them."""
    shape, path, image = foreign.plate(), tmp_path / "part.gcode", tmp_path / "under.png"
    path.write_text(foreign.gcode(shape, LAYERS))
    rng = np.random.default_rng(6)
    rings = foreign.printed(shape, 0.05, 0.1, (0.0, 0.0), rng, 0.15)
    image.write_bytes(foreign.scan([(rings, 1.0, 0.03)], rng, below=True, dpi=300))
    side = fit_part(image, path).estimate.first
    assert side is not None
    assert side.outline_mm == pytest.approx(0.05, abs=0.02)
    assert side.hole_mm == pytest.approx(0.1, abs=0.02)


def test_the_twins_corners_bulge(tmp_path):
    """All four, and nothing else: the same place on the glass."""
    path, dark = tmp_path / "part.gcode", []
    path.write_text(foreign.gcode(foreign.plate(), LAYERS))
    for corner_mm in (0.0, 0.15):
        image = tmp_path / f"{corner_mm}.png"
        sizes = f"x_percent=0,y_percent=0,outline_mm=0.05,hole_mm=0.1,foot_mm=0,{corner_mm=}"
        done = CliRunner().invoke(twin, [
            str(path), "--printer", "ender3", "--corruption", f"filament:polymer=pla,{sizes}", "-o",
            str(tmp_path / "t.csv"), "--scan", str(image), "--dpi", "300",
        ])  # fmt: skip
        assert done.exit_code == 0, done.output
        dark.append(np.asarray(Image.open(image).convert("L"), float) < 140)
    _, _, found, _ = cv2.connectedComponentsWithStats((dark[0] != dark[1]).astype(np.uint8))
    assert sum(area > 10 for area in found[1:, cv2.CC_STAT_AREA]) == 4


def test_the_twins_part_has_lost_its_skirt(tmp_path):
    text, ring = foreign.gcode(foreign.plate(), LAYERS), [(60, 60), (160, 60), (160, 160), (60, 160), (60, 60)]
    skirt = "".join(f"G{min(k, 1)} X{x} Y{y}{' E3' * (k > 0)} F1800\n" for k, (x, y) in enumerate(ring))
    around = text.replace(";TYPE:", f";TYPE:Skirt\n{skirt};TYPE:", 1)
    beads = []
    for written in (text, around):
        (tmp_path / "part.gcode").write_text(written)
        program = read_gcode(tmp_path / "part.gcode", printer=PRINTER)
        beads.append(print_beads(program, Twin.of(Corruption(), PRINTER)))
    assert len(beads[0]) == len(beads[1])
    for alone, within in zip(*beads, strict=True):
        np.testing.assert_allclose(alone[0][1:], within[0][1:], atol=1e-9)  # the first begins elsewhere


@pytest.fixture(scope="module")
def part(tmp_path_factory):
    """A folder with part.gcode and its underside and top as they came out."""
    folder, rng = tmp_path_factory.mktemp("fit"), np.random.default_rng(3)
    shape, _ = foreign.part(rng, sizes=(29, 30))
    (folder / "part.gcode").write_text(foreign.gcode(shape, LAYERS))
    upper = foreign.printed(shape, OUTLINE_MM, HOLE_MM, -SHRINKS, rng)
    lower = foreign.printed(shape, OUTLINE_MM + FOOT_MM, HOLE_MM + FOOT_MM, -SHRINKS, rng)
    (folder / "under.png").write_bytes(foreign.scan([(lower, 1.0, 0.03)], rng, below=True, dpi=300))
    (folder / "top.png").write_bytes(foreign.scan([(lower, 0.3, 0.3), (upper, 1.0, 0.03)], rng, below=False, dpi=300))
    return folder


def test_holes_foot_and_width_are_told_from_two_scans(part):
    found = fit_part(part / "under.png", part / "part.gcode", "pla", top=part / "top.png")
    estimate = found.estimate
    assert estimate.first is not None
    assert estimate.upper is not None
    assert estimate.foot_mm is not None
    assert estimate.upper.outline_mm == pytest.approx(OUTLINE_MM, abs=0.03)
    assert estimate.upper.hole_mm == pytest.approx(HOLE_MM, abs=0.03)
    assert estimate.foot_mm[0] == pytest.approx(FOOT_MM, abs=0.03)
    assert sorted(round(one.at.diameter_mm) for one in estimate.upper.rounds) == list(foreign.DIAMETERS_MM)
    for one in estimate.upper.rounds:
        true_mm = round(one.at.diameter_mm) * (1 - SHRINKS.mean()) - 2 * HOLE_MM
        assert abs(one.diameter_mm - true_mm) < max(3 * one.sd_mm, 0.03)
    assert np.all(np.abs(-np.array(estimate.scale) - SHRINKS) < 3 * np.array(estimate.scale_sd))
    assert found.corrections.foot_mm == pytest.approx(FOOT_MM, abs=0.03)
    said = "\n".join(found.words())
    assert "the hole of 8.00 mm" in said
    assert "elephant's foot: +0.1" in said
    german = "\n".join(translated(line, GERMAN) for line in found.words())
    assert "Das Loch von 8,00 mm" in german
    assert "Elefantenfuß: +0,1" in german


def test_callipers_give_both_scans_their_scale(tmp_path):
    """A scanner that is 0.4 % off makes holes of 12 mm 0.05 mm too large, in the scan of the top as well."""
    rng = np.random.default_rng(8)
    shape, _ = foreign.part(rng, sizes=(29, 30))
    (tmp_path / "part.gcode").write_text(foreign.gcode(shape, LAYERS))
    lower, upper = (foreign.printed(shape, 0.05 + foot, 0.1 + foot, -SHRINKS, rng) for foot in (0.1, 0.0))
    for name, levels in (("under", [(lower, 1.0, 0.03)]), ("top", [(lower, 0.3, 0.3), (upper, 1.0, 0.03)])):
        image = foreign.scan(levels, rng, below=name == "under", dpi=300, stretch=(0.004, 0.004))
        (tmp_path / f"{name}.png").write_bytes(image)
    read_mm = []
    for width in choose_widths(read_walls(read_gcode(tmp_path / "part.gcode", printer=PRINTER), PRINTER)):
        read_mm.append(np.ptp(lower[0] @ [np.cos(width.angle_rad), np.sin(width.angle_rad)]) + 0.01)
    found = fit_part(tmp_path / "under.png", tmp_path / "part.gcode", top=tmp_path / "top.png", distances_mm=read_mm)
    assert found.estimate.upper is not None
    assert len(found.estimate.upper.rounds) == len(foreign.DIAMETERS_MM)
    for one in found.estimate.upper.rounds:
        true_mm = foreign.came_out(upper, (one.at.x_mm, one.at.y_mm), shape)
        assert one.diameter_mm == pytest.approx(true_mm, abs=0.03)


def test_narrow_holes_are_no_fault_of_the_machine(part):
    measured = measure_part(part / "under.png", part / "part.gcode", PRINTER)
    group = outline_of(measured.walls).group
    offset_mm = measured.trace.offset_mm
    assert offset_mm is not None
    seen = np.isfinite(measured.stands_mm)
    beads_mm = measured.stands_mm[seen] - offset_mm[np.isfinite(offset_mm)]
    assert np.allclose(beads_mm[group[seen] > 0], HOLE_MM + FOOT_MM, atol=0.03)
    assert np.allclose(beads_mm[group[seen] == 0], OUTLINE_MM + FOOT_MM, atol=0.03)
    assert any("walls of holes" in note for note in measured.notes)


def test_of_one_scan_it_says_what_it_cannot_tell(part):
    found = fit_part(part / "under.png", part / "part.gcode")
    said = "\n".join(found.words())
    assert "only the first layer was scanned" in said
    assert "including the machine's own scale error" in said
    first = found.estimate.first
    assert first is not None
    assert first.outline_mm == pytest.approx(OUTLINE_MM + FOOT_MM, abs=0.03)
    assert found.corrections.hole_mm - found.corrections.outline_mm == pytest.approx(OUTLINE_MM - HOLE_MM, abs=0.03)
    assert json.loads(json.dumps(found.json()))["elephants_foot_mm"] is None


def test_a_picture_of_an_unknown_size_tells_no_shrinkage(part):
    (number, layer), *_ = measured_part(part / "under.png", part / "part.gcode", PRINTER)
    doubted = replace(layer, trace=replace(layer.trace, instrument=RESIZED))
    known, unknown = (fits([(number, each)], part / "part.gcode", PRINTER, None, None) for each in (layer, doubted))
    assert min(unknown.estimate.scale_sd) > 2 * max(known.estimate.scale_sd)
    assert known.corrections.shrinkage > unknown.corrections.shrinkage == 0.0
    assert (unknown := unknown.estimate).first is not None
    assert unknown.first.outline_mm == pytest.approx(OUTLINE_MM + FOOT_MM, abs=0.03)
    assert known.estimate.shown is None
    (first,) = known.estimate.sides  # what a prior says of a scale is no size
    assert unknown.first.came_mm == pytest.approx(first.came_mm, abs=3 * max(first.came_sd_mm))
    assert max(unknown.first.came_sd_mm) < 0.05


def test_the_command_line_writes_what_it_says(part, tmp_path):
    arguments = [str(part / "under.png"), "--gcode", str(part / "part.gcode"), "--printer", "ender3"]
    done = CliRunner().invoke(command, [*arguments, "--out", str(tmp_path / "out"), "--json", "--filament", "pla-x"])
    assert done.exit_code == 0, done.output
    assert json.loads((tmp_path / "out" / "fit.json").read_text()) == json.loads(done.stdout)
    assert "No profile" in done.stderr  # this file does not say its settings
    wrong = CliRunner().invoke(command, [*arguments, "--filament", "wood"])
    assert isinstance(wrong.exception, ConfigError)
    other = CliRunner().invoke(command, [str(part / "part.gcode"), *arguments[1:]])
    assert isinstance(other.exception, ScanError)
    end = CliRunner().invoke(measure, [*arguments, "-o", str(tmp_path / "t.csv")])
    assert "Does it fit?" in end.output


def side(layer: int, outline: float, hole: float | None) -> Side:
    return Side(
        layer, outline, 0.004, hole, 0.004, 0.004, (), (60.0, 40.0), (60.0, 40.0), (0.01, 0.01), 0.45, 500, 0.02
    )


def estimate_of(*sides: Side, scale: tuple[float, float] = (0.0, 0.0)) -> Estimate:
    return Estimate(sides, scale, (0.0002, 0.0002), True)


PLAIN = sliced(b"; generated by PrusaSlicer\n; xy_size_compensation = 0\n")


def test_a_part_that_is_right_changes_nothing():
    right = wanted(estimate_of(side(1, 0.001, 0.002), side(9, -0.002, 0.001)), PLAIN)
    for slicer in SLICERS.values():
        assert not any(each.is_new for each in settings_for(slicer, right, PLAIN))


def test_corrections_undo_what_came_out():
    found = estimate_of(side(1, 0.2, 0.3), side(9, 0.05, 0.15), scale=(-0.003, -0.003))
    corrections = wanted(found, PLAIN)
    assert corrections == Wanted(-0.05, -0.15, 0.15, 0.003)
    for one in found.sides:
        for axis in range(2):
            drawn, after = after_size_mm(one, axis, found, PLAIN, corrections, SLICERS["orcaslicer"])
            assert after == pytest.approx(drawn, abs=0.002)
    values = {
        name: {each.key: each.value for each in settings_for(one, corrections, PLAIN)} for name, one in SLICERS.items()
    }
    assert values["orcaslicer"] == {
        "xy_contour_compensation": "-0.05", "xy_hole_compensation": "0.15", "elefant_foot_compensation": "0.15",
        "filament_shrink": "99.7%",
    }  # fmt: skip
    assert values["prusaslicer"]["filament_shrinkage_compensation_xy"] == "0.3%"
    assert values["cura"] == {
        "xy_offset": "-0.05", "hole_xy_offset": "0.1", "xy_offset_layer_0": "-0.2",
        "material_shrinkage_percentage_xy": "100.3",
    }  # fmt: skip
    assert values["superslicer"]["xy_inner_size_compensation"] == "-0.15"
    assert values["superslicer"]["first_layer_size_compensation"] == "-0.15"


CORRECTING = (
    b"; OrcaSlicer 2\n; xy_contour_compensation = -0.1\n; xy_hole_compensation = 0.07\n"
    b"; elefant_foot_compensation = 0.2\n"
)  # fmt: skip


def test_what_a_file_corrects_already_is_not_corrected_twice():
    """Its paths hold its corrections: a part that came out as it was drawn stands off them by as much, inwards."""
    file = sliced(CORRECTING)
    right = wanted(estimate_of(side(1, 0.3, 0.27), side(9, 0.1, 0.07)), file)
    assert right == Wanted(-0.1, -0.07, 0.2, 0.0)
    for sides in ([side(1, 0.24, 0.31), side(9, 0.05, 0.12)], [side(9, 0.05, 0.12)], [side(1, 0.4, 0.3)]):
        found = estimate_of(*sides)
        corrections = wanted(found, file)
        for one in sides:
            drawn, after = after_size_mm(one, 0, found, file, corrections, SLICERS["orcaslicer"])
            assert after == pytest.approx(drawn, abs=0.02)
            foot = corrections.foot_mm if one.layer == 1 else 0.0
            assert corrections.hole_mm - foot == pytest.approx(-one.hole_mm, abs=0.01)


def test_what_a_file_corrects_already_is_kept():
    file = sliced(b"; OrcaSlicer 2\n; xy_contour_compensation = -0.02\n; xy_hole_compensation = 0.1\n"
                  b"; elefant_foot_compensation = 0.15\n; filament_shrink = 99.5%\n")  # fmt: skip
    assert (file.outline_mm, file.hole_mm, file.foot_mm) == (-0.02, -0.1, 0.15)
    assert file.shrinkage == pytest.approx(0.005)
    corrections = wanted(estimate_of(side(9, 0.03, 0.05), scale=(-0.005, -0.005)), file)
    assert (corrections.outline_mm, corrections.hole_mm, corrections.foot_mm) == (-0.02, -0.05, 0.15)


@pytest.mark.parametrize(
    ("text", "outline", "hole", "foot", "shrinkage"),
    [
        (b"; PrusaSlicer\n; xy_size_compensation = 0.1\n; elefant_foot_compensation = 0.2\n"
         b"; filament_shrinkage_compensation_xy = 0.4%\n", 0.1, 0.1, 0.2, 0.004),
        (b"; SuperSlicer\n; xy_size_compensation = 0.1\n; xy_inner_size_compensation = -0.1\n"
         b"; hole_size_compensation = -0.05\n; first_layer_size_compensation = -0.1\n; filament_shrink = 99.6%\n",
         0.1, -0.15, 0.1, 0.004),
        (b'Cura_SteamEngine\n;SETTING_3 {"global_quality": "[general]\\\\nversion = 4\\\\n[values]\\\\n'
         b'xy_offset = -0.1\\\\n'
         b'hole_xy_offset = 0.2\\\\nxy_offset_layer_0 = -0.3"}\n', -0.1, -0.3, 0.2, 0.0),
        (b"nothing", 0.0, 0.0, 0.0, 0.0),
        (b"; PrusaSlicer\n; xy_size_compensation = nan\n; filament_shrinkage_compensation_xy = 90%\n", 0, 0, 0, 0),
    ],
)  # fmt: skip
def test_each_slicers_settings_are_read(text, outline, hole, foot, shrinkage):
    file = sliced(text)
    assert (file.outline_mm, file.hole_mm, file.foot_mm) == pytest.approx((outline, hole, foot))
    assert file.shrinkage == pytest.approx(shrinkage)


def test_profiles_are_what_their_slicers_read(tmp_path):
    corrections = Wanted(-0.05, -0.15, 0.15, 0.003)

    def written(file):
        settings = {name: settings_for(one, corrections, file) for name, one in SLICERS.items()}
        return {path.name: path for path in write_profiles(tmp_path / file.maker, settings, file, {})}

    many = b"".join(b"; key_%d = 1\n" % k for k in range(80))
    file = sliced(b"; SuperSlicer\n; xy_size_compensation = 0\n; first_layer_size_compensation = 0\n" + many)
    ini = configparser.ConfigParser(interpolation=None)
    ini.read_string("[all]\n" + written(file)["superslicer.ini"].read_text())
    assert ini["all"]["xy_inner_size_compensation"] == "-0.15"
    assert ini["all"]["key_7"] == "1"
    file = sliced(b'; OrcaSlicer\n; print_settings_id = 0.20mm Standard\n; filament_settings_id = "Generic PLA"\n')
    paths = written(file)
    process, filament = (json.loads(paths[f"orcaslicer-{kind}.json"].read_text()) for kind in ("process", "filament"))
    assert process["inherits"] == "0.20mm Standard"
    assert process["xy_hole_compensation"] == "0.15"
    assert filament["filament_shrink"] == ["99.7%"]
    machine, extruder = (rb"[general]\\nversion = 4\\nname = Fine\\n" + each for each in (
        rb"definition = x\\n[values]\\nlayer_height = 0.2", b""
    ))  # fmt: skip
    cura = b'Cura_SteamEngine\n;SETTING_3 {"global_quality": "%b", "extruder_quality": ["%b"]}\n' % (machine, extruder)
    with zipfile.ZipFile(io.BytesIO(written(sliced(cura))["cura.curaprofile"].read_bytes())) as archive:
        texts = [archive.read(name).decode() for name in archive.namelist()]
    assert "layer_height = 0.2" in texts[0]
    assert "material_shrinkage_percentage_xy = 100.3" in texts[0]
    assert "hole_xy_offset = 0.1" in texts[1]
    assert list(written(PLAIN)) == ["fit.json"]
    assert how_to_import(PLAIN).startswith("no profile")


@pytest.mark.skipif(SLICER is None, reason="prusa-slicer is not installed (apt-get install prusa-slicer)")
def test_prusaslicer_obeys_the_profile(tmp_path):
    box = trimesh.creation.annulus(r_min=4.0, r_max=12.0, height=1.0, sections=96)
    box.export(tmp_path / "ring.stl")

    def outermost_mm(*more: str) -> tuple[float, bytes]:
        out = tmp_path / "ring.gcode"
        subprocess.run(  # noqa: S603 - arguments of our own
            [str(SLICER), "--export-gcode", "--center", "100,100", "--skirts", "0", *more, "-o", str(out), "ring.stl"],
            cwd=tmp_path, check=True, capture_output=True, timeout=120,
        )  # fmt: skip
        words = [line.split() for line in out.read_text().splitlines() if line.startswith("G1 X") and " E" in line]
        return max(float(word[1:]) for line in words for word in line if word[0] == "X"), out.read_bytes()

    before, text = outermost_mm()
    file = sliced(text)
    assert file.maker == "prusaslicer"
    corrections = Wanted(-0.1, -0.1, file.foot_mm, 0.0)
    settings = {"prusaslicer": settings_for(SLICERS["prusaslicer"], corrections, file)}
    write_profiles(tmp_path, settings, file, {})
    after, _ = outermost_mm("--load", "prusaslicer.ini")
    assert before - after == pytest.approx(0.1, abs=0.02)


def test_a_file_that_its_slicer_enlarged_is_not_enlarged_again(tmp_path):
    path = tmp_path / "part.gcode"
    path.write_text("; PrusaSlicer\nG28\nG1 X10 Y10 E1\n; filament_shrinkage_compensation_xy = 0.4%\n")
    with open_gcode(path) as file:
        refuse_grown(file, None)
        with pytest.raises(GcodeError, match=r"enlarged against 0\.40 %"):
            refuse_grown(file, "pla")


def layered(foot_mm: float, dark: float, *, covers: bool) -> Silhouette:
    """Return an edge at x = 10 mm of an upper layer; a darker one below it, out of focus, stands out by ``foot_mm``.

    The upper layer ``covers`` it, or the scanner shows the darker of both.
    """
    px_per_mm = 600 / 25.4
    x = (np.arange(int(16 * px_per_mm)) + 0.5) / px_per_mm
    upper, lower = (ndtr((10.0 + out - x) / blur) for out, blur in ((0.0, 0.03), (foot_mm, 0.25)))
    share = upper + (1 - upper) * dark * lower if covers else np.maximum(upper, dark * lower)
    image = np.tile((230 - 170 * share)[None, :, None], (200, 1, 3))
    image += np.random.default_rng(5).normal(0, 3, image.shape)
    colour, plate = np.full(3, -1 / np.sqrt(3), np.float32), np.full((60, 100), -230 * np.sqrt(3), np.float32)
    mask = np.zeros(plate.shape, bool)
    return Silhouette(image.astype(np.uint8), colour, plate, 85 * np.sqrt(3), mask, 1, px_per_mm, np.zeros(2))


@pytest.mark.parametrize("covers", [False, True])
@pytest.mark.parametrize("foot_mm", [0.0, 0.1, 0.3])
def test_a_foot_out_of_focus_does_not_move_the_edge_above_it(foot_mm: float, covers: bool) -> None:
    silhouette = layered(foot_mm, 0.35, covers=covers)
    at_px = np.stack([np.full(30, 10.04 * silhouette.px_per_mm - 0.5), np.linspace(30, 170, 30)], axis=1)
    out = np.tile([1.0, 0.0], (30, 1))
    found = [find_edges(silhouette, at_px, out, 0.6, foot=foot) + 0.04 for foot in (True, False)]
    errors = [abs(float(np.mean(each))) for each in found]
    assert errors[0] < 0.014
    assert errors[0] < errors[1]
    bare = layered(foot_mm, 0.0, covers=covers)
    assert abs(np.mean(find_edges(bare, at_px, out, 0.6, foot=True)) + 0.04) < 0.002
