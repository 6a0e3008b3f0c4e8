"""Are fine patterns on walls found, named and mended, and is no healthy printer accused of one?

    .venv/bin/python benchmarks/bench_vfa.py --seed 1 --printers 100 [--healthy 200] [--switch phase] [--part]

Of each printer of printmend's twin the dots of `printmend probe` are measured with noise of 0.02 mm, as a scan that
knows neither place nor scale. One motor ripples by 0.016 to 0.04 mm, with a belt tooth, motor poles, pairs of full
steps or full steps; the printer has play and an eccentric pulley of usual size beside. Found is a ripple of that motor
and period. A false name is any other ripple, and on a healthy printer any. With ``--part`` a part is mended and
printed: what the ripple and all else leave of it [mm RMS], and how many moves a line becomes.
"""

import argparse
import tempfile
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench_homing import error_mm, part_gcode
from printmend.corruption import Corruption, Drive, EccentricBore, Play
from printmend.corruption.shaft import Ripple
from printmend.errors import RefusedError
from printmend.machine import Mechanism
from printmend.path import FLATBED
from printmend.printer import Homing, Printer, read_printer
from printmend.probe import design_probe
from printmend.repair import mend_gcode
from printmend.repair.learned import learn_model
from printmend.saved import SavedModel
from printmend.twin import Twin

NOISE_MM = 0.02
PERIODS_MM = {"teeth": 2.0, "ripple-4": 0.8, "ripple-2": 0.4, "ripple-1": 0.2}


def machine(rng: np.random.Generator, printer: Printer, kind: str | None, motor: int) -> Mechanism:
    """Draw a usual machine, whose motor ripples if a kind is given."""
    drives = [
        Drive(pulley=EccentricBore(rng.uniform(0.02, 0.1), rng.uniform(0, 6)), belt=Play(rng.uniform(0.02, 0.2)))
        for _ in range(2)
    ]
    if kind is not None:
        step = printer.axes[motor].mm_per_step
        most_mm = 0.95 * PERIODS_MM[kind] / (2 * np.pi)  # a larger one would turn the motor back
        size_mm = min(rng.uniform(0.016, 0.04), most_mm)
        ripple = Ripple((size_mm / step,), (PERIODS_MM[kind] / step,), (rng.uniform(0, 6),))
        drives[motor] = replace(drives[motor], ripple=ripple)
    made = Corruption((drives[0], drives[1])).lower(printer)
    assert isinstance(made, Mechanism)
    return made


def learned(true: Mechanism, rng: np.random.Generator) -> SavedModel:
    """Learn a printer from a scan of its test print."""
    plan = design_probe(true.printer)
    marks = Twin(true).follow(plan.waypoints_mm)[plan.rows]
    return learn_model(
        replace(plan.trace(marks + rng.normal(0, NOISE_MM, marks.shape)), instrument=FLATBED), true.printer
    )


def ripples(model: SavedModel) -> set[tuple[str, str]]:
    """Return the motors and kinds of the ripples that a model names."""
    faults = model.document.get("diagnosis", [])
    return {
        (fault["part"], fault["kind"]) for fault in faults if fault["kind"].partition("-")[0] in ("teeth", "ripple")
    }


def main() -> None:
    """Draw printers and count names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--printers", type=int, default=100)
    parser.add_argument("--healthy", type=int, default=0)
    parser.add_argument("--switch", default="unknown")
    parser.add_argument("--part", action="store_true")
    given = parser.parse_args()
    printer = replace(read_printer("ender3"), homing=Homing(given.switch))
    began, found, false = time.perf_counter(), Counter[str](), Counter[str]()
    left: dict[str, list[tuple[float, float, float]]] = {}
    with tempfile.TemporaryDirectory() as name:
        source, output = Path(name) / "part.gcode", Path(name) / "out.gcode"
        for number in range(given.printers):
            rng = np.random.default_rng([given.seed, number])
            kind, motor = list(PERIODS_MM)[number % len(PERIODS_MM)], int(rng.integers(2))
            true = machine(rng, printer, kind, motor)
            model = learned(true, rng)
            named = ripples(model)
            found[kind] += (printer.motors[motor], kind) in named
            false[kind] += len(named - {(printer.motors[motor], kind)})
            if given.part:
                source.write_text(part_gcode(rng))
                output.unlink(missing_ok=True)
                ratio = 1.0
                try:
                    said = mend_gcode(source, model, output).prediction
                    ratio = said.commands / said.moves
                except RefusedError:
                    output.write_bytes(source.read_bytes())
                row = (error_mm(source, source, true), error_mm(source, output, true), ratio)
                left.setdefault(kind, []).append(row)
        healthy = 0
        for number in range(given.healthy):
            rng = np.random.default_rng([given.seed, 1000 + number])
            healthy += bool(ripples(learned(machine(rng, printer, None, 0), rng)))
    for kind in PERIODS_MM:
        each = len(range(list(PERIODS_MM).index(kind), given.printers, len(PERIODS_MM)))
        line = f"{kind:9s} named {found[kind]} of {each}, falsely {false[kind]}"
        if kind in left:
            before, after, ratio = np.median(left[kind], axis=0)
            line += f"; {before:.4f} -> {after:.4f} mm, {ratio:.2f} moves for one"
        print(line)
    print(f"healthy: {healthy} of {given.healthy} falsely named; {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
