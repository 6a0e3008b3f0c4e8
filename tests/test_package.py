"""The public names; what `help(printmend)` shows runs in integrations/tests/test_chains.py."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import printmend


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
