"""Learners, controllers and faults of other packages, by entry point and by place; what they do wrong stays theirs."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from printmend import plugins
from printmend.effects import EFFECTS
from printmend.errors import ConfigError
from printmend.learn import learner
from printmend_lab.bench.case import Case, Result, evaluate, row, run
from printmend_lab.cli.bench import command as bench
from printmend_lab.cli.conformance import command as conformance
from printmend_lab.control.registry import controller
from printmend_lab.executor import HERE
from printmend_lab.sampling import fault
from tests.mending import ENDER5
from tests.test_mend_laws import part

MODULE = '''
from dataclasses import dataclass, replace

import numpy as np

from printmend_lab.control.greedy import Greedy
from printmend.corruption import Corruption, Drive, Play
from printmend.effects import Acts, Of
from printmend.effects.effect import STAYS, along
from printmend.effects.prior import alternatives
from printmend.learn.mechanism_model import NaiveModel
from printmend_lab.path import Plan


@dataclass(frozen=True)
class Same:
    name: str = "same"

    def fit(self, trace, printer, *, rng):
        return NaiveModel(printer)


@dataclass(frozen=True)
class Nan(NaiveModel):
    def tabulate(self, start_steps, *, c_max=3):
        tables = super().tabulate(start_steps, c_max=c_max)
        return replace(tables, displacement_steps=tuple(table * np.nan for table in tables.displacement_steps))


@dataclass(frozen=True)
class Asked(NaiveModel):
    """No tables, and positions of nan."""

    def tabulate(self, start_steps, *, c_max=3):
        return None

    def advance(self, state, controls):
        after = super().advance(state, controls)
        return replace(after, position_steps=after.position_steps * np.nan)


@dataclass(frozen=True)
class Single(NaiveModel):
    """Trees do this: they saw single steps, and foresee a single step whatever the control is."""

    def tabulate(self, start_steps, *, c_max=3):
        return None

    def advance(self, state, controls):
        return super().advance(state, np.sign(controls))


@dataclass(frozen=True)
class Makes:
    name: str
    model: type

    def fit(self, trace, printer, *, rng):
        return self.model(printer)


@dataclass(frozen=True)
class Raises:
    name: str = "raises"

    def fit(self, trace, printer, *, rng):
        raise ValueError("a\\ncolumn")


@dataclass(frozen=True)
class Both:
    name: str = "both"

    def fit(self, trace, printer, *, rng):
        if not np.ptp(trace.commanded_mm, axis=0).all():
            raise ValueError("0 samples")
        return NaiveModel(printer)


@dataclass(frozen=True)
class Far:
    """A controller that leaves the range."""

    name: str = "far"

    def plan(self, model, targets_steps, start_steps, *, c_max=3):
        plan = Greedy().plan(model, targets_steps, start_steps, c_max=c_max)
        return Plan(plan.controls * 100, plan.imagined_steps)


SAME, NAN, ASKED = Same(), Makes("nan", Nan), Makes("asked", Asked)
TEXT, RAISES, SINGLE, BOTH = Makes("text", lambda printer: "x"), Raises(), Makes("single", Single), Both()
GREEDY, FAR = Greedy("mine"), Far()


def slack(rng, severity):
    return Corruption((Drive(belt=Play(float(rng.uniform(0.1, 0.3)))), Drive()))


class Sag:
    """A rail that sags in the middle of the bed."""

    name, of, acts, from_home, fate, most = "sag", Of.MACHINE, Acts.FRAME, True, STAYS, 1

    def terms(self, scene):
        yield from alternatives(self.name, 1, [()], (1.0,), share=0.05, sd_mm=0.2)

    def columns(self, places, where, shape, scene):
        return along(where, ((places.bed_mm[:, [0]] - scene.middle_mm[0]) / 100) ** 2)

    def finer(self, where, shape, round_, scene):
        return iter(())


class Jolt(Sag):
    """It says that the frame holds it, and moves by what no frame has."""

    name = "jolt"

    def columns(self, places, where, shape, scene):
        return along(where, (places.bed_mm[:, [0]] > 100) * 1.0)


SAG, JOLT = Sag(), Jolt()
'''
ROWS = ("naive", "my_plugin:SAME", "my_plugin:NAN", "my_plugin:ASKED", "my_plugin:TEXT", "my_plugin:RAISES",
        "naive+my_plugin:GREEDY", "naive+my_plugin:FAR", "ours+theirs")  # fmt: skip


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with a module of one's own, and with a package that is installed."""
    (tmp_path / "my_plugin.py").write_text(MODULE)
    (tmp_path / "body.gcode").write_bytes(part(ENDER5))
    info = tmp_path / "ours-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: ours\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[printmend.learners]\nours = my_plugin:SAME\n[printmend.controllers]\ntheirs = my_plugin:GREEDY\n"
        "[printmend.corruptions]\nslack = my_plugin:slack\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.delitem(sys.modules, "my_plugin", raising=False)
    plugins._points.cache_clear()
    yield tmp_path
    for name in ("sag", "jolt"):
        EFFECTS.pop(name, None)


