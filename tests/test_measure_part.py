"""Any printed layer is a measurement, judged by a slicer, a printer and a scanner that share no code with it."""

import io
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image
from shapely.geometry import Point, box

from printmend.cli.probe import command
from printmend.cli.twin import command as twin
from printmend.errors import GcodeError, ModelError, RefusedError, ScanError, TraceError
from printmend.gcode.read import read_gcode
from printmend.gcode.sliced import is_test_print
from printmend.learn.learned import learn_model
from printmend.measure import page, read_trace, write_trace
from printmend.measure.distance import choose_widths, scaled_by_widths
from printmend.measure.image import read_image
from printmend.measure.measurement import measure_scans
from printmend.measure.ruler import find_rulers
from printmend.measure.walls import read_walls
from printmend.mend.mend import mend_gcode
from printmend.mend.part import PartMeasurement, measure_part
from printmend.mend.verify import verify
from printmend.messages import GERMAN, translated
from printmend.path import FLATBED, Instrument
from printmend.printer import read_printer
from printmend.probe import design_probe
from printmend.twin.scanner import CLEAN, render_scan
from tests import foreign_layer as foreign

pytestmark = pytest.mark.usefixtures("once")
PRINTER = read_printer("ender3")
BROKEN = foreign.Machine(waves=(((1, 0.2, 0.5),), ((1, 0.1, 2.0), (2, 0.06, 1.0))), play=(0.25, 0.12))
LIMIT_MM = 0.03


@pytest.fixture(scope="module")
def scanned(tmp_path_factory) -> Path:
    """A folder with gear.gcode, its underside as printed by a broken machine, gear.jpg, and star.gcode."""
    folder = tmp_path_factory.mktemp("part")
    text, strokes = foreign.gcode(foreign.gear())
    (folder / "gear.gcode").write_text(text)
    (folder / "star.gcode").write_text(foreign.gcode(foreign.star())[0])
    printed = BROKEN.strokes(strokes)
    (folder / "gear.jpg").write_bytes(foreign.scan(printed, np.random.default_rng(1), dpi=300))
    return folder


def share_found(measured: PartMeasurement) -> float:
    """Return the share of the places of walls that were found, as the first note says."""
    said = re.search(r": (\d+) of (\d+) points on walls", measured.notes[0])
    assert said is not None
    assert int(said[1]) == measured.found
    return int(said[1]) / int(said[2])


def test_one_part_teaches_how_to_print_another(scanned):
    measured = measure_part(scanned / "gear.jpg", scanned / "gear.gcode", PRINTER)
    assert share_found(measured) > 0.95
    write_trace(scanned / "trace.csv", measured.trace)
    trace = read_trace(scanned / "trace.csv", PRINTER)
    assert np.allclose(trace.offset_mm, measured.trace.offset_mm, atol=1e-5, equal_nan=True)
    model = learn_model(trace, PRINTER)
    mend_gcode(scanned / "star.gcode", model, scanned / "mended.gcode")
    before = foreign.paired_error(BROKEN, scanned / "star.gcode", scanned / "star.gcode")
    after = foreign.paired_error(BROKEN, scanned / "star.gcode", scanned / "mended.gcode")
    assert before > 0.12
    assert after < LIMIT_MM
    with pytest.raises(TraceError, match="the measurement that the model was learned from"):
        verify(model, trace)


