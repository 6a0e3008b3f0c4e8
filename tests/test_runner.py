"""The runner of the benchmarks: rows in the order of the cases, kept, and taken up again."""

import argparse
import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "runner.py"


@pytest.fixture
def runner() -> ModuleType:
    spec = importlib.util.spec_from_file_location("runner", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def squared(options: argparse.Namespace, case: tuple[str, int]) -> dict[str, object]:
    return {"square": np.float64(case[1] ** 2), "seed": options.seed, "name": case[0]}


def refused(options: argparse.Namespace, case: tuple[str, int]) -> dict[str, object]:
    raise AssertionError(case)


def test_rows_are_kept_and_taken_up_again(runner: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "rows.csv"
    monkeypatch.setattr("sys.argv", ["bench.py", "--seed", "3", "--rows", str(file), "--kind", "b"])
    options = runner.options_of("A script.", draws=2, kind=("a", "b"))
    assert (options.draws, options.kind, options.workers) == (2, ["b"], 1)
    cases = [("a", 1), ("b", 2)]
    first = list(runner.rows_of(squared, cases, options))
    assert [case for case, _ in first] == cases
    head, names, *rows = file.read_text().splitlines()
    assert head.startswith("# bench.py --seed 3 --kind b; seed 3; commit ")
    assert (names, len(rows)) == ("case,square,seed,name", 2)
    assert list(runner.rows_of(refused, cases, options)) == first
    file.write_text(file.read_text()[:-4])  # cut short while the last row was written
    assert list(runner.rows_of(refused, cases[:1], options)) == first[:1]
    assert list(runner.rows_of(squared, cases, options)) == first
    monkeypatch.setattr("sys.argv", ["bench.py", "--seed", "4", "--rows", str(file)])
    with pytest.raises(SystemExit, match="made by another command, seed or commit"):
        next(runner.rows_of(squared, cases, runner.options_of("A script.")))
