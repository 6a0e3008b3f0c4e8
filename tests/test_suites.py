"""Suites that do not change, rows on them as files, and the page of all rows."""

import copy
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.errors import ConfigError, InputError
from printmend_lab.bench import suites
from printmend_lab.bench.suites import (
    SUITES,
    Suite,
    check_submission,
    checksum,
    frozen_cases,
    leaderboard,
    metrics,
    run_suite,
    write_result,
)
from tests.test_bench_measured import write_encoder
from tests.test_mocap import write_clone

DOCS = Path(__file__).parents[1] / "docs"
FEW = 4
FIRST_FAMILIES = "19fd3b755df5ac5df883d319ed01910c01983644fcab4aa24465b70a4e338f5c"


@pytest.fixture(scope="module")
def small() -> Suite:
    """Four cases of the families' suite."""
    whole = SUITES["printmend/Families-v1"]

    def draw(folder: Path) -> list:
        return whole.draw(folder)[:FEW]

    return Suite("printmend/Small-v1", "Four cases.", draw, 0.05, FEW, checksum(draw(Path())))


@pytest.fixture
def kept(small: Suite, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SUITES, small.name, small)


@pytest.fixture(scope="module")
def record(small: Suite, tmp_path_factory: pytest.TempPathFactory) -> dict:
    return run_suite(small, "naive", tmp_path_factory.mktemp("work"))


def test_a_suite_is_its_cases_faults_bodies_and_metrics(small: Suite, tmp_path: Path, monkeypatch) -> None:
    assert len(frozen_cases(small, tmp_path)) == FEW
    cases = small.draw(tmp_path)
    assert checksum(cases) == checksum(small.draw(tmp_path))
    assert checksum(cases[1:]) != small.checksum
    with monkeypatch.context() as patch:
        patch.setattr(suites, "METRICS", ("mean",))
        assert checksum(cases) != small.checksum
    real = suites.families.corruption_of
    with monkeypatch.context() as patch:  # a program that draws other faults from the same seed
        patch.setattr(suites.families, "corruption_of", lambda case: real(cases[-1]))
        with pytest.raises(InputError, match="expected cases with the checksum"):
            frozen_cases(small, tmp_path)


def test_the_families_are_those_that_were_frozen() -> None:
    """Its first cases, by a checksum of their own: all of them take seconds, and `bench suite` looks at them."""
    cases = SUITES["printmend/Families-v1"].draw(Path())
    assert len(cases) == SUITES["printmend/Families-v1"].count
    assert checksum(cases[::13]) == FIRST_FAMILIES


def test_a_row_has_its_figures_versions_cost_and_every_case(
    small: Suite, record: dict, kept: None, tmp_path: Path
) -> None:
    assert len(record["cases"]) == FEW
    errors = np.array(list(record["cases"].values()))
    assert record["metrics"]["mean"] == pytest.approx(errors[:, 0].mean())
    assert record["metrics"]["ratio"] == pytest.approx(errors[:, 0].mean() / errors[:, 1].mean())
    assert (errors[:, 1] <= errors[:, 0] + 1e-12).all()
    assert record["versions"].keys() >= {"printmend", "python", "numpy", "numba"}
    path = write_result(record, tmp_path)
    assert path == tmp_path / "Small-v1" / "naive.json"
    assert check_submission(path) == json.loads(json.dumps(record))
    assert CliRunner().invoke(group, ["bench", "submit-check", str(path)]).exit_code == 0
    page = leaderboard(tmp_path)
    assert "| `naive` |" in page
    assert "No row yet." in page  # of the other suites


def changed(record: dict, *path: object, to: object) -> dict:
    found = copy.deepcopy(record)
    *way, last = path
    inner = found
    for key in way:
        inner = inner[next(iter(inner)) if key == "first" else key]
    inner[next(iter(inner)) if last == "first" else last] = to
    return found


@pytest.mark.parametrize(
    ("path", "to", "said"),
    [
        (("suite",), 3, "a field 'suite'"),
        (("checksum",), "0" * 64, "expected the checksum"),
        (("cases",), {}, "expected all 4 cases"),
        (("cases", "first"), [float("nan"), 0.1], "two errors of case"),
        (("cases", "first"), [-1.0, 0.1], "two errors of case"),
        (("cases", "first"), [0.0, 0.1], "expected a mean of"),
        (("metrics", "median"), 0.01, "expected a median of"),
        (("metrics", "failures"), None, "expected a failures of"),
        (("versions", "numpy"), None, "versions of printmend"),
        (("cost", "learn_s"), "fast", "costs in seconds"),
    ],
)
def test_a_result_that_does_not_hold_is_refused(
    path: tuple, to: object, said: str, record: dict, kept: None, tmp_path: Path
) -> None:
    file = tmp_path / "row.json"
    file.write_text(json.dumps(changed(record, *path, to=to)))
    with pytest.raises(InputError, match=said):
        check_submission(file)


