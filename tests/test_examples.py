"""The examples do what they say; `make notebook` runs the notebook, `make integrations` the agents."""

import runpy
import sys
from pathlib import Path

import pytest

from printmend.learn import learner
from printmend_lab import evaluate
from printmend_lab.conformance.controllers import CHECKS as CONTROLLER_CHECKS
from printmend_lab.conformance.controllers import ControllerCandidate
from printmend_lab.conformance.learners import CHECKS as LEARNER_CHECKS
from printmend_lab.conformance.learners import LearnerCandidate
from tests.mending import ENDER5
from tests.test_mend_laws import part

EXAMPLES = Path(__file__).parents[1] / "examples"
QUICK = ("controls to 3 lead where imagined (play)", "leaves a healthy ender5 alone", "plans no targets (joint)",
         "refuses a start off the bed")  # fmt: skip


@pytest.fixture(autouse=True)
def place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [str(EXAMPLES), *sys.path])


def test_the_learner_keeps_what_it_must_and_learns(tmp_path: Path) -> None:
    candidate = LearnerCandidate("own_learner:MINE")
    for check in LEARNER_CHECKS.values():
        check(candidate)
    (tmp_path / "body.gcode").write_bytes(part(ENDER5))
    table = evaluate(["naive", "own_learner:MINE", learner("own_learner:MINE")], [tmp_path], families=["play"])
    naive, mine, same = (line.abrmse_steps for line in table.lines)
    assert mine < 0.6 * naive
    assert same == mine


def test_the_controller_keeps_what_it_must() -> None:
    for check in QUICK:
        CONTROLLER_CHECKS[check](ControllerCandidate("own_controller:MINE"))


def test_the_problem_is_played_by_name() -> None:
    found = runpy.run_path(str(EXAMPLES / "one_print.py"))["scores"]("play", "damaged", scenes=1)
    assert list(found) == ["Naive", "printmend", "greybox", "meta"]
    assert abs(found["Naive"]).max() < 1e-9 < found["greybox"].min()
