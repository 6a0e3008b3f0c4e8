"""The commands bench, dataset and demo, as a user types them."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from printmend.cli.main import main
from printmend_lab.bench.case import Case, Result
from printmend_lab.bench.table1 import Line, Part, stands_still
from printmend_lab.dataset.reference import write_reference
from printmend_lab.demo.figures import table_lines
from tests.bodies import circle_body, write_vase


@pytest.fixture
def printmend(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """Run the command line in this process: (exit code, stdout, stderr)."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["printmend", *map(str, arguments)])
        with pytest.raises(SystemExit) as caught:
            main()
        out, err = capsys.readouterr()
        return int(caught.value.code or 0), out, err

    return run


@pytest.fixture
def vase(tmp_path: Path) -> Path:
    return write_vase(tmp_path / "vase.gcode", layers=4, radius_mm=9.0)


def test_bench_prints_the_table_and_keeps_the_results(printmend, vase: Path, tmp_path: Path) -> None:
    arguments = ("bench", "table1", "--bodies", vase, "--models", "naive,oracle", "--out", tmp_path / "out")
    code, out, _ = printmend(*arguments, "--per-body")
    assert code == 0
    assert [line.split()[0] for line in out.splitlines() if line][:4] == ["Table", "model", "naive", "oracle"]
    assert out.splitlines()[-1].startswith("vase")
    code, out, _ = printmend(*arguments, "--json")
    table, bodies = json.loads(out)["table"], json.loads(out)["bodies"]
    assert code == 0
    assert [result["rmse_steps"] for result in bodies] == [line["abrmse_steps"] for line in table]
    assert [line["row"] for line in table] == ["naive", "oracle"]


def test_the_table_says_where_a_model_was_left_to_another_planner(printmend, vase: Path, tmp_path: Path) -> None:
    models = "naive,naive+optimal,oracle+optimal"
    code, out, _ = printmend("bench", "table1", "--bodies", vase, "--models", models, "--out", tmp_path / "out")
    assert code == 0
    (said,) = [line for line in out.splitlines() if "planned by" in line]
    assert said == "naive+optimal: planned by greedy, to which optimal leaves models without tables of play"


def test_an_objective_changes_the_plan(printmend, vase: Path, tmp_path: Path) -> None:
    """Planned for the area, the print gives some of the RMSE away; the rows that do not plan stay."""
    common = ("bench", "table1", "--bodies", vase, "--families", "pulley-loose", "--models", "naive,oracle,optimum")
    found = {}
    for objective in ("rmse", "area"):
        code, out, _ = printmend(*common, "--objective", objective, "--out", tmp_path / objective, "--json")
        assert code == 0
        found[objective] = {line["row"]: line["abrmse_steps"] for line in json.loads(out)["table"]}
    assert list(found["area"]) == ["naive", "oracle+optimal-area", "optimum"]
    assert found["area"]["naive"] == found["rmse"]["naive"]
    assert found["rmse"]["oracle+optimal"] == found["rmse"]["optimum"] < found["area"]["oracle+optimal-area"]


