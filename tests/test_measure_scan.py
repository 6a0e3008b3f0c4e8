"""Scans of a probe: drawn with known truth, read back, whatever the pose and the dirt."""

import io
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from printmend.cli.measure import command
from printmend.corruption import Corruption, Drive, EccentricBore, Ellipse, Play
from printmend.errors import ScanError, TraceError
from printmend.measure import write_plan
from printmend.measure.image import read_image, write_image, write_words
from printmend.measure.measurement import SETTLED_AXES_SD, freed_of_scanner, measure_scans, wave_left_mm
from printmend.measure.page import exposure, resolution
from printmend.measure.plan import ProbePlan
from printmend.measure.resampled import is_resampled
from printmend.measure.table import read_trace
from printmend.messages import GERMAN
from printmend.path import FLATBED, RESIZED, distorted
from printmend.printer import read_printer
from printmend.probe import design_probe
from printmend.probe.tags import write_sheet
from printmend.twin import Twin
from printmend.twin.scanner import CLEAN, DEFAULT, HEAVY, Scan, render_scan
from printmend_lab.camera import render_photo
from tests.naive_measure import best_similarity

PRINTER = read_printer("ender3")


@pytest.fixture(scope="module")
def plan() -> ProbePlan:
    return design_probe(PRINTER, size_mm=60)


@pytest.fixture(scope="module")
def printed(plan) -> np.ndarray:
    corruption = Corruption(
        (Drive(pulley=EccentricBore(0.8, 0.3), belt=Play(0.7)), Drive(pulley=Ellipse(7.0, 5.9), belt=Play(0.4)))
    )
    return Twin.of(corruption, PRINTER).follow(plan.waypoints_mm)[plan.rows]


@pytest.fixture(scope="module")
def clean(plan, printed) -> Scan:
    return render_scan(printed, plan, dpi=300, degradations=CLEAN, rng=np.random.default_rng(1))


def saved(path: Path, image: np.ndarray, dpi: float = 600) -> Path:
    write_image(path, image, dpi=dpi)
    return path


def error_mm(measured: np.ndarray, printed: np.ndarray, *, scale: bool) -> np.ndarray:
    """Differences left when the measured marks are laid on the printed ones."""
    found = np.isfinite(measured).all(axis=1)
    return best_similarity(measured[found], printed[found], scale=scale) - printed[found]


def rms(error: np.ndarray) -> float:
    return float(np.sqrt((error**2).mean()))


@pytest.mark.parametrize(("quarter_turns", "mirrored"), [(0, False), (1, True), (2, True), (3, False)])
def test_a_clean_scan_is_read_to_a_micrometre_in_any_pose(tmp_path, plan, printed, quarter_turns, mirrored):
    scan = render_scan(
        printed, plan, dpi=300, degradations=CLEAN, rng=np.random.default_rng(1),
        quarter_turns=quarter_turns, mirrored=mirrored,
    )  # fmt: skip
    measurement = measure_scans([saved(tmp_path / "scan.png", scan.image, dpi=300)], plan)
    assert not len(measurement.missing)
    assert rms(error_mm(measurement.measured_mm, printed, scale=False)) < 0.001
    assert ("seen from below" in measurement.notes[0]) == mirrored


@pytest.mark.parametrize(("degradations", "most_um", "least_found"), [(DEFAULT, 15, 0.98), (HEAVY, 40, 0.95)])
def test_a_dirty_scan_is_read_within_its_bounds(tmp_path, plan, printed, degradations, most_um, least_found):
    still = replace(degradations, stretch=0.0)
    scan = render_scan(printed, plan, degradations=still, rng=np.random.default_rng(2))
    measurement = measure_scans([saved(tmp_path / "scan.jpg", scan.image)], plan)
    error = error_mm(measurement.measured_mm, printed, scale=False)
    assert rms(error) * 1000 < most_um
    assert np.abs(error).max() < 0.3  # a mark taken for another would be off by millimetres
    found = np.isfinite(measurement.measured_mm).all(axis=1)
    assert found.mean() > least_found - (~scan.present).mean()
    assert not found[~scan.present].any()
    claimed = measurement.sigma_mm[found]
    assert 0.4 < np.median(np.abs(error) / claimed[:, None]) / 0.6745 < 1.6


