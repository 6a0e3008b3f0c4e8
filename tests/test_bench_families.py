"""The families table: what is drawn, what a cell is, resuming, refusals."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from printmend.errors import InputError
from printmend.printer import Printer, read_printer
from printmend_lab.bench.case import OPTIMUM, Result, drawn_body, evaluate, row, row_parts
from printmend_lab.bench.families import (
    FAMILIES,
    ROWS,
    TEST_SEED,
    body_of,
    corruption_of,
    draw_family_cases,
    drawn_case,
    families_table,
    family_cells,
    family_markdown,
    family_tables,
)
from printmend_lab.sampling import families as corruption_families

CASE = drawn_case("families", "play", "damaged", 0.5, 0, 7)


@pytest.mark.parametrize("turns", [0.5, 1.0, 2.5])
def test_bodies_are_as_wide_as_they_say(turns: float, printer: Printer, rng: np.random.Generator) -> None:
    body = drawn_body(rng, printer, size_mm=40.0 * turns)
    assert len(body.layers) == 3
    for layer in body.layers:
        nominal = layer.nominal_steps * 0.2
        assert np.ptp(nominal, axis=0).max() == pytest.approx(40.0 * turns, abs=0.5)
        assert np.ptp(nominal, axis=0).min() > 0.7 * 40.0 * turns
        assert nominal.min() >= 0
        assert (nominal <= [printer.x.length_mm, printer.y.length_mm]).all()
        for axis in range(2):  # both ways along both axes
            assert 0.3 < (layer.controls[:, axis] > 0).sum() / (layer.controls[:, axis] != 0).sum() < 0.7
    assert not np.array_equal(body.layers[0].controls[-500:], body.layers[1].controls[-500:])


def test_draws_depend_on_nothing_else() -> None:
    """The fault is the same at every coverage, the body the same for every family; the noise has its own generator."""
    wide, other = replace(CASE, coverage=1.0), replace(CASE, family="smooth", severity="realistic")
    assert corruption_of(CASE) == corruption_of(wide)
    assert corruption_of(CASE) != corruption_of(replace(CASE, sample=1))
    assert corruption_of(CASE) != corruption_of(replace(CASE, seed=8))
    printer = read_printer("ender5")
    mine, theirs = body_of(CASE, printer), body_of(other, printer)
    assert np.array_equal(mine.layers[2].controls, theirs.layers[2].controls)
    assert len({CASE.key("a"), CASE.key("b"), wide.key("a"), other.key("a")}) == 4


def test_a_perfect_model_is_the_optimum_and_naive_is_not() -> None:
    results = {item.row: item for item in evaluate(CASE, ("naive+greedy", "oracle+lookahead", OPTIMUM))}
    assert all(item.error is None for item in results.values())
    errors = {name: item.value("rmse_steps") or 0.0 for name, item in results.items()}
    assert errors[OPTIMUM] <= errors["oracle+lookahead"] + 1e-9
    assert errors[OPTIMUM] < 0.7
    assert errors["naive+greedy"] > 1.5 * errors[OPTIMUM]


def test_learning_from_a_noisy_print_comes_near() -> None:
    (noisy, best) = evaluate(CASE, ("greybox+optimal@0.05", OPTIMUM))
    assert noisy.error is None
    assert noisy.values["rmse_steps"] < 1.3 * best.values["rmse_steps"]


def test_jumps_spoil_only_the_test_print() -> None:
    (best,) = evaluate(replace(CASE, family="jumps"), (OPTIMUM,))
    assert best.value("rmse_steps") == pytest.approx(0.0, abs=1e-9)


def result(row: str, sample: int, rmse: float | None) -> Result:
    case = drawn_case("families", "play", "damaged", 1.0, sample, 0)
    return Result(case, row, {} if rmse is None else {"rmse_steps": rmse}, None if rmse is not None else "no reason")


def test_a_cell_is_the_mean_and_its_ratio() -> None:
    rows = [(OPTIMUM, 0, 0.5), (OPTIMUM, 1, 1.5), ("greybox+optimal", 0, 1.0), ("greybox+optimal", 1, 1.5)]
    cells = family_cells([result(*item) for item in rows], (0.0,))
    mine = next(cell for cell in cells if cell.label == "greybox+optimal")
    assert (mine.samples, mine.failures) == (2, 0)
    assert (mine.rmse_steps, mine.optimum_steps, mine.ratio) == (1.25, 1.0, 1.25)
    assert (mine.median_ratio, mine.worst_ratio) == (1.5, 2.0)
    assert next(cell for cell in cells if cell.label == OPTIMUM).ratio == 1.0


def test_what_failed_is_left_out_and_marked() -> None:
    cells = family_cells([result(OPTIMUM, 0, 0.5), result(OPTIMUM, 1, 0.5), result("naive+greedy", 0, 1.0),
                          result("naive+greedy", 1, None)], (0.0, 0.1))  # fmt: skip
    naive = [cell for cell in cells if cell.label == "naive+greedy"]
    assert [(cell.noise_mm, cell.failures, cell.ratio) for cell in naive] == [(0.0, 1, 2.0), (0.1, 1, 2.0)]
    title, header, lines = family_tables(cells, (1.0, 2.0), (0.0, 0.1))[1]
    assert title == "naive+greedy"
    assert len(header) == 5
    assert lines == [("play damaged", "1.000 (2.00)*", "1.000 (2.00)*", "–", "–")]


def test_the_docs_table_has_a_line_a_family_and_both_severities() -> None:
    results = [result(OPTIMUM, 0, 0.5), result("naive+greedy", 0, 100.0), result("greybox+optimal", 0, 0.6)]
    results += [
        Result(replace(item.case, severity="realistic"), item.row, {"rmse_steps": 0.25})
        for item in results
        if item.row != "naive+greedy"
    ]
    text = family_markdown(family_cells(results, (0.0,)), (1.0,), (0.0,))
    assert "**naive+greedy**" in text
    assert text.splitlines()[-3:] == [
        "| family | optimum | naive | 1 turn σ 0 |",
        "| --- | ---: | ---: | ---: |",
        "| play | 0.50 / 0.25 | 100 | 1.20 / 1.00 |",
    ]


def test_an_optimum_of_no_error_has_no_ratio_but_its_equal_has() -> None:
    best = [result(OPTIMUM, sample, 0.0) for sample in range(2)]
    equal = family_cells([*best, result("naive+greedy", 0, 0.0), result("naive+greedy", 1, 0.0)], (0.0,))[1]
    assert (equal.ratio, equal.worst_ratio) == (1.0, 1.0)
    worse = family_cells([*best, result("naive+greedy", 0, 0.0), result("naive+greedy", 1, 3.0)], (0.0,))
    assert (worse[1].rmse_steps, worse[1].ratio) == (1.5, None)
    assert family_tables(worse, (1.0,), (0.0,))[1][2] == [("play damaged", "1.500 (–)")]


def test_a_run_resumes(tmp_path: Path) -> None:
    cases = draw_family_cases(["play", "ripple@corexy"], severities=["damaged"], coverages=[0.5], samples=1, seed=3)
    first = families_table(cases[:1], ["naive+greedy"], (0.0,), tmp_path)
    lines = (tmp_path / "families.jsonl").read_text().splitlines()
    assert len(lines) == len(first) == 2  # the row and the optimum
    second = families_table(cases, ["naive+greedy"], (0.0,), tmp_path)
    again = (tmp_path / "families.jsonl").read_text().splitlines()
    assert again[:2] == lines
    assert second[:2] == first
    assert {item.case.printer for item in second} == {"ender5", "corexy"}


def test_the_command_prints_cells(tmp_path: Path) -> None:
    from printmend_lab.cli.bench import command

    args = ["families", "--families", "play", "--severity", "damaged", "--coverage", "0.5", "--noise", "0,0.1",
            "--rows", "naive+greedy", "--samples", "1", "--out", str(tmp_path), "--json"]  # fmt: skip
    done = CliRunner().invoke(command, args)
    assert done.exit_code == 0, done.output
    cells = json.loads(done.stdout)["cells"]
    assert {cell["noise_mm"] for cell in cells} == {0.0, 0.1}
    assert all(cell["ratio"] >= 1 for cell in cells)
    shown = CliRunner().invoke(command, args[:-1])
    assert "play damaged" in shown.output
    assert (tmp_path / "families.md").read_text().startswith("**naive+greedy**")
    assert len((tmp_path / "families.csv").read_text().splitlines()) == 1 + len(cells)


def test_every_family_has_a_row() -> None:
    covered = {name.partition("@")[0] for name in FAMILIES}
    assert set(corruption_families()) - covered == {"gain-table"}
    assert draw_family_cases(FAMILIES, samples=1, seed=0)
    for name in ROWS:
        row(name)
    assert TEST_SEED != 0


@pytest.mark.parametrize("name", ["banana", "gain-table", "play@nowhere"])
def test_unknown_families_are_refused(name: str) -> None:
    with pytest.raises(InputError, match=r"famil(y|ies)|printer"):
        draw_family_cases([name], samples=1, seed=0)


@pytest.mark.parametrize("name", ["greybox@much", "greybox@-1", "greybox@nan"])
def test_wrong_noises_are_refused(name: str) -> None:
    with pytest.raises(InputError, match="noise"):
        row_parts(name)
