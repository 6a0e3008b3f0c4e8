"""The twin: steps a second an axis, and the largest difference from the slow obvious version.

.venv/bin/python benchmarks/bench_twin.py [--steps 2000000]
"""

import argparse
import time
from itertools import pairwise
from pathlib import Path
from sys import path as import_path

import numpy as np

from printmend.corruption import Corruption, Drive, EccentricBore, GainTable, Play
from printmend.machine import lattice_tables
from printmend.printer import read_printer
from printmend.twin import Twin

import_path.insert(0, str(Path(__file__).parents[1]))
from tests import naive_twin

CHECKED = 20_000  # the slow version does some 1e5 steps a second


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=2_000_000)
    steps = parser.parse_args().steps
    printer, rng = read_printer("ender5"), np.random.default_rng(0)
    # Long straight moves between random places of the bed: what G-code looks like to a motor.
    corners = rng.integers(100, 1000, (steps // 300 + 2, 2))
    moves = [np.sign(b - a) * (np.arange(1000)[:, None] < abs(b - a)) for a, b in pairwise(corners)]
    controls = np.concatenate([move[(move != 0).any(axis=1)] for move in moves])[:steps].astype(np.int64)
    start = corners[0]
    pulley = EccentricBore(1.0, 0.5)
    gains = GainTable(tuple(1 + 0.1 * np.cos(np.arange(1100) / 30)))
    worlds = {
        "pulley": Corruption((Drive(pulley=pulley), Drive(pulley=pulley))),
        "pulley and play": Corruption((Drive(pulley=pulley, belt=Play(0.8)), Drive(pulley=pulley, belt=Play(0.3)))),
        "gain table": Corruption((Drive(gain_table=gains), Drive(gain_table=gains))),
    }
    for name, corruption in worlds.items():
        twin = Twin.of(corruption, printer)
        printed = twin.run(controls[:CHECKED], start)
        slow = np.stack([_slow(twin, controls[:CHECKED], start, axis) for axis in range(2)], axis=1)
        times = []
        for _ in range(5):
            begun = time.perf_counter()
            twin.run(controls, start)
            times.append(time.perf_counter() - begun)
        speed = 2 * len(controls) / min(times) / 1e6
        error = np.abs(printed - slow).max()
        print(f"{name}: {speed:.0f} M steps/s an axis, {error:.1e} steps from the slow version over {CHECKED} steps")


def _slow(twin: Twin, controls: np.ndarray, start: np.ndarray, axis: int) -> np.ndarray:
    if hasattr(twin.mechanism, "gains"):
        gains, bed = twin.mechanism.gains[axis], twin.printer.bed_steps[axis]
        return np.array(naive_twin.gain_run(controls[:, axis], int(start[axis]), gains, bed))
    tables = lattice_tables(twin.mechanism, start)
    motor = tables.motors[axis]
    index = motor.start + np.cumsum(controls[:, axis])
    return np.array(naive_twin.play(index, motor.origin_steps, motor.lower_steps, motor.upper_steps))


if __name__ == "__main__":
    main()
