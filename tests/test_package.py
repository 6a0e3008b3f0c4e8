"""The public names; what `help(printmend)` shows runs in integrations/tests/test_chains.py."""

import ast
import itertools
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from functools import cache
from pathlib import Path

import pytest

import printmend
import printmend_lab
from printmend.cli.main import GROUPS
from printmend.effects import EFFECTS

ROOT = Path(__file__).parents[1]


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
    assert done.stderr == "printmend: there is no command nonsense; see printmend --help\n"


@pytest.mark.parametrize("asked", ["none", "its own", "another"])
def test_another_python_makes_the_environment_anew(asked: str, tmp_path: Path) -> None:
    (tmp_path / "Makefile").write_bytes((ROOT / "Makefile").read_bytes())
    for name in ("core.lock", "owner.lock", "pip.lock", "requirements.lock", "pyproject.toml", "lab/pyproject.toml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    made = tmp_path / ".venv"
    (made / "bin").mkdir(parents=True)
    (made / "bin" / "python").symlink_to(sys.executable)
    for stamp in (".owner-stamp", ".stamp"):
        (made / stamp).touch()
    other = tmp_path / "python9"
    other.write_text("#!/bin/sh\necho 3.99 /elsewhere\n")
    other.chmod(0o755)
    python = {"none": [], "its own": [f"PYTHON={sys.executable}"], "another": [f"PYTHON={other}"]}[asked]
    plain = {name: value for name, value in os.environ.items() if name != "PYTHON"}
    told = subprocess.run(  # noqa: S603 - our own
        ["make", "-n", "lint", *python],  # noqa: S607
        cwd=tmp_path, env=plain, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    assert ("-m venv --clear .venv" in told) == (asked == "another")
    assert "ruff check" in told


@cache
def large_functions() -> list[tuple[Path, list[str], ast.FunctionDef | ast.AsyncFunctionDef]]:
    """Return the functions from 60 lines or above 10 parameters on, each with its file and the lines of that."""
    found = []
    for path in sorted([*(ROOT / "src").rglob("*.py"), *(ROOT / "lab" / "src").rglob("*.py")]):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and (is_long(node) or taken_by(node) > 10):
                found.append((path, text.splitlines(), node))
    return found


def is_long(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    return (node.end_lineno or 0) - node.lineno >= 60


def taken_by(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    return sum(isinstance(each, ast.arg) for each in ast.walk(node.args))


def test_a_long_function_says_why() -> None:
    """No function is above 60 lines or 10 parameters unless the reason stands above it."""
    without = []
    for path, lines, node in large_functions():
        first = min([node.lineno, *(each.lineno for each in node.decorator_list)])
        beside = list(itertools.takewhile(lambda line: line.startswith("#"), reversed(lines[: first - 1])))
        above = "\n".join(lines[: first - 1])
        many = len([*node.args.args, *node.args.kwonlyargs]) > 10
        if (many and "parameters" not in above) or (is_long(node) and not any("Long" in line for line in beside)):
            without.append(f"{path.name}:{node.lineno} {node.name}")
    assert not without


def test_a_function_that_is_long_or_takes_much_says_why() -> None:
    """A comment stands above it, or above the first of several kernels that share their parameters."""
    silent = []
    for path, lines, node in large_functions():
        if not path.is_relative_to(ROOT / "src"):
            continue
        first = min([node.lineno, *(each.lineno for each in node.decorator_list)])
        shared = any(re.match(r"# .*\bmany parameters\b", line) for line in lines[:first])
        if not lines[first - 2].startswith("#") and not (shared and taken_by(node) > 10):
            silent.append(f"{path.relative_to(ROOT)}:{node.lineno} {node.name}")
    assert not silent


def test_the_citation_and_the_conda_recipe_are_of_this_version() -> None:
    assert re.findall(r"(?m)^version: (.+)$", (ROOT / "CITATION.cff").read_text()) == [printmend.__version__]
    recipe = (ROOT / "recipe" / "recipe.yaml").read_text()
    assert re.findall(r'(?m)^  version: "(.+)"$', recipe) == [printmend.__version__]
    lab = tomllib.loads((ROOT / "lab" / "pyproject.toml").read_text())["project"]
    assert lab["dependencies"] == [f"printmend[compile]=={printmend_lab.__version__}"]
    assert printmend_lab.__version__ == printmend.__version__
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needed = recipe.partition("  run:\n")[2].partition("\n\n")[0]
    # it builds the wheel without kernels, for which numba is needed
    wanted = sorted([*project["dependencies"], *project["optional-dependencies"]["compile"]])
    wanted = [f"python {project['requires-python']}", *wanted]
    assert [line.strip("- ").replace(" ", "") for line in needed.splitlines()] == [w.replace(" ", "") for w in wanted]


@pytest.mark.parametrize("pure", [False, True])
def test_a_wheel_with_kernels_is_for_this_python_only(pure: bool, tmp_path: Path) -> None:
    for name in ("pyproject.toml", "hatch_build.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path)
    kernel = tmp_path / "src" / "printmend" / "compiled" / "kernels.json"
    kernel.parent.mkdir(parents=True)
    kernel.touch()
    (tmp_path / ".gitignore").write_text("/src/printmend/compiled/\n")
    shutil.copy(ROOT / "src" / "printmend" / "__init__.py", kernel.parents[1])
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", "dist"],
        cwd=tmp_path, env=os.environ | {"PRINTMEND_PURE": "1" if pure else ""}, check=True, capture_output=True,
    )  # fmt: skip
    (wheel,) = (tmp_path / "dist").iterdir()
    tag = wheel.stem.split("-", 2)[2]
    assert (tag == "py3-none-any") == pure
    assert pure or tag.startswith(f"cp3{sys.version_info.minor}-none-")
    assert pure or "manylinux_2_" in tag or sys.platform != "linux"
    assert any("compiled" in name for name in zipfile.ZipFile(wheel).namelist()) != pure


def test_an_effect_and_a_command_are_in_the_file_of_their_name() -> None:
    """docs/code_overview.md promises that one guess finds them."""
    for name, effect in EFFECTS.items():
        assert type(effect).__module__ == f"printmend.effects.{name}"
    commands = [command for group in GROUPS.values() for command in group]
    assert len(commands) > 15
    assert not [name for name in commands if not (ROOT / "src" / "printmend" / "cli" / f"{name}.py").is_file()]
    page = (ROOT / "docs" / "code_overview.md").read_text(encoding="utf-8")
    table = page.partition("## Where is it?")[2].partition("\n## ")[0]
    places = re.findall(r"`((?:src|lab|tests|tools|benchmarks)/[\w/.]+)`", table)
    assert len(places) >= 10
    assert not [place for place in places if "NAME" not in place and not (ROOT / place).exists()]