@pytest.mark.parametrize("text", ["", "[1]", "{", "[" * 100_000, "{}"])
def test_what_is_no_result_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "row.json").write_text(text)
    with pytest.raises(InputError):
        check_submission(tmp_path / "row.json")


def test_failures_count_and_a_suite_that_is_not_there_is_named() -> None:
    found = metrics({"a": [None, 0.1], "b": [0.4, 0.1], "c": [0.2, None]})
    assert (found["failures"], found["ratio"]) == (1, 4.0)
    assert found["mean"] == pytest.approx(0.3)
    assert metrics({"a": [None, 0.1]})["mean"] is None
    with pytest.raises(ConfigError, match="printmend/TableI-v1"):
        suites.suite("printmend/None-v1")
    assert "printmend/Families-v1" in CliRunner().invoke(group, ["bench", "suite"]).stdout


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Suite:
    """The suite of measured data, frozen on small files of the same form."""
    data = tmp_path / "data"
    (data / "noncircular_pulleys_mocap").mkdir(parents=True)
    (data / "stepper_encoder_lut").mkdir()
    write_clone(data / "noncircular_pulleys_mocap", np.random.default_rng(0))
    write_encoder(data / "stepper_encoder_lut" / "made_lookup.csv")
    whole = SUITES["printmend/Measured-v1"]
    found = replace(whole, count=2, checksum=checksum(whole.draw(data), measured=True))
    monkeypatch.setitem(SUITES, found.name, found)
    return found


def test_a_measured_row_is_a_learner_beside_a_straight_line(seen: Suite, tmp_path: Path) -> None:
    out, data = tmp_path / "out", tmp_path / "data"
    asked = ["bench", "suite", seen.name, "--rows", "naive,bilateral", "-o", str(out)]
    done = CliRunner().invoke(group, [*asked, "--data", str(data)])
    assert done.exit_code == 0, done.output
    naive, table = (check_submission(out / "Measured-v1" / f"{name}.json") for name in ("naive", "bilateral"))
    assert naive["metrics"] == {"share": 1.0, "median": 1.0, "worst": 1.0, "failures": 0}
    assert table["metrics"]["share"] < 0.9
    assert table["cost"]["learn_s"] > 0
    page = leaderboard(out)
    assert page.index("| `bilateral` |") < page.index("| `naive` |")
    wrong = json.loads((out / "Measured-v1" / "bilateral.json").read_text())
    wrong["metrics"]["worst"] = 0.1
    (tmp_path / "wrong.json").write_text(json.dumps(wrong))
    with pytest.raises(InputError, match="expected a worst of"):
        check_submission(tmp_path / "wrong.json")
    for more, said in (
        ([], "add --data"),
        (["--data", str(out)], "git clone"),
        (["--rows", "naive+optimal"], "ask for naive"),
    ):
        failed = CliRunner().invoke(group, [*asked, *(["--data", str(data)] if "--rows" in more else []), *more])
        assert said in str(failed.exception)


def test_other_measured_data_are_refused(seen: Suite, tmp_path: Path) -> None:
    data = tmp_path / "data"
    write_clone(data / "noncircular_pulleys_mocap" / "more", np.random.default_rng(1))
    with pytest.raises(InputError, match="expected cases with the checksum"):
        frozen_cases(seen, data)
    with pytest.raises(InputError, match="leave --data out"):
        raise CliRunner().invoke(group, ["bench", "suite", "printmend/Families-v1", "--data", str(data)]).exception  # type: ignore[misc]


def test_the_measured_suite_is_the_one_that_was_frozen(corpus: Path) -> None:
    chosen = SUITES["printmend/Measured-v1"]
    assert len(frozen_cases(chosen, corpus / "measured")) == chosen.count


def test_the_page_is_made_of_the_files_beside_it() -> None:
    assert (DOCS / "leaderboard.md").read_text() == leaderboard(DOCS / "leaderboard"), "run tools/leaderboard.py"
