"""Pictures: Axes in, the same Axes out, with what belongs in them; equal pictures give equal bytes."""

import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import Normalize

from printmend.draw import PrintedLayer, comparison, draw_above, draw_alike, new_figure, save
from printmend.draw.body import above_view, add_beads, runs
from printmend.draw.document import Numbers, write_pdf
from printmend.draw.figure import Wear, draw_wear, points_per_unit
from printmend.printer import Printer
from printmend_lab.draw import (
    draw_axis_error,
    draw_histogram,
    draw_log_histogram,
    draw_solid,
    printed_layer,
    project,
    solid_view,
)
from tests.bodies import circle_body

COLOURS = Normalize(0, 1)


@pytest.fixture
def layers(ender5: Printer) -> list[PrintedLayer]:
    body = circle_body(layers=3, radius_steps=20)
    return [printed_layer(layer, layer.nominal_steps + np.array([3.0, 4.0]), ender5) for layer in body.layers]


@pytest.fixture
def axes() -> Axes:
    return new_figure()[1][0]


def test_a_printed_layer_is_in_mm_with_the_distance_of_every_point(layers: list[PrintedLayer]) -> None:
    assert layers[0].error_mm == pytest.approx(np.full(len(layers[0].error_mm), 1.0))
    assert layers[0].points_mm[0] == pytest.approx([0.2 * (550 + 20 + 3), 0.2 * 554])


def test_runs_cover_each_extruded_segment_once_and_no_travel(rng: np.random.Generator) -> None:
    points = rng.normal(size=(201, 2))
    extruding = rng.uniform(size=200) < 0.7
    lines, errors = runs(points, extruding, np.arange(201.0))
    drawn = {tuple(np.concatenate(pair)) for line in lines for pair in pairwise(line)}
    assert drawn == {tuple(np.concatenate([points[t], points[t + 1]])) for t in np.flatnonzero(extruding)}
    number = {x: t for t, x in enumerate(points[:, 0])}  # which is its error, too
    assert errors == pytest.approx([np.mean([number[x] for x in line[:, 0]]) for line in lines])
    assert sum(len(line) - 1 for line in lines) == extruding.sum()


@pytest.mark.parametrize(("draw", "view"), [(draw_above, above_view), (draw_solid, solid_view)])
def test_a_body_is_drawn_within_its_axes(draw, view, layers: list[PrintedLayer], axes: Axes) -> None:
    assert draw(axes, layers, colours=COLOURS, view_mm=view(layers)) is axes
    shown = [path.vertices for item in axes.collections for path in item.get_paths()]
    points = np.concatenate(shown)
    assert len(shown) >= 3 * 20
    assert (points >= [axes.get_xlim()[0], axes.get_ylim()[0]]).all()
    assert (points <= [axes.get_xlim()[1], axes.get_ylim()[1]]).all()
    assert axes.get_aspect() == 1


def test_a_layer_that_does_not_extrude_draws_nothing(layers: list[PrintedLayer], axes: Axes) -> None:
    idle = PrintedLayer(0.2, layers[0].points_mm, np.zeros_like(layers[0].extruding), layers[0].error_mm)
    draw_solid(axes, [idle], colours=COLOURS, view_mm=solid_view([idle]))
    draw_above(axes, [idle], colours=COLOURS, view_mm=above_view([idle]))
    assert not axes.collections


def test_what_is_nearer_or_higher_is_drawn_where_the_eye_expects_it() -> None:
    near, far = project(np.array([[0.0, -10.0], [0.0, 10.0]]), 0.0)
    assert near[1] < far[1]
    assert project(np.array([[0.0, 0.0]]), 5.0)[0, 1] > project(np.array([[0.0, 0.0]]), 0.0)[0, 1]


