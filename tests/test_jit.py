"""The one door to the compiler: what is kept is run again only while nothing that it was made of has changed."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import FunctionType, ModuleType
from typing import NamedTuple

import numpy as np
import pytest

import printmend
import printmend_lab
from printmend.gcode.kernels import interpret
from printmend.jit import digest

SOURCES = Path(printmend.__file__).parent
LAB = Path(printmend_lab.__file__).parent
CLIP = """
import numpy as np
from printmend.jit import compilations
from printmend.machine.kernels.run import clip_each
from printmend.shipped import Shipped
Shipped.fill = {fill}
out = np.zeros(1)
clip_each(np.array([8.0]), np.array([1.0]), np.array([5.0]), out)
print(out[0])
print(compilations.entries)
"""


def test_kept_and_shipped_code_runs_until_a_helper_of_another_file_is_edited(tmp_path):
    copy = tmp_path / "printmend"
    shutil.copytree(SOURCES, copy, ignore=shutil.ignore_patterns("*.nb?", "compiled", "*.safetensors"))
    outside = {**os.environ, "PYTHONPATH": str(tmp_path)}

    def run(kept="kept", *, fill=False, **more):
        command = [sys.executable, "-c", CLIP.replace("{fill}", str(fill))]
        environment = {**outside, "NUMBA_CACHE_DIR": str(tmp_path / kept), **more}
        return subprocess.run(command, env=environment, capture_output=True, check=True, text=True).stdout.split("\n")  # noqa: S603

    assert run(fill=True) == ["5.0", "1", ""]
    # what was shipped is at once there for a user with nothing kept, on a plainer processor too
    assert run("nothing", NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="") == ["5.0", "0", ""]
    assert len(list((copy / "compiled").glob("*.nbc"))) == 1
    helper = copy / "machine" / "kernels" / "play.py"
    helper.write_text(helper.read_text().replace("return min(max(", "return 1 + min(max("))
    assert run() == ["6.0", "1", ""]
    assert run() == ["6.0", "0", ""]
    for kind in ("nbi", "nbc"):  # an index that older code or a full disk left, then its code
        for path in (tmp_path / "kept").rglob(f"*.{kind}"):
            path.write_bytes(path.read_bytes()[:-40])
        assert run() == ["6.0", "1", ""], kind


def test_kernels_come_through_the_door_and_know_nothing_but_numpy_and_kernels():
    for path in (*SOURCES.rglob("*.py"), *LAB.rglob("*.py")):
        is_of_kernels = "kernels" in path.as_posix().rpartition("/printmend")[2]
        if not is_of_kernels and "numba" not in path.read_text():
            continue
        imported = {
            node.module if isinstance(node, ast.ImportFrom) else name.name
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Import | ast.ImportFrom)
            for name in node.names
        }
        if path.name not in ("compiling.py", "compiler.py", "shipped.py"):
            assert "numba" not in {str(name).partition(".")[0] for name in imported}, path
        if is_of_kernels:
            allowed = {"numpy", "math", "typing", "printmend.jit"}  # numpy has no erfc
            assert all(name in allowed or ".kernels" in str(name) for name in imported), path


class Two(NamedTuple):
    a: int
    b: int


def made(text: str, **outside: object) -> FunctionType:
    names = {"np": np, **outside}
    exec(text, names)  # noqa: S102 (the test's own words)
    return names["f"]  # type: ignore[return-value]


def module(**names: object) -> ModuleType:
    """Return a module of ours that imports numpy, as most with kernels do."""
    value = ModuleType("printmend.made")
    vars(value).update(names, np=np)
    return value


@pytest.mark.parametrize(
    ("text", "before", "after"),
    [
        ("def f(x): return x + V", 1, 2),
        ("def f(x): return x + V[0]", (1, 2), (1, 3)),
        ("def f(x): return x + V[0]", np.array([1.0]), np.array([2.0])),
        ("def f(x): return V(1, x).a", Two, NamedTuple("Two", [("b", int), ("a", int)])),
        ("def f(x): return sum([y + V for y in x])", 1, 2),
        ("def f(x): return np.abs(x) + V.a", module(a=1, b=1), module(a=2, b=1)),
        ("def f(x): return np.abs(x) + V.b.a", module(b=module(a=1)), module(b=module(a=2))),
        ("def f(x): return V(x)", made("def f(x): return x + 1"), made("def f(x): return x + 2")),
    ],
)
def test_the_key_changes_with_what_a_kernel_uses_and_with_nothing_else(text, before, after):
    assert digest(made(text, V=before)) == digest(made(text, V=before, W=7))
    assert digest(made(text, V=before)) != digest(made(text, V=after))
    assert digest(made(text, V=before)) != digest(made(text.replace("x", "y"), V=before))


def test_the_key_changes_with_the_module_that_compiled_code_looks_its_constants_up_in():
    here, moved = made("def f(x): return x"), made("def f(x): return x")
    here.__module__, moved.__module__ = "printmend.learn.drive", "printmend_lab.greybox.drive"
    assert digest(here) != digest(moved)


def test_a_value_whose_content_cannot_be_told_is_refused():
    with pytest.raises(TypeError, match="uses V, a <class 'list'>"):
        digest(made("def f(x): return V[x]", V=[1, 2]))
    assert digest(interpret) == digest(interpret)