def test_names_and_places_are_found(place: Path) -> None:
    assert learner("ours") is learner("my_plugin:SAME")
    assert "ours" in plugins.plugin_names(plugins.LEARNERS)
    assert controller("theirs").name == "mine"
    assert fault("slack", __import__("numpy").random.default_rng(1)) != fault(
        "slack", __import__("numpy").random.default_rng(2)
    )


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("nobody", "expected one of naive, .*, ours, .*or module:NAME"),
        ("no_such_module:MINE", "ModuleNotFoundError"),
        ("my_plugin:MINE", "no such name"),
        ("my_plugin:Same", r"a class: Same\(\) would be one"),
        ("my_plugin:GREEDY", "expected a learner, with name and fit, found one without fit"),
    ],
)
def test_what_is_no_learner_is_refused_in_words(place: Path, name: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        row(name)


def test_the_row_of_a_plugin_that_fails_says_so_and_the_others_stand(place: Path) -> None:
    case = Case("table1", "body", "0" * 16, "slack", "damaged", "heldout", 0, source="body.gcode")
    found = dict(zip(ROWS, evaluate(case, ROWS), strict=True))
    assert found["naive"].value("rmse_steps") is not None
    for name in ("my_plugin:SAME", "naive+my_plugin:GREEDY", "ours+theirs"):
        assert found[name].value("rmse_steps") == found["naive"].value("rmse_steps")
    for name, said in (
        ("my_plugin:NAN", "the model's tables: expected finite numbers"),
        ("my_plugin:ASKED", "the model: expected finite positions"),
        ("my_plugin:TEXT", "learner text: expected a model with printer"),
        ("my_plugin:RAISES", "ValueError: a column"),
        ("naive+my_plugin:FAR", "controller far: expected integer controls"),
    ):
        assert said in (found[name].error or "")
        assert found[name].value("rmse_steps") is None


def test_kept_results_are_those_of_the_code_that_made_them(place: Path) -> None:
    case = Case("table1", "body", "0" * 16, "pulley", "damaged", "heldout", 0)
    naive, mine = case.key("naive"), case.key("my_plugin:SAME")
    (place / "my_plugin.py").write_text(MODULE + "# changed\n")
    assert case.key("naive") == naive
    assert case.key("my_plugin:SAME") != mine


def test_a_plugin_that_was_edited_is_judged_again(place: Path) -> None:
    """What is in the results file is of the code of before: its key is kept, not made anew."""
    case = Case("table1", "body", "0" * 16, "pulley", "damaged", "heldout", 0)
    asked: list[str] = []

    def judge(one: Case, rows: tuple[str, ...]) -> list[Result]:
        asked.extend(rows)
        return [Result(one, row, {"rmse_steps": float(len(asked))}) for row in rows]

    def again() -> list[float | None]:
        found = run([case], ["naive", "my_plugin:SAME"], place / "out", HERE, evaluate=judge)
        return [one.value("rmse_steps") for one in found]

    assert again() == again() == [2.0, 2.0]
    (place / "my_plugin.py").write_text(MODULE + "# changed\n")
    assert again() == again() == [2.0, 3.0]
    assert asked == ["naive", "my_plugin:SAME", "my_plugin:SAME"]


def test_bench_takes_a_place(place: Path) -> None:
    arguments = ["table1", "--bodies", "body.gcode", "--models", "naive,my_plugin:SAME,my_plugin:RAISES", "--json"]
    done = CliRunner().invoke(bench, arguments)
    assert done.exit_code == 0, done.output
    naive, same, raises = json.loads(done.stdout)["table"]
    assert same["abrmse_steps"] == naive["abrmse_steps"]
    assert raises["failures"] == 1


@pytest.mark.parametrize(
    ("name", "kept", "said"),
    [
        ("my_plugin:SAME", True, "learner my_plugin:SAME: "),
        ("my_plugin:NAN", False, "the model's tables: expected finite numbers"),
        ("my_plugin:SINGLE", False, "predict one step, and multiply"),
        ("my_plugin:BOTH", False, "learns where one axis rests\n        ValueError: 0 samples"),
        ("slack", True, "family slack: "),
        ("my_plugin:SAG", True, "effect my_plugin:SAG: 10 of 10"),
        ("my_plugin:JOLT", False, "of the columns"),
    ],
)
def test_conformance_from_outside(place: Path, name: str, kept: bool, said: str) -> None:
    done = CliRunner().invoke(conformance, [name])
    assert (done.exit_code == 0) == kept, done.output
    assert ("FAILED" in done.output) != kept
    assert said in done.output


def test_what_is_no_candidate_is_told_what_one_is(place: Path) -> None:
    said = r"a learner \(name, fit\), a controller .*, found one of type module"
    with pytest.raises(ConfigError, match=said):
        CliRunner().invoke(conformance, ["my_plugin:np"], catch_exceptions=False)
