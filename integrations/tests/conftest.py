"""Tests of printmend inside the programs that owners print with, and of its demonstrations from end to end.

`make integrations` installs those programs and runs the tests.
"""

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
# One thread a worker, as in tests/conftest.py.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
