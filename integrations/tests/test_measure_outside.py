"""The scan's way from the commands alone, on a printer and with a picture that share no code with printmend."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from benchmarks import outside, outside_scan
from click.testing import CliRunner

from printmend.cli.main import group

HOME = (0.0, 0.0)
PART = """G21
G90
M83
G28
G1 Z0.2 F600
G0 X80 Y80 F6000
G1 X135 Y80 E3 F1800
G1 X135 Y140 E3
G1 X80 Y140 E3
G1 X80 Y80 E3
G1 X130 Y138 E3
"""


def typed(*arguments: str) -> str:
    result = CliRunner().invoke(group, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def contour_mm(text: str, drives: tuple[outside.Drive, outside.Drive]) -> np.ndarray:
    """Distances of the printed strokes from those of PART, on the bed: the place counts."""
    wanted = shapely.MultiLineString(
        [(m.start_mm, m.end_mm) for m in outside.read_moves(PART, HOME) if m.extruding and m.start_mm != m.end_mm]
    )
    moves = outside.read_moves(text, HOME)
    printed = outside.print_moves(moves, drives, HOME)
    beads = [way for m, way in zip(moves, printed, strict=True) if m.extruding and m.start_mm != m.end_mm]
    return shapely.distance(shapely.points(np.concatenate(beads)), wanted)


@pytest.mark.parametrize(
    ("name", "kind", "look"),
    [
        ("scan.jpg", "rgb", outside_scan.Look((210, 214, 216), (30, 30, 34), dpi=300, turn_deg=33)),
        ("scan.tif", "grey16", outside_scan.Look(dpi=300, turn_deg=-100, mirrored=True, noise=6.0)),
        ("scan.png", "palette", outside_scan.Look((50, 60, 190), (235, 235, 235), dpi=400, turn_deg=180)),
    ],
)
def test_a_foreign_scan_of_a_foreign_printer_mends_a_part_in_its_place(tmp_path, name, kind, look):
    rng = np.random.default_rng(6)  # both belts home engaged: where they sit loose, no scan can show it
    drives = tuple(outside.random_drive(rng, "pulley+play", 0.0, -1, 220.0)[1] for _ in range(2))
    probe = tmp_path / "probe.gcode"
    typed("probe", "--printer", "ender3", "--size", "110", "-o", str(probe))
    moves = outside.read_moves(probe.read_text(), HOME)
    printed = outside.print_moves(moves, drives, HOME, pitch_mm=1e9)
    picture = outside_scan.draw(outside_scan.read_beads(probe.read_text(), moves, printed), look, rng)
    outside_scan.save(tmp_path / name, picture, kind, look.dpi)
    trace, model = str(tmp_path / "trace.csv"), str(tmp_path / "printer.mend.json")
    typed("measure", str(tmp_path / name), "--probe", str(tmp_path / "probe.json"), "-o", trace)
    typed("learn", trace, "--printer", "ender3", "-o", model)
    part, mended = tmp_path / "part.gcode", tmp_path / "mended.gcode"
    part.write_text(PART)
    typed("mend", str(part), "-m", model, "-o", str(mended))
    assert np.sqrt(np.mean(contour_mm(PART, drives) ** 2)) > 0.5
    assert np.sqrt(np.mean(contour_mm(Path(mended).read_text(), drives) ** 2)) < 0.03
