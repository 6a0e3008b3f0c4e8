"""The planners' kernels with every index checked: one that reads beyond an array ends in an error, not in a crash.

Compiling them anew with checks takes a while, so this is not in `make test`; the checked kernels are kept apart.
"""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
SCRIPT = '''
import numpy as np

from printmend_lab.conformance.controllers import KINDS, START, TARGETS, faulty_model
from printmend_lab.control.registry import controller
from printmend.jit import entry
from printmend.learn.mechanism_model import MechanismModel
from printmend.machine import LatticeMotor, PlayTables, lattice_tables, healthy_mechanism
from printmend.printer import read_printer


@entry
def beyond(values):
    return values[values.shape[0] + 1]


try:
    beyond(np.zeros(3))
except IndexError:
    print("indices are checked")
PLANNERS = ("greedy", "lookahead", "optimal", "optimal-area")
for kind in KINDS:
    for name in PLANNERS:
        for c_max in (1, 3, 6):
            controller(name).plan(faulty_model(kind), TARGETS[:60], START, c_max=c_max)
print("models of every kind")


class Odd(MechanismModel):
    """Branches that are any that rise: flat, steep, with much play or none, of any place at the start."""

    def tabulate(self, start_steps, *, c_max=3):
        tables, rng = super().tabulate(start_steps, c_max=c_max), np.random.default_rng(self.seed)
        motors = []
        for motor in tables.motors:
            count = len(motor.lower_steps)
            steps = rng.choice([0.0, 0.0, 0.3, 1.0, 1.0, 1.7, 9.0], count)
            lower = np.cumsum(steps)
            upper = np.maximum.accumulate(lower + rng.choice([0.0, 0.5, 6.0]) * rng.random(count))
            middle = (lower[motor.start] + upper[motor.start]) / 2
            motors.append(LatticeMotor(motor.name, motor.first_step, motor.start,
                                       lower - middle + motor.origin_steps, upper - middle + motor.origin_steps))
        return PlayTables(tuple(motors), tables.bed)


for seed in range(60):
    rng = np.random.default_rng(seed)
    printer = read_printer(("ender5", "corexy", "ender3")[seed % 3])
    model = Odd(healthy_mechanism(printer))
    object.__setattr__(model, "seed", seed)
    start = rng.integers(0, np.array(printer.bed_steps) + 1)
    targets = start + np.cumsum(rng.integers(-2, 3, (40, 2)), axis=0) + rng.normal(0, rng.choice([0, 0.4]), (40, 2))
    targets[rng.random(40) < 0.1] += rng.choice([0.0, 30.0, 4000.0]) * rng.choice([-1, 1])
    for name in PLANNERS:
        controller(name).plan(model, targets, start, c_max=int(rng.choice([1, 2, 3, 7, 20])))
print("odd tables")
'''


def test_no_planner_reads_beyond_its_arrays(tmp_path: Path) -> None:
    kept = ROOT / ".pytest_cache" / "checked-kernels"
    kept.mkdir(parents=True, exist_ok=True)
    script = tmp_path / "plan.py"
    script.write_text(SCRIPT)
    checked = {**os.environ, "NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(kept)}
    done = subprocess.run(  # noqa: S603 (this interpreter, a list of arguments)
        [sys.executable, str(script)], env=checked, capture_output=True, text=True, check=False, timeout=600
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.split("\n")[:3] == ["indices are checked", "models of every kind", "odd tables"]