def test_a_picture_without_a_resolution_says_which_is_assumed(scanned, tmp_path, monkeypatch):
    """Of a part as of dots: the usual resolution is taken, and the first note says so."""
    monkeypatch.setattr(page, "USUAL_DPI", 300.0)
    plan = design_probe(PRINTER, size_mm=50, marks=100)
    dots = render_scan(plan.marks_mm, plan, dpi=300, degradations=CLEAN, rng=np.random.default_rng(1)).image
    Image.fromarray(dots[..., ::-1]).save(tmp_path / "dots.png")
    Image.open(scanned / "gear.jpg").save(tmp_path / "gear.png", dpi=(96, 96))  # as an editor writes it
    part = measure_part(tmp_path / "gear.png", scanned / "gear.gcode", PRINTER).notes[0]
    for note in (part, measure_scans([tmp_path / "dots.png"], plan).notes[0]):
        assert "scale from 300 dpi, assumed: the file states no scanner resolution; if it differs, give" in note
        assert "angenommen" in translated(note, GERMAN)
    stated = (page.read_page(scanned / "gear.jpg"), page.read_page(tmp_path / "gear.png", dpi=300.0))
    assert [(one.scale, one.unsure) for one in stated] == 2 * [("scale from 300 dpi", False)]


def test_a_swinging_pulley_is_no_width_of_holes(tmp_path):
    """It pushes the outline of a plate out or in by a tenth of a millimetre, and its holes the other way."""
    plate = (box(-45, -40, 20, 40) | Point(20, 0).buffer(40)) - Point(22, 0).buffer(15) - Point(-18, -22).buffer(8)
    text, strokes = foreign.gcode(plate)
    (tmp_path / "plate.gcode").write_text(text)
    swinging = foreign.Machine(waves=(((1, 0.2, 1.5),), ()), play=(0.0, 0.25))
    (tmp_path / "plate.jpg").write_bytes(foreign.scan(swinging.strokes(strokes), np.random.default_rng(1), dpi=300))
    measured = measure_part(tmp_path / "plate.jpg", tmp_path / "plate.gcode", PRINTER)
    assert any("all walls are" in note for note in measured.notes)
    faults = learn_model(measured.trace, PRINTER).document["diagnosis"]
    assert {(fault["part"], fault["kind"]) for fault in faults} == {("x", "harmonic-1"), ("y", "play")}


