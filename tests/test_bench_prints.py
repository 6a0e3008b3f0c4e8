"""The table of test prints: paths that are measured where they say, cells, resuming, refusals."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from printmend.errors import InputError
from printmend.printer import Printer
from printmend_lab.bench.case import OPTIMUM, Result
from printmend_lab.bench.families import body_of, drawn_case
from printmend_lab.bench.prints import (
    SHAPES,
    body_program,
    draw_print_cases,
    layer_mm,
    path_print,
    print_lines,
    read_row,
)
from printmend_lab.cli.bench import command

CASE = drawn_case("prints", "pulley-play", "damaged", 1.0, 0, 11)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_shape_is_measured_evenly_and_stays_on_the_bed(shape: str, printer: Printer, rng: np.random.Generator):
    path = SHAPES[shape](printer, rng)
    print_ = path_print(printer, path, 60)
    assert len(print_.rows) == 60
    np.testing.assert_array_equal(print_.waypoints_mm[0], printer.home_mm)
    for corner in path:
        assert np.abs(print_.waypoints_mm - corner).max(axis=1).min() < 1e-9
    way = print_.waypoints_mm[1:]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])[print_.rows - 1]
    np.testing.assert_allclose(np.diff(along), along[-1] / 59, rtol=1e-6)
    assert (way >= [printer.x.min_mm, printer.y.min_mm]).all()
    assert (way <= [printer.x.max_mm, printer.y.max_mm]).all()


def test_a_body_is_the_same_as_g_code(printer: Printer):
    body = body_of(CASE, printer)
    moves = body_program(body, printer).moves
    for layer in body.layers:
        ends = moves.end_mm[(moves.layer == layer.index) & moves.extruding, :2]
        np.testing.assert_allclose(ends, layer_mm(layer, printer)[1:], atol=1e-4)


def test_cells_are_means_and_their_ratio():
    def result(label: str, sample: int, rmse: float | None) -> Result:
        case = drawn_case("prints", "play", "damaged", 1.0, sample, 0)
        name = label if label == OPTIMUM else f"{label}@60@0"
        return Result(case, name, {"rmse_steps": rmse}, None if rmse is not None else "no reason")

    results = [result(OPTIMUM, 0, 0.5), result(OPTIMUM, 1, 1.5), result("fixed", 0, 1.0), result("fixed", 1, 2.0),
               result("circle", 0, 1.0), result("circle", 1, None)]  # fmt: skip
    header, lines = print_lines(results, (60,), (0.0,))
    assert header == ("test print", "60 pts σ 0")
    assert lines == [("fixed", "1.50 (1.50)"), ("circle", "1.00 (2.00)*")]


def test_what_does_not_exist_is_refused():
    with pytest.raises(InputError, match="diagonal-and-back"):
        read_row("spiral@60@0")
    with pytest.raises(InputError, match="gain-table"):
        draw_print_cases(["gain-table"], samples=1, seed=0)


def test_the_command_writes_and_resumes(tmp_path: Path):
    args = ["prints", "--families", "elastic", "--prints", "circle", "--points", "60", "--noise", "0.1",
            "--samples", "1", "--out", str(tmp_path)]  # fmt: skip
    first = CliRunner().invoke(command, args)
    assert first.exit_code == 0, first.output
    kept = (tmp_path / "prints.jsonl").read_text()
    assert len(kept.splitlines()) == 2
    assert CliRunner().invoke(command, args).stdout == first.stdout
    assert (tmp_path / "prints.jsonl").read_text() == kept
    assert (tmp_path / "prints.md").read_text().startswith("| test print | 60 pts σ 0.1 |")