def test_a_bead_is_as_wide_as_it_says(axes: Axes) -> None:
    axes.set_xlim(0, 10)
    axes.set_ylim(0, 10)
    axes.set_aspect("equal")
    add_beads(axes, [np.array([[0, 5], [10, 5]])], np.zeros((1, 3)), bead_mm=2.0, order=0)
    box = axes.get_position()
    inches = min(box.width, box.height) * 5.0
    assert axes.collections[0].get_linewidths()[0] == pytest.approx(2.0 / 10 * inches * 72)
    assert points_per_unit(axes) == pytest.approx(inches * 72 / 10)


def test_prints_that_are_compared_have_one_scale(layers: list[PrintedLayer]) -> None:
    wide = replace(layers[0], points_mm=layers[0].points_mm * [1.1, 1.0])
    _, panels = new_figure(2)
    for one, draw in zip(panels, draw_alike([layers[0], wide], colours=COLOURS), strict=True):
        draw(one)
    assert points_per_unit(panels[0]) == pytest.approx(points_per_unit(panels[1]))
    assert panels[0].get_xlim() == panels[1].get_xlim()


def test_the_error_along_an_axis() -> None:
    other = new_figure()[1][0]
    x = np.concatenate([np.arange(50.0), np.arange(50.0, 0, -1)])
    assert draw_axis_error(other, x, x + 0.1 * np.sign(np.gradient(x)), axis_name="x") is other
    forwards = next(line for line in other.lines if line.get_label() == "moving forwards")
    assert len(forwards.get_xdata()) == 50


def test_histograms_count_every_body(axes: Axes) -> None:
    values = np.array([0.0, 1.0, 99.0, 100.0, 250.0, 4000.0])
    draw_histogram(axes, values, name="naive")
    assert sum(bar.get_height() for bar in axes.patches) == len(values)
    assert "2 of 6 above" in axes.get_xlabel()
    other = new_figure()[1][0]
    draw_log_histogram(other, {"naive": values, "oracle": values / 10 + 0.1})
    assert other.get_xscale() == "log"
    assert other.get_xlim()[1] > 4000


def test_a_comparison_is_the_same_file_twice(layers: list[PrintedLayer], tmp_path: Path) -> None:
    drawn = []
    for name in ("one.png", "two.png"):
        draw = [lambda axes: draw_above(axes, layers, colours=COLOURS, view_mm=above_view(layers))] * 2
        drawn.append(
            save(comparison(["a", "b"], draw, title="both", colours=COLOURS), tmp_path / name, dpi=50).read_bytes()
        )
    assert drawn[0] == drawn[1]
    assert drawn[0].startswith(b"\x89PNG")


def test_drawing_never_touches_the_global_state_of_pyplot() -> None:
    code = "import sys, printmend.draw; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0  # noqa: S603 – our own interpreter


def test_the_error_bar_lies_under_the_pictures_that_have_its_colours() -> None:
    figure = comparison("abcd", [lambda axes: axes] * 4, title="parts", colours=COLOURS, first=2)
    left, _, shown, bar = (figure.axes[k].get_position() for k in (1, 2, 3, 4))
    assert left.x1 < bar.x0 < bar.x1 < shown.x1
    assert figure.get_suptitle() == "Parts"


def test_measurements_of_one_day_are_drawn_over_days(axes: Axes) -> None:
    draw_wear(axes, Wear("play", "mm", [1.8e9], [0.3], [0.01], None, [(0.1, "much")], None, None), "red")
    axes.figure.canvas.draw()
    assert {len(label.get_text()) for label in axes.get_xticklabels()} == {len("2027-01-15")}


def test_a_table_of_long_words_stays_on_its_sheet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table, drawn = pytest.importorskip("reportlab.platypus").Table, []

    def wrap(self: object, room: float, high: float, wrap=table.wrap) -> tuple[float, float]:
        drawn.append((wrap(self, room, high)[0], room))
        return wrap(self, room, high)

    monkeypatch.setattr(table, "wrap", wrap)
    rows = [("in the standard", "in other words", "X", "Y"), ("deviation " * 5, "what is lost " * 9, "0.598", "0.202")]
    write_pdf(tmp_path / "table.pdf", "table", [Numbers("", rows, words=2)], foot="")
    assert drawn
    assert all(wide < room + 0.01 for wide, room in drawn)
