"""Compiled files stay true to what they import: numba's cache looks at the file of the cached function only."""

import ast
import hashlib
from pathlib import Path

import pytest

KERNELS = Path(__file__).parents[1] / "src" / "printmend" / "gcode" / "kernels"
CACHED = sorted(path.name for path in KERNELS.glob("*.py") if "cache=True" in path.read_text(encoding="utf-8"))


def imported(path: Path) -> set[Path]:
    """The kernel files that a kernel file compiles in, directly or through others."""
    found: set[Path] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("printmend.gcode.kernels."):
            other = KERNELS / f"{node.module.rsplit('.', 1)[1]}.py"
            found |= {other} | imported(other)
    return found


@pytest.mark.parametrize("name", CACHED)
def test_a_change_in_an_imported_kernel_reaches_the_cached_one(name):
    path = KERNELS / name
    sources = b"".join(other.read_bytes() for other in sorted(imported(path)))
    if not sources:
        return
    digest = hashlib.sha256(sources).hexdigest()[:12]
    assert f'COMPILED_WITH = "{digest}"' in path.read_text(encoding="utf-8"), (
        f'write COMPILED_WITH = "{digest}" in {name}'
    )


def test_kernels_import_numpy_numba_and_kernels_only():
    for path in KERNELS.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            for name in names:
                assert name in ("numpy", "numba") or name.startswith("printmend.gcode.kernels"), (path, name)