def test_a_quarter_turn_removes_the_scanners_own_axes(tmp_path, plan, printed):
    stretch = (0.002, -0.002)
    paths = []
    for turns in (0, 1):
        scan = render_scan(
            printed, plan, dpi=300, degradations=CLEAN, rng=np.random.default_rng(3), quarter_turns=turns,
            stretch=stretch,
        )  # fmt: skip
        paths.append(saved(tmp_path / f"scan{turns}.png", scan.image, dpi=300))
    single = measure_scans(paths[:1], plan)
    double = measure_scans(paths, plan)
    assert rms(error_mm(single.measured_mm, printed, scale=True)) > 0.03
    assert rms(error_mm(double.measured_mm, printed, scale=True)) < 0.002
    assert any("That is corrected" in note for note in double.notes)
    assert not any("disagree" in note for note in double.notes)
    other = render_scan(
        printed, plan, dpi=300, degradations=CLEAN, rng=np.random.default_rng(3), quarter_turns=1, stretch=(0.004, 0.0)
    )
    two_scanners = measure_scans([paths[0], saved(tmp_path / "other.png", other.image, dpi=300)], plan)
    assert any("on one scanner" in note for note in two_scanners.notes)
    assert two_scanners.instrument.wave_mm > 0.01


def test_a_quarter_turn_removes_the_scanners_lens(tmp_path, plan, printed):
    lens = replace(CLEAN, lens_mm=(0.6, -0.8, 0.4))
    paths = []
    for turns in (0, 1):
        scan = render_scan(printed, plan, dpi=300, degradations=lens, rng=np.random.default_rng(3), quarter_turns=turns)
        paths.append(saved(tmp_path / f"scan{turns}.png", scan.image, dpi=300))
    single, double = measure_scans(paths[:1], plan), measure_scans(paths, plan)
    assert rms(error_mm(single.measured_mm, printed, scale=True)) > 0.01
    assert rms(error_mm(double.measured_mm, printed, scale=True)) < 0.002
    assert any("the scanner distorts by up to 0.0" in note for note in double.notes)
    assert not any("disagree" in note for note in double.notes)
    assert double.instrument.lens_mm < 0.2 * single.instrument.lens_mm


@pytest.mark.parametrize(("quarter_turns", "known"), [(1, [0, 1, 2]), (2, [0, 2]), (0, [])])
def test_turned_scans_give_back_what_the_lens_did(rng: np.random.Generator, quarter_turns: int, known: list[int]):
    """A half turn shows what is even, and no turn shows anything: what is not shown stays as it was."""
    print_mm, lens_mm = rng.uniform(-90, 90, (500, 2)), np.array([0.2, -0.3, 0.1])
    turned = [print_mm, print_mm @ np.linalg.matrix_power(np.array([[0.0, 1.0], [-1.0, 0.0]]), quarter_turns)]
    seen = [place + distorted(place, 0) @ lens_mm + rng.normal(0, 0.003, place.shape) for place in turned]
    freed = freed_of_scanner(seen, FLATBED)
    without, instrument = freed.places_mm[0] @ freed.axes.T, freed.instrument
    columns = distorted(seen[0], 0).reshape(-1, 3)
    taken = np.linalg.lstsq(columns, (seen[0] - without).ravel(), rcond=None)[0]
    assert taken[known] == pytest.approx(lens_mm[known], abs=0.006)
    if len(known) == 3:
        assert instrument.lens_mm < 1.05 * FLATBED.carriage_mm
    else:
        assert instrument.lens_mm == pytest.approx(FLATBED.lens_mm, rel=0.02)
        assert np.abs(np.delete(taken, known)).max() < 0.1


