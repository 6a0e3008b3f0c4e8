"""Every peer is within 5 % of its own example: its maker's, its paper's or its library's."""

import importlib.util
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "peers_own.py"
MOST_OFF = 0.05


def test_peers_do_what_their_sources_say(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = importlib.util.spec_from_file_location("peers_own", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "peers_own", module)
    spec.loader.exec_module(module)
    found = module.examples()
    assert {one.peer for one in found} == {
        "affine", "backlash", "bilateral", "prandtl-ishlinskii", "bouc-wen", "gaussian-process", "tcn", "ensemble",
        "narx", "iterative learning",
    }  # fmt: skip
    assert {one.example: one.off for one in found if one.off > MOST_OFF} == {}
    assert module.Own("a", "b", 2.0, 2.2).off == pytest.approx(0.1)
