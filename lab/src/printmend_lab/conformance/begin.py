"""Begin a package with a learner or a controller of one's own: code, entry point, test and README."""

import importlib.resources
import keyword
import re
from pathlib import Path

import printmend
from printmend.errors import InputError
from printmend.files import replacing
from printmend.plugins import CONTROLLERS, LEARNERS

_GROUPS = {"learner": LEARNERS, "controller": CONTROLLERS}
_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_LONGEST = 60  # characters of a name

_PROJECT = """\
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "{name}"
version = "0.1.0"
description = "A {kind} for printmend."
requires-python = ">=3.11"
dependencies = ["printmend-lab[paper]>={version}"]

[project.optional-dependencies]
test = ["pytest>=8"]

[project.entry-points."{group}"]
{name} = "{package}.{kind}:MINE"

[tool.hatch.build.targets.wheel]
packages = ["src/{package}"]

[tool.pytest.ini_options]
pythonpath = ["src"]
testpaths = ["tests"]
"""

_TEST = '''\
"""{name} keeps what every {kind} of printmend must."""

import pytest

from printmend_lab.conformance.{kind}s import CHECKS, {title}Candidate

CANDIDATE = {title}Candidate("{package}.{kind}:MINE")


@pytest.mark.parametrize("check", CHECKS)
def test_keeps(check: str) -> None:
    CHECKS[check](CANDIDATE)
'''

_README = """\
# {name}

A {kind} for printmend. The code is in `src/{package}/{kind}.py`; what a
{kind} is, with all shapes and units, is in `printmend.protocols` and
`printmend_lab.protocols`.

```sh
pip install -e '.[test]'
pytest
printmend conformance {name}
printmend bench table1 --bodies generated:4 --families pulley --models {models}
printmend bench suite printmend/Families-v1 --rows {row} -o results
printmend bench submit-check results/Families-v1/{row}.json
```

The other suites, and the data that one of them reads, are in printmend's documentation, "Suites that do not change".

Without an installation, in this folder: `PYTHONPATH=src printmend conformance {package}.{kind}:MINE`. Tables and
suites take `{package}.{kind}:MINE` in place of `{name}`, too.
"""


def begin_package(kind: str, name: str, folder: Path) -> list[Path]:
    """Write a package ``name`` with a ``kind``, `learner` or `controller`, below ``folder``; return its files.

    Raises `InputError` for a name that packages cannot have or that is taken, and where the folder exists already.
    """
    package, root = name.replace("-", "_"), Path(folder) / name
    _check_name(kind, name, package)
    if root.exists() or root.is_symlink():
        raise InputError(root, wanted="a new folder", came="one that exists", todo="choose another name, or --out")
    models = f"naive,greybox,{name}" if kind == "learner" else f"naive,greybox,greybox+{name}"
    words = {
        "name": name, "package": package, "kind": kind, "group": _GROUPS[kind], "title": kind.title(),
        "version": printmend.__version__, "models": models,
        "row": f"{name}+optimal" if kind == "learner" else f"greybox+{name}",
    }  # fmt: skip
    source = importlib.resources.files("printmend_lab.conformance.templates").joinpath(f"own_{kind}.py")
    code = source.read_text(encoding="utf-8").replace(f"own-{kind}", name)
    texts = {
        "pyproject.toml": _PROJECT.format(**words),
        "README.md": _README.format(**words),
        f"src/{package}/__init__.py": f'"""A {kind} for printmend."""\n',
        f"src/{package}/{kind}.py": code,
        "tests/test_conformance.py": _TEST.format(**words),
    }
    for place, text in texts.items():
        (root / place).parent.mkdir(parents=True, exist_ok=True)
        with replacing(root / place) as file:
            file.write(text)
    return [root / place for place in texts]


def _check_name(kind: str, name: str, package: str) -> None:
    """Raise `InputError` for a name that a package or a row of a table cannot have."""
    from printmend.learn.registry import model_names
    from printmend_lab.control.registry import controller_names

    taken = {*model_names(), *controller_names(), "optimum"}
    if not _NAME.fullmatch(name) or len(name) > _LONGEST:
        wanted = f"small letters, digits and single hyphens, a letter first, at most {_LONGEST}"
        raise InputError(f"name {name!r}", wanted=wanted, came="another name", todo="choose such a name, as my-learner")
    if name in taken or package in ("printmend", "printmend_lab") or keyword.iskeyword(package):
        raise InputError(f"name {name!r}", wanted=f"a new {kind}", came="a name that is taken", todo="choose another")