def test_a_half_turn_says_that_it_cannot_tell_the_axes(tmp_path, plan, printed):
    paths = [
        saved(
            tmp_path / f"scan{turns}.png",
            render_scan(
                printed, plan, dpi=300, degradations=DEFAULT, rng=np.random.default_rng(3), quarter_turns=turns
            ).image,
            dpi=300,
        )
        for turns in (0, 2)
    ]
    assert any("quarter" in note for note in measure_scans(paths, plan).notes)


def test_another_colour_and_resolution_are_read_too(tmp_path, plan, printed):
    colours = replace(DEFAULT, filament=(200, 90, 60), background=(60, 60, 60), stretch=0.0)
    scan = render_scan(printed, plan, dpi=400, degradations=colours, rng=np.random.default_rng(5))
    measurement = measure_scans([saved(tmp_path / "scan.tif", scan.image, dpi=400)], plan)
    assert rms(error_mm(measurement.measured_mm, printed, scale=False)) < 0.015


def test_a_photo_with_the_sheet_is_read_to_a_hundredth(tmp_path, plan, printed, monkeypatch):
    monkeypatch.setattr("printmend_lab.camera.PHOTO_PX", (2250, 3000))
    photo = render_photo(printed, plan, rng=np.random.default_rng(6))
    measurement = measure_scans([saved(tmp_path / "photo.jpg", photo, dpi=72)], plan)
    assert rms(error_mm(measurement.measured_mm, printed, scale=False)) < 0.05
    assert "tags" in measurement.notes[0]
    with pytest.raises(ScanError, match="whose scale is the scanner's own"):
        measure_scans([tmp_path / "photo.jpg"], plan, scanner_error=0.0005)


def test_the_frame_is_that_of_the_bed(tmp_path, plan):
    skewed = plan.marks_mm + 0.01 * (plan.marks_mm[:, 1:] - 110) * [1.0, 0.0]
    scan = render_scan(skewed, plan, dpi=300, degradations=CLEAN, rng=np.random.default_rng(7), quarter_turns=1)
    measurement = measure_scans([saved(tmp_path / "scan.png", scan.image, dpi=300)], plan)
    error = measurement.measured_mm - skewed
    assert np.abs(error - np.median(error, axis=0)).max() < 0.005
    assert np.abs(np.median(measurement.measured_mm - plan.marks_mm, axis=0)).max() < 1e-6


def test_the_command_writes_trace_and_overlay(tmp_path, plan, printed):
    scan = render_scan(printed, plan, dpi=300, rng=np.random.default_rng(8))
    path = saved(tmp_path / "scan.png", scan.image, dpi=300)
    write_plan(tmp_path / "probe.json", plan)
    arguments = [str(path), "--probe", str(tmp_path / "probe.json"), "-o", str(tmp_path / "trace.csv")]
    result = CliRunner().invoke(command, [*arguments, "--overlay", str(tmp_path / "seen.png")], catch_exceptions=False)
    assert "300 dpi" in result.output
    rows = (tmp_path / "trace.csv").read_text().splitlines()
    doubts = "scale_sd,axes_sd,lean_sd,wave_mm,carriage_mm,lens_mm,resized_sd,paper_sd,scale_axes,scale_lean,"
    doubts += "axes_lean,turn_x_rad,turn_y_rad"
    names = "x_mm,y_mm,x_measured_mm,y_measured_mm,sigma_mm,placed"
    assert rows[0] == f"{names},{doubts},printer,kinematics,probe"
    assert rows[1].endswith(f"{plan.printer},{plan.kinematics},{plan.origin.probe}")
    assert len(rows) == len(plan.waypoints_mm) + 1
    assert read_trace(tmp_path / "trace.csv", PRINTER).instrument.scale_sd == FLATBED.scale_sd
    CliRunner().invoke(command, [*arguments, "--scanner-error", "0.05"], catch_exceptions=False)
    known = read_trace(tmp_path / "trace.csv", PRINTER).instrument
    assert known.scale_sd == 0.0005
    assert known.axes_sd == pytest.approx(FLATBED.axes_sd * 0.0005 / FLATBED.scale_sd, rel=0.05)
    seen = cv2.imread(str(tmp_path / "seen.png"))
    assert "Both dots are circled in" in result.output
    assert (seen == (200, 0, 200)).all(axis=2).sum() > 500
    turned = saved(tmp_path / "turned.png", np.rot90(scan.image), dpi=300)
    measurement = measure_scans([path, turned], plan)
    assert f"{turned} is the same picture as {path} and counts once" in " ".join(measurement.notes)
    assert len((tmp_path / "trace.csv").read_text().splitlines()) == len(rows)
    assert measurement.instrument.axes_sd > SETTLED_AXES_SD
    assert measure_scans([turned], plan).instrument.turn_x_rad == pytest.approx(known.turn_y_rad, abs=2e-4)
    assert 0.001 < abs(known.turn_y_rad) < 0.1


