"""The public names, and what `help(printmend)` shows works."""

import ast
import re
import subprocess
import sys
import textwrap
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import printmend
from printmend.corruption import corruption_toml, sample
from printmend.learn import learner
from printmend.path import Trace
from printmend.printer import Printer
from printmend.protocols import WorldModel
from tests.mending import ENDER5, SQUARE
from tests.test_mend_laws import part


@dataclass(frozen=True)
class Mine:
    """A learner from outside: every printer is healthy."""

    name: str = "mine"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> WorldModel:
        return learner("naive").fit(trace, printer, rng=rng)


def test_names_are_sorted_and_each_is_where_the_stub_says() -> None:
    stub = ast.parse(Path(printmend.__file__).with_suffix(".pyi").read_text())
    imported = [alias.name for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names]
    (listed,) = [node.value for node in stub.body if isinstance(node, ast.Assign)]
    assert ast.literal_eval(listed) == sorted(imported) == sorted(printmend.__all__)
    for name in printmend.__all__:
        assert getattr(printmend, name).__module__.startswith("printmend.")
        assert getattr(printmend, name).__doc__
    assert set(printmend.__all__) <= set(dir(printmend))
    with pytest.raises(AttributeError, match="magic"):
        printmend.magic  # noqa: B018


def test_importing_the_package_and_help_load_nothing_heavy() -> None:
    code = "import sys, printmend, printmend.cli.main; print(*(sys.modules.keys() & {'numpy', 'numba', 'scipy'}))"
    found = subprocess.run(  # noqa: S603 - our own
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == ""


def test_the_package_runs_as_a_program() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "printmend", "nonsense"], capture_output=True, text=True, check=False
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "printmend: No such command 'nonsense'; see printmend --help\n"


def test_the_examples_in_the_package_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    corruption = sample("pulley-play", np.random.default_rng(4), "realistic")
    Path("broken.toml").write_text(corruption_toml(corruption))
    Path("part.gcode").write_bytes(SQUARE)
    Path("body.gcode").write_bytes(part(ENDER5))
    doc = printmend.__doc__ or ""
    code = textwrap.dedent("\n".join(line for line in doc.splitlines() if line.startswith("    ") or not line.strip()))
    names = {"MINE": Mine(), "bodies": ["body.gcode"]}
    exec(code, names)  # noqa: S102 - our own docstring
    said = capsys.readouterr().out
    before_mm, after_mm = map(float, re.findall(r"^  (?:as it is|mended) +([\d.]+) ", said, re.MULTILINE))
    assert before_mm > 0.1
    assert after_mm < 0.15 * before_mm
    naive, greybox, mine = (line.split() for line in said.splitlines()[-3:])
    assert [naive[0], greybox[0], mine[0]] == ["naive", "greybox", "mine"]
    assert mine[1:7] == naive[1:7]
    assert float(greybox[2]) < 0.5 * float(naive[2])
