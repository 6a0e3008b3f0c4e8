"""An axis that moved only a little teaches what it showed: a law over span and noise."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "bench_span.py"
MICROSTEP_MM = 0.0125


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("bench_span", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["bench_span"] = module
    spec.loader.exec_module(module)
    module.ROWS, module.ASKED = 100, 60
    return module


@pytest.mark.parametrize(("span_mm", "noise_mm"), [(1.0, 0.05), (5.8, 0.0)])
def test_what_was_seen_is_foreseen_however_short_it_was(script: ModuleType, span_mm: float, noise_mm: float) -> None:
    naive, *learned = script.missed_mm(["naive", "printmend", "greybox"], "pulley", span_mm, noise_mm, (1, 0)).values()
    assert naive > 0.2
    assert max(learned) < MICROSTEP_MM + noise_mm / 3