def test_dataset_goes_out_and_comes_back(printmend, vase: Path, tmp_path: Path) -> None:
    data = tmp_path / "data"
    code, out, _ = printmend("dataset", "export-reference", data, "--bodies", vase, "--corruptions", 3, "--layers", 3)
    assert (code, out) == (0, f"{data}: 1 bodies, 3 corruptions\n")
    code, out, _ = printmend("dataset", "import-reference", data, "--json")
    assert code == 0
    assert json.loads(out)["layers"] == 3
    code, out, _ = printmend("bench", "table1", "--reference", data, "--models", "oracle", "--out", tmp_path / "out")
    assert code == 0
    assert [line.split()[0] for line in out.splitlines() if line] == ["Table", "model", "oracle", "body", "vase"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("bench", "table1", "--bodies", "VASE", "--models", "naive,magic"), "learner: expected one of"),
        (("bench", "table1", "--bodies", "VASE", "--families", "gremlins"), "family: expected one of"),
        (("bench", "table1", "--bodies", "nowhere"), "no such path"),
        (("bench", "table1", "--reference", "EMPTY"), "a folder without dataset/"),
        (("bench", "table1"), "give --bodies or --reference"),
        (("bench", "table1", "--bodies", "VASE", "--out", "VASE"), "a folder for the results"),
        (("dataset", "import-reference", "nowhere"), "no such folder"),
        (("dataset", "import-reference", "VASE"), "no such folder"),
        (("dataset", "export-reference", "EMPTY/new", "--bodies", "VASE", "--corruptions", "6000"), "1 to 5000"),
        (("dataset", "export-reference", "EMPTY/new", "--bodies", "BROKEN"), "BROKEN"),
        (("paper", "--body", "BROKEN"), "BROKEN"),
        (("paper", "--corruption", "BROKEN"), "TOML"),
        (("paper", "--out", "VASE"), "a folder for the pictures"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(printmend, arguments, said: str, vase: Path, tmp_path: Path) -> None:
    broken, empty = tmp_path / "BROKEN.gcode", tmp_path / "EMPTY"
    broken.write_text("M104 S200\n")
    empty.mkdir()
    before = sorted(tmp_path.rglob("*"))
    names = {"VASE": str(vase), "BROKEN": str(broken), "EMPTY": str(empty), "EMPTY/new": str(empty / "new")}
    code, out, err = printmend(*(names.get(word, word) for word in arguments))
    assert (code, out) == (2, "")
    assert said in err
    assert len(err.splitlines()) == 1 or err.startswith("Usage:")
    assert sorted(tmp_path.rglob("*")) == before


def test_a_column_that_is_missing_and_nan_are_one_line(printmend, tmp_path: Path) -> None:
    data = tmp_path / "data"
    write_reference(data, [(circle_body("a", 2, 20.0), (1, 1))], np.ones((1, 1100)))
    csv = data / "dataset" / "a.csv"
    lines = csv.read_text().splitlines()
    for spoilt, said in (
        ([line.rsplit(",", 1)[0] for line in lines], "'y printed next'"),
        ([lines[0].replace("570.0", "nan"), *lines[1:]], "nan in row 1"),
    ):
        csv.write_text("\n".join(spoilt))
        code, out, err = printmend("dataset", "import-reference", data)
        assert (code, out, len(err.splitlines())) == (2, "", 1)
        assert said in err


@pytest.mark.parametrize(
    "words",
    [
        ("bench",),
        ("bench", "table1"),
        ("demo",),
        ("dataset",),
        ("dataset", "export-reference"),
        ("dataset", "import-reference"),
    ],
)
def test_help_has_an_example(printmend, words: tuple[str, ...]) -> None:
    code, out, _ = printmend(*words, "--help")
    assert code == 0
    assert f"Example: printmend {' '.join(words)}" in " ".join(out.split())


def test_a_table_of_failures_only_is_an_error(printmend, vase: Path, tmp_path: Path) -> None:
    empty = tmp_path / "empty.stl"
    empty.write_text("solid\nendsolid\n")
    arguments = ("bench", "table1", "--models", "naive", "--out", tmp_path / "out", "--bodies", empty)
    for more in ((), ("--json",)):
        code, _, err = printmend(*arguments, *more)
        assert code == 2
        assert "failed: empty (naive)" in err
    code, _, err = printmend(*arguments, "--bodies", vase)
    assert code == 0
    assert "failed: empty (naive)" in err


def test_the_bound_of_the_families_table_is_called_optimum(printmend, tmp_path: Path) -> None:
    options = ("--families", "radius", "--severity", "damaged", "--coverage", "0.5", "--noise", "0.1", "--samples", "1")
    code, out, _ = printmend("bench", "families", *options, "--rows", "optimum", "--out", tmp_path, "--json")
    assert code == 0
    assert [(cell["label"], cell["ratio"]) for cell in json.loads(out)["cells"]] == [("optimum", 1.0)]


@pytest.mark.parametrize("group", ["bench", "dataset"])
def test_the_list_of_commands_says_whole_sentences(printmend, group: str) -> None:
    _, out, _ = printmend(group, "--help")
    assert "..." not in out.partition("Commands:")[2]


def test_learners_that_stand_still_in_play_are_named() -> None:
    def case(family: str) -> Case:
        return Case("table1", family, family, family, "damaged", "paper", 0)

    of = {"naive": (1.0, 10.0), "greybox": (0.1, 70.0), "greybox+greedy": (0.1, 70.0), "good": (20.0, 3.0)}
    results = [
        Result(case(family), name, {"rmse_steps": value})
        for name, values in of.items()
        for family, value in zip(("pulley", "pulley-play"), values, strict=True)
    ]
    assert stands_still(results, tuple(of)) == ("greybox",)
    assert stands_still(results[::2], tuple(of)) == ()


def test_families_with_play_have_a_table_of_their_own(printmend, tmp_path: Path) -> None:
    (tmp_path / "bodies").mkdir()
    for number in range(6):
        write_vase(tmp_path / "bodies" / f"{number}.gcode", layers=4, radius_mm=9.0 + number)
    arguments = ("bench", "table1", "--bodies", tmp_path / "bodies", "--families", "pulley,pulley-play",
                 "--models", "naive,oracle", "--protocol", "heldout", "--out", tmp_path / "out")  # fmt: skip
    code, out, err = printmend(*arguments)
    assert code == 0, err
    titles = [line for line in out.splitlines() if line.startswith("Table I")]
    assert [title.rpartition(", ")[2] for title in titles] == ["families without play", "families with play"]
    code, out, _ = printmend(*arguments, "--json")
    found = json.loads(out)["parts"]
    naive, oracle = found["without play"]
    assert oracle["abrmse_steps"] < 1 < naive["abrmse_steps"]
    assert found["with play"][1]["abrmse_steps"] > 5  # Algorithm 1 stands still there, whatever it knows
    assert naive["bodies"] + found["with play"][0]["bodies"] == 6


def test_the_papers_own_figures_stand_beside_families_without_play_only() -> None:
    line = Line("naive", 3, 0, 1.0, 0.2, 1.0, 1.0, None, 0.1, 100.0)
    header, ((*_, paper),) = table_lines(Part(False, (line,)))
    assert (header[-1], paper) == ("paper", "27.6")
    header, ((*_, last),) = table_lines(Part(True, (line,)))
    assert "paper" not in header
    assert last != "27.6"
