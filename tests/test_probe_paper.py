"""A sheet of paper takes the probe: as plastic, or drawn with a pen; patterns fit the glass that will see them."""

import re

import numpy as np
import pytest
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.cli.probe import command
from printmend.corruption import Corruption, Drive, EccentricBore, Play
from printmend.errors import ConfigError, ScanError
from printmend.gcode.read import read_gcode
from printmend.gcode.sliced import find_test_print, is_test_print
from printmend.learn.learned import learn_model
from printmend.measure import read_plan
from printmend.measure.image import write_image
from printmend.measure.measurement import measure_scans
from printmend.path import FLATBED
from printmend.printer import read_printer
from printmend.probe import design_probe
from printmend.probe.gcode import probe_gcode
from printmend.probe.layout import glass_area_mm
from printmend.probe.paper import on_paper, paper_for, papers_of
from printmend.probe.pen import pen_gcode, with_pen
from printmend.twin import Twin
from printmend.twin.gcode import print_gcode
from printmend.twin.scanner import DEFAULT, render_scan
from printmend.units import A4_MM, LETTER_MM
from tests import foreign_layer as foreign

PRINTER = read_printer("ender3")


def run(folder, *options: str):
    gcode = folder / "probe.gcode"
    outcome = CliRunner().invoke(command, ["--printer", "ender3", "-o", str(gcode), *options])
    assert outcome.exit_code == 0, outcome.output
    assert is_test_print(gcode)
    assert find_test_print(b"\xef\xbb\xbf" + gcode.read_bytes()) == "probe"  # as an editor saves it
    leaflet(folder, f"{gcode.name}: ", "printmend learn probe.csv --printer ender3")
    return gcode, read_plan(folder / "probe.json")


def leaflet(folder, *words: str) -> bytes:
    """The page beside a test print: a PDF whose table of objects is right, with these words on it."""
    data = (folder / "probe-how-to.pdf").read_bytes()
    table = data[int(data.split(b"startxref")[1].split()[0]) :]
    places = [int(line.split()[0]) for line in table.splitlines() if line.endswith(b" n ")]
    assert len(places) == 4
    assert all(data[at:].startswith(b"%d 0 obj" % number) for number, at in enumerate(places, start=1))
    for one in words:
        assert one.encode("cp1252") in data
    return data


def test_the_page_speaks_german(tmp_path):
    gcode = tmp_path / "probe.gcode"
    asked = ["--lang", "de", "probe", "--printer", "ender3", "--on", "paper", "-o", str(gcode)]
    assert CliRunner().invoke(group, asked).exit_code == 0
    page = leaflet(tmp_path, "Ihr Testdruck, auf Papier", "Das Blatt mit der bedruckten Seite nach unten scannen",
                   "Schwarz")  # fmt: skip
    assert b"Scan the" not in page
    assert b"sheet" not in page


def test_a_pen_shows_what_plastic_would(tmp_path):
    gcode, plan = run(tmp_path, "--pen", "--size", "80")
    text = gcode.read_text()
    assert not read_gcode(gcode, printer=PRINTER).moves.extrusion_mm.any()
    assert "\nM109" not in text
    assert "tip 104 mm from its left edge, 4 mm from its front edge" in text
    leaflet(tmp_path, "with a pen on paper", "It pauses \\(M0\\)",
            "The first dot sets the height")  # fmt: skip
    dabs = text.split("\nM0 ")  # until the pen is in; until the paper is under it; the guided dot; the drawing
    assert len(dabs) == 4
    assert not re.search(r"[XY]\d", dabs[2])
    assert dabs[2].count("\nG1 Z4.9 ") == 20
    assert dabs[3].index("\nG1 Z4.9 ") < dabs[3].index("\nG0 X")
    broken = Twin.of(
        Corruption((Drive(pulley=EccentricBore(0.3, 0.4), belt=Play(0.3)), Drive(belt=Play(0.2)))), PRINTER
    )
    printed = print_gcode(read_gcode(gcode, printer=PRINTER), broken)
    assert np.allclose(printed.commanded_mm, plan.waypoints_mm)
    scan = render_scan(
        printed.measured_mm[plan.rows], plan, dpi=300, degradations=DEFAULT, rng=np.random.default_rng(1)
    )
    write_image(tmp_path / "scan.png", scan.image, dpi=300)
    trace = measure_scans([tmp_path / "scan.png"], plan).trace
    assert not np.isfinite(trace.measured_mm[plan.rows[plan.big]]).any()
    model = learn_model(trace, PRINTER)
    left = Twin(model.mechanism).follow(plan.waypoints_mm) - printed.measured_mm
    assert np.std(left[plan.rows], axis=0).max() < 0.015


def test_a_pen_waits_by_what_the_firmware_knows():
    voron = read_printer("voron2-250")
    assert voron.pause_gcode == "PAUSE"
    text = pen_gcode(with_pen(design_probe(voron, size_mm=60.0, marks=40)), pause_gcode=voron.pause_gcode)
    assert "\nM0" not in text
    assert text.count("\nPAUSE\n") == 2
    assert "\nG4 P120000\n" in text  # a pause may park the tool head: laying the paper has its time


