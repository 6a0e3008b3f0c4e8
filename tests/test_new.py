"""`printmend new`: what it begins runs, is found, and keeps what everything of its kind must."""

import importlib
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from printmend.cli.main import group
from printmend.errors import InputError
from printmend_lab.bench.suites import write_result
from printmend_lab.conformance import kind_of
from printmend_lab.conformance.begin import begin_package
from printmend_lab.conformance.controllers import CHECKS as CONTROLLER_CHECKS
from printmend_lab.conformance.controllers import ControllerCandidate
from printmend_lab.conformance.learners import CHECKS as LEARNER_CHECKS
from printmend_lab.conformance.learners import LearnerCandidate
from tests.conformance import broken_by
from tests.test_examples import QUICK


@pytest.fixture
def begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Begin a package by the command line, make it importable, and return the place of what is in it."""

    def begin(kind: str, name: str) -> str:
        done = CliRunner().invoke(group, ["new", kind, name, "-o", str(tmp_path)])
        assert done.exit_code == 0, done.output
        monkeypatch.setattr(sys, "path", [str(tmp_path / name / "src"), *sys.path])
        project = tomllib.loads((tmp_path / name / "pyproject.toml").read_text())
        (points,) = project["project"]["entry-points"].values()
        return points[name]

    return begin


def test_a_learner_that_was_begun_keeps_what_a_learner_must(begun) -> None:
    place = begun("learner", "own-waves")
    assert kind_of(place) == "learner"
    assert broken_by(LearnerCandidate(place), LEARNER_CHECKS) == {}


def test_a_controller_that_was_begun_keeps_what_a_controller_must(begun) -> None:
    place = begun("controller", "own-steps")
    assert kind_of(place) == "controller"
    assert broken_by(ControllerCandidate(place), {label: CONTROLLER_CHECKS[label] for label in QUICK}) == {}


@pytest.mark.parametrize("kind", ["learner", "controller"])
def test_its_own_test_looks_at_every_check(kind: str, begun, tmp_path: Path) -> None:
    place = begun(kind, f"own-{kind}-2")
    module = importlib.import_module(place.partition(":")[0])
    assert f"own-{kind}-2" == module.MINE.name
    names: dict = {}
    exec(compile((tmp_path / f"own-{kind}-2/tests/test_conformance.py").read_text(), "test", "exec"), names)  # noqa: S102 (our own text)
    assert names["CANDIDATE"].name == place
    assert names["CHECKS"] is (LEARNER_CHECKS if kind == "learner" else CONTROLLER_CHECKS)


@pytest.mark.parametrize(
    "name", ["", "Mine", "a_b", "../x", "a--b", "1st", "class", "naive", "optimal", "printmend", "a" * 61]
)
def test_names_that_packages_cannot_have_are_refused_and_nothing_is_written(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="name"):
        begin_package("learner", name, tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("kind", "row"), [("learner", "my-own+optimal"), ("controller", "greybox+my-own")])
def test_its_readme_leads_to_a_suite(kind: str, row: str, tmp_path: Path) -> None:
    begin_package(kind, "my-own", tmp_path)
    text = (tmp_path / "my-own" / "README.md").read_text()
    assert f"printmend/Families-v1 --rows {row} " in text
    record = {"suite": "printmend/Families-v1", "row": row}
    path = write_result(record, tmp_path / "results")  # where the README looks for it
    assert f"submit-check {path.relative_to(tmp_path)}" in text


def test_a_folder_that_is_there_stays(tmp_path: Path) -> None:
    files = begin_package("learner", "mine", tmp_path)
    files[0].write_text("mine")
    with pytest.raises(InputError, match="a new folder"):
        begin_package("learner", "mine", tmp_path)
    assert files[0].read_text() == "mine"


def test_a_network_in_single_precision_is_no_fault(monkeypatch: pytest.MonkeyPatch, begun) -> None:
    """Sums of a batch differ from sums of its rows by some 1e-5 steps: far below what shows in a plan."""
    place = begun("learner", "own-single")
    module = importlib.import_module(place.partition(":")[0])
    exact = module.waves
    noise = np.random.default_rng(0)

    def rounded(places, printer, drive):
        found = exact(places, printer, drive).astype(np.float32)
        return found * (1 + 1e-6 * noise.standard_normal(len(places)).astype(np.float32)[:, None])

    monkeypatch.setattr(module, "waves", rounded)
    candidate = LearnerCandidate(place)
    model = candidate.fitted("pulley")
    controls = np.tile([[2, -1]], (20, 1))
    batch, alone = (model.advance(model.start(np.array([500, 500])), some) for some in (controls, controls[:1]))
    assert 0 < abs(batch.position_steps[0] - alone.position_steps[0]).max() < 1e-3
    kept = {label: check for label, check in LEARNER_CHECKS.items() if "pulley" in label and "noisy" not in label}
    assert broken_by(candidate, kept) == {}
