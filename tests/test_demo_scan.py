"""How the demonstration from the test plate to the mended part judges its result, and what it refuses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.corruption import HEALTHY, Corruption, Drive, EccentricBore, Play
from printmend.demo import contour
from printmend.errors import InputError
from printmend.gcode.read import read_gcode
from printmend.metrics.shape import stroke_distances
from printmend.twin import Twin
from tests.mending import ENDER3, SQUARE

BROKEN = Corruption((Drive(pulley=EccentricBore(0.6, 1.0), belt=Play(0.4)), Drive(belt=Play(0.3))))


def test_a_healthy_print_has_no_contour_error() -> None:
    program = read_gcode(SQUARE, printer=ENDER3)
    way = contour.run(program, Twin.of(HEALTHY, ENDER3))
    error, shift = contour.contour_error(way, way)
    assert error.max < 0.01  # micro-steps
    assert np.abs(shift).max() < 0.01


@pytest.mark.parametrize("shift", [(0.0, 0.0), (3.0, -2.0)])
def test_where_a_part_lies_is_no_contour_error(shift: tuple[float, float]) -> None:
    way = contour.run(read_gcode(SQUARE, printer=ENDER3), Twin.of(BROKEN, ENDER3))
    moved = replace(way, printed_mm=way.printed_mm + shift)
    (error, taken), (again, taken_again) = contour.contour_error(way, way), contour.contour_error(way, moved)
    assert error.rms > 0.05
    assert again.rms == pytest.approx(error.rms, rel=0.02)
    assert np.abs(taken_again - taken + shift).max() < 0.02


def test_stroke_distances_are_those_of_shapely(rng: np.random.Generator) -> None:
    strokes, points = rng.uniform(0, 10, (20, 2, 2)), rng.uniform(0, 10, (50, 2))
    distances, steps = stroke_distances(strokes, points)
    lines = [shapely.LineString(stroke) for stroke in strokes]
    for point, distance, step in zip(points, distances, steps, strict=True):
        assert distance == pytest.approx(min(line.distance(shapely.Point(point)) for line in lines), abs=1e-12)
        assert min(line.distance(shapely.Point(point + step)) for line in lines) < 1e-9


def test_bad_input_ends_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    result = CliRunner().invoke(group, ["demo", "--scan", "--out", str(tmp_path / "file")])
    assert isinstance(result.exception, InputError)
    result = CliRunner().invoke(group, ["demo", "--scan", "--body", str(tmp_path / "none.gcode")])
    assert isinstance(result.exception, InputError)
    assert "\n" not in str(result.exception)