def grey(height: int, width: int, value: int = 200) -> np.ndarray:
    return np.full((height, width, 3), value, np.uint8)


def test_bad_images_end_in_one_line(tmp_path, plan, clean):
    (tmp_path / "text.png").write_text("no image")
    saved(tmp_path / "small.png", grey(100, 2000))
    saved(tmp_path / "blank.png", grey(1500, 1500))
    noise = np.random.default_rng(9).integers(0, 255, (1200, 1200, 3), dtype=np.uint8)
    saved(tmp_path / "noise.png", noise)
    scan = clean
    whole = saved(tmp_path / "whole.png", scan.image, dpi=300).read_bytes()
    (tmp_path / "truncated.png").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "empty.png").touch()
    (tmp_path / "folder.png").mkdir()
    saved(tmp_path / "whole.jpg", scan.image, dpi=300)
    (tmp_path / "truncated.jpg").write_bytes((tmp_path / "whole.jpg").read_bytes()[:20_000])
    noted = Image.Exif()
    noted.get_ifd(0x8769)[0x829A] = 0.01  # the exposure time, which cameras note
    Image.fromarray(grey(500, 500)).save(tmp_path / "photo.jpg", exif=noted)
    for name, named in (
        ("none.png", "no such file"),
        ("text.png", "no image"),
        ("small.png", "300 pixels"),
        ("blank.png", "without any"),
        ("noise.png", "dots"),
        ("truncated.png", "damaged"),
        ("truncated.jpg", "damaged"),
        ("empty.png", "no image"),
        ("folder.png", "a folder"),
        ("photo.jpg", "a photo without any; print the sheet of tags"),
    ):
        with pytest.raises(ScanError, match=named) as caught:
            measure_scans([tmp_path / name], plan)
        assert "\n" not in str(caught.value)
        with pytest.raises(ScanError, match=name):  # one scan needs no list
            measure_scans(str(tmp_path / name), plan)
    with pytest.raises(TraceError, match="which looks like inches"):
        measure_scans([tmp_path / "whole.png"], plan, distance_mm=2.7)