def _changed(scanned: Path, name: str, change) -> Path:
    picture = np.asarray(Image.open(scanned / "gear.jpg"))
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(change(picture))).save(file, "JPEG", quality=92, dpi=(300, 300))
    path = scanned / name
    path.write_bytes(file.getvalue())
    return path


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("cut", lambda p: p[:, 200:], "cuts off"),
        ("two", lambda p: np.hstack([p, p]), "one part at a time"),
        ("blank", lambda p: np.full_like(p, 230), "stands out"),
        ("small", lambda p: np.asarray(Image.fromarray(p).resize((p.shape[1] // 2, p.shape[0] // 2))), "--dpi 150"),
    ],
)
def test_what_is_no_scan_of_the_part_is_named(scanned, name, change, said):
    with pytest.raises(ScanError, match=said):
        measure_part(_changed(scanned, f"{name}.jpg", change), scanned / "gear.gcode", PRINTER)


def test_another_part_and_the_wrong_side_are_named(scanned):
    with pytest.raises(ScanError, match="the part of this file"):
        measure_part(scanned / "gear.jpg", scanned / "star.gcode", PRINTER)
    tall = scanned / "tall.gcode"
    tall.write_text(foreign.gcode(foreign.gear(), layers=2)[0])
    with pytest.raises(ScanError, match="upside down"):
        measure_part(_changed(scanned, "top.jpg", lambda p: p[:, ::-1]), tall, PRINTER)


def test_a_part_of_thin_walls_is_known_though_they_moved_by_their_width(tmp_path):
    outer = foreign.star(size=28)
    text, strokes = foreign.gcode(outer - outer.buffer(-2.2))
    (tmp_path / "ring.gcode").write_text(text)
    picture = foreign.scan(BROKEN.strokes(strokes), np.random.default_rng(3), dpi=300)
    (tmp_path / "ring.jpg").write_bytes(picture)
    measured = measure_part(tmp_path / "ring.jpg", tmp_path / "ring.gcode", PRINTER)
    assert share_found(measured) > 0.9
    (tmp_path / "other.gcode").write_text(foreign.gcode(foreign.gear(size=28) - foreign.gear(size=28).buffer(-2.2))[0])
    with pytest.raises(ScanError, match="the part of this file"):
        measure_part(tmp_path / "ring.jpg", tmp_path / "other.gcode", PRINTER)


def test_only_a_part_is_measured():
    text = foreign.gcode(foreign.star())[0]
    brim = read_gcode(text.replace("External perimeter", "Skirt/Brim").encode(), printer=PRINTER)
    with pytest.raises(GcodeError, match="only skirt/brim"):
        read_walls(brim, PRINTER)
    raft = read_gcode(text.replace(";LAYER_CHANGE", ";LAYER:-2").encode(), printer=PRINTER)
    with pytest.raises(GcodeError, match="raft"):
        read_walls(raft, PRINTER)
    with pytest.raises(GcodeError, match="found 1 layer;"):
        read_walls(read_gcode(text.encode(), printer=PRINTER), PRINTER, layer=3)


def test_homing_after_a_layer_does_not_matter_to_it() -> None:
    text = foreign.gcode(foreign.star())[0]
    alone, joined = (read_walls(read_gcode(each.encode(), printer=PRINTER), PRINTER) for each in (text, text + text))
    assert (joined.commanded_mm == alone.commanded_mm).all()


def test_the_first_layer_is_a_print_of_its_own(tmp_path):
    (tmp_path / "part.gcode").write_text(foreign.gcode(foreign.star(), layers=3)[0])
    outcome = CliRunner().invoke(
        command, ["--first-layer", str(tmp_path / "part.gcode"), "-o", str(tmp_path / "first.gcode")]
    )
    assert outcome.exit_code == 0, outcome.output
    assert is_test_print(tmp_path / "first.gcode")
    assert not is_test_print(tmp_path / "part.gcode")
    alone, whole = (read_gcode(tmp_path / name) for name in ("first.gcode", "part.gcode"))
    assert set(alone.moves.layer[alone.moves.extruding]) == {0}
    first = whole.moves.extruding & (whole.moves.layer == 0)
    assert np.array_equal(alone.moves.end_mm[alone.moves.extruding], whole.moves.end_mm[first])
    assert b"M104 S0\nM140 S0\nM107\n; sealed by printmend " in alone.text.tobytes()
    assert b"the first layer of a part" in (tmp_path / "first-how-to.pdf").read_bytes()
    # what `measure` would refuse is not printed first
    square = "G1 X90 Y50 E2\nG1 X90 Y90 E2\nG1 X50 Y90 E2\nG1 X50 Y50 E2\n"
    brim = f"G28\nM83\nG1 Z0.2\n;LAYER_CHANGE\n;TYPE:Brim\nG0 X50 Y50\n{square}G1 Z0.4\n;LAYER_CHANGE\n{square}"
    for text, said in ((brim, "only brim; slice it without brim"), ((tmp_path / "first.gcode").read_text(), "ours")):
        (tmp_path / "part.gcode").write_text(text)
        with pytest.raises(GcodeError, match=said):
            CliRunner().invoke(
                command, ["--first-layer", str(tmp_path / "part.gcode"), "-o", str(tmp_path / "no.gcode")],
                catch_exceptions=False,
            )  # fmt: skip
    (tmp_path / "part.gcode").write_text(foreign.gcode(foreign.star())[0] + "G1 X99999999999 E1\n")
    with pytest.raises(ModelError, match="expected G-code for Creality Ender-3, X from 0 to 220 mm"):
        CliRunner().invoke(
            command,
            ["--printer", "ender3", "--first-layer", str(tmp_path / "part.gcode"), "-o", str(tmp_path / "no.gcode")],
            catch_exceptions=False,
        )
    for option in (["--net"], ["--pen"], ["--sheets", "2"]):
        refused = CliRunner().invoke(
            command, ["--first-layer", "part.gcode", "-o", str(tmp_path / "no.gcode"), *option]
        )
        assert refused.exit_code == 2
        assert "leave out" in refused.output
    assert not (tmp_path / "no.gcode").exists()


def test_the_twin_draws_the_underside_of_any_part(scanned):
    """What `printmend twin part.gcode --scan` draws, `measure --gcode` reads, turned on the glass, too."""
    (scanned / "broken.toml").write_text('[x.belt]\nkind = "play"\nplay_mm = 0.4\n')
    drawn = CliRunner().invoke(
        twin,
        [str(scanned / "gear.gcode"), "--printer", "ender3", "--corruption", str(scanned / "broken.toml"), "--dpi",
         "200", "--turn", "90", "--scan", str(scanned / "under.png"), "-o", str(scanned / "exact.csv")],
    )  # fmt: skip
    assert drawn.exit_code == 0, drawn.output
    assert "the part's underside" in drawn.output
    measured = measure_part(scanned / "under.png", scanned / "gear.gcode", PRINTER)
    assert share_found(measured) > 0.95
    rows = measured.trace.wall_rows
    along_x = np.abs(measured.trace.normal[rows, 0]) > 0.95
    off = measured.trace.offset_mm[rows]
    # walls that face left and right lie off by the play or not at all; those that face front and back hardly
    assert np.ptp(np.quantile((off * np.sign(measured.trace.normal[rows, 0]))[along_x], [0.1, 0.9])) > 0.3
    assert np.std(off[np.abs(measured.trace.normal[rows, 1]) > 0.99]) < 0.05


def test_a_healthy_printer_stays_as_it_is(scanned):
    printed = foreign.gcode(foreign.gear())[1]
    (scanned / "healthy.jpg").write_bytes(
        foreign.scan(printed, np.random.default_rng(2), dpi=300, stretch=(1e-3, -5e-4))
    )
    model = learn_model(measure_part(scanned / "healthy.jpg", scanned / "gear.gcode", PRINTER).trace, PRINTER)
    assert is_as_it_was(scanned / "star.gcode", model)


def is_as_it_was(part, model):
    """Tell whether a part is printed as it is: mending changes no byte of it, or refuses to write another."""
    out = part.with_suffix(".same.gcode")
    try:
        mend_gcode(part, model, out)
    except RefusedError:
        return not out.exists()
    return out.read_bytes() == part.read_bytes()


def test_a_photo_without_tags_is_told_the_way_out(scanned):
    picture = Image.open(scanned / "gear.jpg")
    noted = Image.Exif()
    noted.get_ifd(0x8769)[0x829A] = 0.01  # the exposure time, which cameras note
    picture.save(scanned / "bare.jpg", exif=noted)
    with pytest.raises(ScanError, match=r"a photo without any; print the sheet of tags \(`printmend probe --sheet"):
        measure_part(scanned / "bare.jpg", scanned / "gear.gcode", PRINTER)
    picture.save(scanned / "bare.png")  # a messenger takes off what the camera noted
    with pytest.raises(ScanError, match=r"if it is a photo: print the sheet of tags"):
        measure_part(scanned / "bare.png", scanned / "gear.gcode", PRINTER)


def test_a_sheet_that_was_printed_to_fit_the_page_is_named(scanned):
    strokes = foreign.gcode(foreign.gear())[1]
    (scanned / "fit.jpg").write_bytes(
        foreign.photo(strokes, np.random.default_rng(6), sheet=0.95, size_px=(1050, 1400))
    )
    with pytest.raises(ScanError, match=r"seems printed at 95\.[01] %"):
        measure_part(scanned / "fit.jpg", scanned / "gear.gcode", PRINTER)


def test_widths_by_callipers_settle_the_scale(scanned):
    wide = foreign.Machine(gain=(0.002, 0.002))
    printed, swell = wide.strokes(foreign.gcode(foreign.gear())[1]), 0.09
    scan = foreign.scan(printed, np.random.default_rng(5), dpi=300, swell=swell, stretch=(-0.001, -0.0015))
    (scanned / "wide.jpg").write_bytes(scan)
    true = np.ptp(np.vstack(printed), axis=0) + foreign.NOZZLE + 2 * swell
    read = tuple(np.round(true + np.array([0.012, -0.008]), 2).tolist())  # callipers show hundredths, the hand adds one

    measured = measure_part(scanned / "wide.jpg", scanned / "gear.gcode", PRINTER, distances_mm=read)
    assert scales_of(measured.trace) == pytest.approx([0.002, 0.002], abs=5e-4)
    assert measured.trace.instrument.scale_sd < 0.25 * FLATBED.scale_sd


def scales_of(trace):
    """Return by which shares a part is too large along X and Y, by least squares over its walls' offsets."""
    seen = trace.wall_rows
    normal, at = trace.normal[seen], trace.commanded_mm[seen]
    columns = np.column_stack([normal * (at - at.mean(axis=0)), normal, np.ones(len(at))])
    return np.linalg.lstsq(columns, trace.offset_mm[seen], rcond=None)[0][:2]


def test_widths_of_another_part_are_named(scanned):
    walls = read_walls(read_gcode(scanned / "gear.gcode", printer=PRINTER), PRINTER)
    edges = walls.commanded_mm[walls.row] + walls.half_mm[:, None] * walls.normal
    widths = choose_widths(walls)
    with pytest.raises(TraceError, match=r"along X .*, found 2\.89, which looks like inches; measure"):
        scaled_by_widths((2.89,), widths, edges, Instrument())
    with pytest.raises(TraceError, match=r"expected at most 2 distances"):
        scaled_by_widths((73.0, 70.0, 30.0), widths, edges, Instrument())


def test_a_ruler_beside_the_part_settles_the_scale_along_it(scanned):
    _, strokes = foreign.gcode(foreign.gear())
    healthy = foreign.Machine().strokes(strokes)
    taken = foreign.scan(healthy, np.random.default_rng(5), dpi=300, stretch=(0.0016, 0.0016))
    (scanned / "ruled.jpg").write_bytes(foreign.with_ruler(taken, 1.0, stretch=0.0016))
    ruled = measure_part(scanned / "ruled.jpg", scanned / "gear.gcode", PRINTER)
    note = next(note for note in ruled.notes if "ruler" in note)
    assert "81 lines over 80 mm" in note
    assert float(note.split("image is ")[1].split(" %")[0]) == pytest.approx(0.16, abs=0.02)
    assert share_found(ruled) > 0.95
    assert abs(scales_of(ruled.trace)[0]) < 4e-4
    assert ruled.trace.instrument.scale_sd < 0.8 * FLATBED.scale_sd
    inches, _ = read_image(io.BytesIO(foreign.with_ruler(taken, 25.4 / 16)))
    with pytest.raises(ScanError, match=r"millimetre, found one in inches; turn"):
        find_rulers(inches, 300 / 25.4, subject="inches.jpg")


def test_walls_that_repeat_their_neighbours_convince_nobody(scanned):
    """A bead is too wide or too narrow for some millimetres: no error of the machine, however many walls say it."""
    machine = foreign.Machine(skew=0.006)
    printed = machine.strokes(foreign.gcode(foreign.gear())[1])
    (scanned / "again.jpg").write_bytes(foreign.scan(printed, np.random.default_rng(6), dpi=300, stretch=(1e-3, -5e-4)))
    model = learn_model(measure_part(scanned / "again.jpg", scanned / "gear.gcode", PRINTER).trace, PRINTER)
    mend_gcode(scanned / "star.gcode", model, scanned / "again.gcode")
    assert foreign.paired_error(machine, scanned / "star.gcode", scanned / "again.gcode") < 0.02
