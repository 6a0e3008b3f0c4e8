"""Kernels as JavaScript: what the translation knows, and what it refuses."""

import sys
from pathlib import Path
from types import ModuleType

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tools" / "site"))
import translate


def _translated(tmp_path: Path, source: str, *names: str) -> str:
    (path := tmp_path / "kernel.py").write_text(source)
    module = ModuleType("kernel")
    module.__file__ = str(path)
    exec(compile(source, str(path), "exec"), vars(module))  # noqa: S102 - our own lines
    return translate.module_text(module, list(names))


def test_a_kernel_keeps_its_words_and_constants(tmp_path: Path) -> None:
    source = (
        "import numpy as np\n_MOST = 3\n\n\ndef law(a, way):\n    x, y = 0.0, way.scale[1]\n"
        "    for k in range(_MOST):\n        if not x > a:\n            x += np.cos(k) * y\n    return x if a else -y\n"
    )
    text = _translated(tmp_path, source, "law")
    assert "const _MOST = 3;" in text
    assert "export function law(a, way) {" in text
    assert "let k, x, y;" in text
    assert "k = $i" in text
    assert "x += (Math.cos(k) * y);" in text
    assert "return (a ? x : (-y));" in text


@pytest.mark.parametrize("line", ["a %= 2", "with a: pass", "a = [n for n in a]", "a = np.hypot(a, a)", "a = a @ a"])
def test_what_has_no_javascript_stops_the_build(tmp_path: Path, line: str) -> None:
    with pytest.raises((ValueError, KeyError)):
        _translated(tmp_path, f"def law(a):\n    {line}\n", "law")


def test_the_law_of_the_page_is_whole() -> None:
    import page_parts

    text = page_parts.law()
    for name in ("clip", "branch_at", "push_at", "onto_bed", "off_bed", "distances"):
        assert f"export function {name}(" in text