def test_paper_and_glass_limit_the_pattern(tmp_path):
    gcode, plan = run(tmp_path, "--on", "paper", "--scanner", "letter")
    assert "G1 Z0.34" in gcode.read_text()
    page = leaflet(
        tmp_path, "Tape a sheet of paper \\(letter, upright\\) flat", "X 2, Y 0; 59 mm hang over", "Black is best"
    )
    assert b"pauses" not in page
    low, high = glass_area_mm(PRINTER, (215.9, 279.4))
    assert (plan.marks_mm >= low - 0.01).all()
    assert (plan.marks_mm <= high + 0.01).all()
    _, small = run(tmp_path, "--scanner", "120x100", "--overwrite")
    assert np.ptp(small.marks_mm, axis=0).max() <= 104.01
    with pytest.raises(ConfigError, match="glass of at least"):
        glass_area_mm(PRINTER, (40.0, 300.0))
    bad = CliRunner().invoke(command, ["--printer", "ender3", "--scanner", "big"])
    assert bad.exit_code == 2
    assert "a4, letter" in bad.output


BROKEN = foreign.Machine(waves=(((1, 0.25, 0.5),), ((1, 0.15, 2.0),)), play=(0.3, 0.15))


def _radii(filament: np.ndarray, small: float, large: float) -> np.ndarray:
    return np.where(filament > 1.4 * filament.min(), large, small) / 2


def test_a_net_joins_the_dots_and_does_not_hide_them(tmp_path):
    rng = np.random.default_rng(4)
    gcode, plan = run(tmp_path, "--net", "--size", "70")
    leaflet(tmp_path, "joined by a net", "lift the frame")
    assert np.allclose(foreign.way(gcode)[0], plan.waypoints_mm[1:])
    dots, filament, threads = foreign.printed_dots(gcode, BROKEN)
    radii = _radii(filament, plan.dot_mm, plan.big_dot_mm)
    (tmp_path / "net.jpg").write_bytes(foreign.plate(dots, radii, rng, threads=threads))
    measured = measure_scans([tmp_path / "net.jpg"], plan)
    assert len(measured.missing) < 0.02 * len(plan)
    off = measured.measured_mm - dots
    off = off[np.isfinite(off).all(axis=1)]
    assert np.sqrt(np.square(off - np.median(off, axis=0)).mean()) < 0.03
    model = learn_model(measured.trace, PRINTER)
    left = Twin(model.mechanism).follow(plan.waypoints_mm)[plan.rows] - dots
    assert np.std(left, axis=0).max() < 0.015
    # a photo without tags and without a note of its camera is told by its perspective
    (tmp_path / "photo.jpg").write_bytes(foreign.plate(dots, radii, rng, threads=threads, narrow=0.01))
    with pytest.raises(ScanError, match=r"narrows by 1\.\d% to one side, as a photo does"):
        measure_scans([tmp_path / "photo.jpg"], plan)


@pytest.mark.parametrize("printer", ["prusa-mini", "cr10s"])
def test_all_of_a_print_on_paper_lies_on_its_sheet(printer):
    """The prime line is on the sheet, clear of its edge and of the dots, on small beds and on large ones."""
    machine = read_printer(printer)
    for size in (A4_MM, LETTER_MM, (120.0, 100.0)):
        plan = design_probe(machine, glass_mm=size)
        (paper,) = papers_of(plan, machine, size)
        plan = on_paper(plan, machine, (paper,))
        drawn = np.vstack([plan.waypoints_mm[1:3], plan.marks_mm])
        assert (drawn >= paper.low_mm + 3.9).all()
        assert (drawn <= paper.high_mm - 3.9).all()
        assert plan.marks_mm[:, 1].min() - plan.waypoints_mm[1, 1] > 3.4
        assert np.ptp(plan.waypoints_mm[1:3, 0]) > 80
        assert paper.low_mm[1] >= machine.y.min_mm
        assert "\nM190" not in probe_gcode(plan, paper=paper)  # a warm bed would dry it
        assert plan.seen_by(FLATBED).paper_sd > 0
    with pytest.raises(ConfigError, match="expected a sheet for dots over"):
        papers_of(plan, machine, (60.0, 60.0))
    assert paper_for((216.0, 297.0)) == A4_MM


def test_sheets_that_could_not_be_joined_are_not_printed(tmp_path):
    few = ["--printer", "ender3", "--on", "paper", "--scanner", "110x140", "--sheets", "2", "--dots", "60"]
    refused = CliRunner().invoke(command, [*few, "-o", str(tmp_path / "few.gcode")])
    assert isinstance(refused.exception, ConfigError)
    assert "expected at least 30 dots where two sheets overlap" in str(refused.exception)
    assert "more --dots" in str(refused.exception)
    needless = ["--printer", "prusa-mini", "--pen", "--sheets", "2", "--sheet", str(tmp_path / "tags.pdf")]
    with pytest.raises(ConfigError, match="2 show no more of its bed"):
        CliRunner().invoke(command, [*needless, "-o", str(tmp_path / "mini.gcode")], catch_exceptions=False)
    misused = CliRunner().invoke(command, ["--printer", "ender3", "--net", "--pen", "--sheet", str(tmp_path / "a.pdf")])
    assert misused.exit_code == 2
    assert not (tmp_path / "a.pdf").exists()
    assert not list(tmp_path.glob("*.gcode"))
