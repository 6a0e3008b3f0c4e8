"""Tests of printmend inside the programs that owners print with; `make integrations` installs those and runs them."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
