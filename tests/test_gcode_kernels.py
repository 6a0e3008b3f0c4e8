"""Kernels stay by themselves."""

import ast
from pathlib import Path

KERNELS = Path(__file__).parents[1] / "src" / "printmend" / "gcode" / "kernels"


def test_kernels_import_numpy_numba_and_kernels_only():
    for path in KERNELS.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            for name in names:
                assert name in ("numpy", "numba", "printmend.jit") or name.startswith("printmend.gcode.kernels"), name