def test_a_scan_that_is_cut_off_teaches_by_what_it_shows(tmp_path, plan, printed, clean):
    path = saved(tmp_path / "cropped.png", clean.image[:, : clean.image.shape[1] * 6 // 10], dpi=300)
    measurement = measure_scans([path], plan)
    found = np.isfinite(measurement.measured_mm).all(axis=1)
    seen = clean.marks_px[:, 0] < clean.image.shape[1] * 0.6 - 20
    assert found[seen].mean() > 0.9  # but for a few at the cut
    assert rms(error_mm(measurement.measured_mm, printed, scale=False)) < 0.002
    assert any("most of them at the right of the bed" in note for note in measurement.notes)


@pytest.mark.parametrize("said_dpi", [600, 150])
def test_a_wrong_resolution_is_named(tmp_path, plan, clean, said_dpi):
    path = saved(tmp_path / "scan.png", clean.image, dpi=said_dpi)
    with pytest.raises(ScanError, match=r"--dpi 300"):
        measure_scans([path], plan)


def test_the_plate_of_another_plan_is_refused(tmp_path, plan, printed):
    other = design_probe(PRINTER, size_mm=50)
    scan = render_scan(other.marks_mm, other, dpi=300, degradations=CLEAN, rng=np.random.default_rng(1))
    path = saved(tmp_path / "scan.png", scan.image, dpi=300)
    with pytest.raises(ScanError, match="other dots"):
        measure_scans([path], plan)


def test_images_too_large_for_the_memory_are_refused_unread(tmp_path):
    header = bytearray(saved(tmp_path / "one.png", grey(400, 400)).read_bytes())
    header[16:24] = (20_000).to_bytes(4, "big") * 2
    crc = __import__("zlib").crc32(bytes(header[12:29])).to_bytes(4, "big")
    header[29:33] = crc
    (tmp_path / "bomb.png").write_bytes(bytes(header))
    with pytest.raises(ScanError, match="150 million pixels, found 400 million"):
        read_image(tmp_path / "bomb.png")


@pytest.mark.parametrize("kind", ["L", "RGBA", "P", "CMYK", "I;16", "F"])
def test_every_kind_of_pixels_is_read(tmp_path, kind):
    ramp = np.tile(np.linspace(0, 255, 400).astype(np.uint8), (320, 1))
    made = {"I;16": ramp.astype(np.uint16) * 257, "F": ramp.astype(np.float32) / 255}.get(kind)
    image = Image.fromarray(ramp).convert("RGB").convert(kind) if made is None else Image.fromarray(made)
    image.save(tmp_path / "scan.tif", dpi=(600, 600))
    pixels, dpi = read_image(tmp_path / "scan.tif")
    assert dpi == 600
    assert np.abs(pixels.astype(int) - ramp[:, :, None]).max() <= (60 if kind == "P" else 2)


def test_the_sheet_is_a_pdf_with_every_tag(tmp_path):
    write_sheet(tmp_path / "sheet.pdf")
    data = (tmp_path / "sheet.pdf").read_bytes()
    assert data.startswith(b"%PDF-1.4")
    assert data.rstrip().endswith(b"%%EOF")
    assert data.count(b" re f") > 14 * 20
    write_sheet(tmp_path / "blatt.pdf", language=GERMAN)
    assert b"Lineal nachmessen" in (tmp_path / "blatt.pdf").read_bytes()


def test_a_legend_has_umlauts():
    plain, dotted = np.full((2, 60, 60, 3), 255, np.uint8)
    write_words(plain, "u", (10, 50), 40, (0, 0, 0))
    write_words(dotted, "ü", (10, 50), 40, (0, 0, 0))
    above = np.flatnonzero((plain < 255).any(axis=(1, 2)))[0]
    assert (dotted[:above] < 128).any()
    assert (dotted[above:] == plain[above:]).all()


def test_overlapping_scans_of_a_large_plate_are_joined(tmp_path, plan, printed):
    scan = render_scan(printed, plan, dpi=300, degradations=DEFAULT, rng=np.random.default_rng(4), stretch=(0.0, 0.0))
    whole = measure_scans([saved(tmp_path / "whole.png", scan.image, 300)], plan)
    low, high = scan.marks_px[:, 1].min(), scan.marks_px[:, 1].max()
    upper = scan.image[: int(low + 0.68 * (high - low))]
    again = render_scan(printed, plan, dpi=300, degradations=DEFAULT, rng=np.random.default_rng(5), stretch=(0.0, 0.0))
    low, high = again.marks_px[:, 1].min(), again.marks_px[:, 1].max()
    lower = np.ascontiguousarray(again.image[int(low + 0.32 * (high - low)) :][::-1, ::-1])  # turned by half a turn
    parts = [saved(tmp_path / "a.png", upper, 300), saved(tmp_path / "b.png", lower, 300)]
    joined = measure_scans(parts, plan)
    assert any("were joined by" in note for note in joined.notes)
    assert len(joined.missing) <= len(whole.missing) + 2
    alone, together = (rms(error_mm(one.measured_mm, printed, scale=False)) for one in (whole, joined))
    assert together < 1.3 * alone
    one = measure_scans(parts[:1], plan)
    assert len(one.missing) > len(joined.missing) + 0.2 * len(plan)
    assert any("most of them at the" in note for note in one.notes)
    narrow = saved(tmp_path / "c.png", again.image[int(low + 0.6 * (high - low)) :], 300)
    with pytest.raises(ScanError, match="overlap by a third"):
        measure_scans([parts[0], narrow], plan)


@pytest.mark.parametrize("damaged", [b"Exif\0\0garbage!", b"Exif\0\0II*\0\xff\xff\xff\x7f"])
def test_a_damaged_note_of_the_camera_is_as_none(damaged: bytes, tmp_path: Path) -> None:
    Image.new("RGB", (300, 300)).save(tmp_path / "scan.jpg", exif=damaged)
    assert exposure(tmp_path / "scan.jpg") == (False, None)


def test_what_two_turned_scans_disagree_in_says_how_uneven_the_scanner_is(rng: np.random.Generator) -> None:
    marks = np.stack(np.meshgrid(np.arange(0, 190, 8.0), np.arange(0, 190, 8.0)), axis=-1).reshape(-1, 2)
    print_mm = marks + 0.1 * np.sin(marks[:, ::-1] / 6)  # the printer's own, the same in both

    def seen(wave_mm: float, along: int) -> np.ndarray:
        carriage = wave_mm * np.sin(2 * np.pi * marks[:, along] / 90)
        return print_mm + carriage[:, None] * np.eye(2)[along] + rng.normal(0, 0.006, marks.shape)

    assert wave_left_mm([seen(0.0, 0), seen(0.0, 1)], marks) < 0.0015
    # an amplitude of 0.05 in one coordinate of either scan: 0.025 RMS of a coordinate, by √2 less in the mean of two
    assert wave_left_mm([seen(0.05, 0), seen(0.05, 1)], marks) == pytest.approx(0.0177, rel=0.15)
    assert wave_left_mm([seen(0.05, 0)], marks) == 0.0


@pytest.mark.parametrize(("size", "quality"), [(1.0, 92), (0.97, None), (0.97, 75), (1.03, 92), (0.99, 92)])
def test_a_picture_that_was_resized_is_noticed(plan, printed, size, quality):
    """Its file still states the scanner's resolution, whether it was saved as a JPEG or not."""
    scan = render_scan(printed, plan, dpi=300, rng=np.random.default_rng(10)).image
    picture = Image.fromarray(scan[..., ::-1])
    picture = picture.resize([round(size * length) for length in picture.size]) if size != 1.0 else picture
    if quality is not None:
        picture.save(file := io.BytesIO(), "JPEG", quality=quality)
        picture = Image.open(file)
    assert is_resampled(np.asarray(picture)[..., ::-1]) == (size != 1.0)
    assert resolution(np.asarray(picture)[..., ::-1], None, 300.0)[2] == (FLATBED if size == 1.0 else RESIZED)


@pytest.mark.parametrize("turned_deg", [0.0, 1.0])
def test_squared_paper_was_not_resized(rng, turned_deg):
    """Its lines repeat, too, but the noise between them does not."""
    along, across = np.cos(np.radians(turned_deg)), np.sin(np.radians(turned_deg))
    y, x = np.mgrid[:1500, :1500]
    lines = [np.abs((way + 30) % 59.06 - 30) < 1.5 for way in (along * x + across * y, along * y - across * x)]
    grey = 225.0 - 80.0 * (lines[0] | lines[1]) + rng.normal(0, 2.5, x.shape)
    assert not is_resampled(np.repeat(grey.astype(np.uint8)[:, :, None], 3, axis=2))
