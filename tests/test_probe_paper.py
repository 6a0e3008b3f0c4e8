"""A sheet of paper takes the probe: as plastic, or drawn with a pen; patterns fit the glass that will see them."""

import numpy as np
import pytest
from click.testing import CliRunner

from printmend.cli.probe import command
from printmend.corruption import Corruption, Drive, EccentricBore, Play
from printmend.errors import ConfigError
from printmend.gcode.mark import is_test_print
from printmend.gcode.read import read_gcode
from printmend.measure import read_plan
from printmend.measure.image import write_image
from printmend.measure.measurement import measure_scans
from printmend.printer import read_printer
from printmend.probe.layout import glass_area_mm
from printmend.repair.learned import learn_model
from printmend.twin import Twin
from printmend.twin.gcode import print_gcode
from printmend.twin.scanner import DEFAULT, render_scan

PRINTER = read_printer("ender3")


def run(folder, *options: str):
    gcode = folder / "probe.gcode"
    outcome = CliRunner().invoke(command, ["--printer", "ender3", "-o", str(gcode), *options])
    assert outcome.exit_code == 0, outcome.output
    assert is_test_print(gcode)
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


def test_a_pen_shows_what_plastic_would(tmp_path):
    gcode, plan = run(tmp_path, "--pen", "--size", "80")
    text = gcode.read_text()
    assert not read_gcode(gcode, printer=PRINTER).moves.extrusion_mm.any()
    assert "\nM109" not in text
    assert b"The file pauses twice" in leaflet(tmp_path, "with a pen on paper")
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


def test_paper_and_glass_limit_the_pattern(tmp_path):
    gcode, plan = run(tmp_path, "--on", "paper", "--scanner", "letter")
    assert "G1 Z0.34" in gcode.read_text()
    assert b"pauses" not in leaflet(tmp_path, "Tape a sheet of paper flat", "Black is best")
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
