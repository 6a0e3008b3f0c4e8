"""How good is a mended print once the printer has homed again, and does its promise hold?

    .venv/bin/python benchmarks/bench_homing.py --seed 1 --printers 10 --homings 10 [--wake-ups 0.2] [--scatter 0.1]

Of each printer of printmend's twin a model is learned from the dots of `printmend probe`, with noise of 0.02 mm, after
a homing of its own. A part is mended and printed after each of some further homings: the end stops scatter by
``--scatter`` mm, and in a share ``--wake-ups`` of homings a motor stands four full steps aside. With ``--refit`` the
belts are put back on any tooth before, and the model learns that from a scan of `printmend probe --phase`. Errors are
RMS distances from the wanted path [mm], the part's place taken off.
"""

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from printmend.corruption import Corruption, Drive, EccentricBore, Ellipse, Play
from printmend.corruption.transmission import Ripple
from printmend.effects.switch import homing_mm, refit_mm
from printmend.errors import RefusedError
from printmend.gcode.read import read_gcode
from printmend.learn.learned import learn_model
from printmend.machine import Mechanism, homed_again
from printmend.mend import check_gcode, mend_gcode
from printmend.mend.update import learn_phase
from printmend.model import SavedModel
from printmend.printer import Homing, Printer, read_printer
from printmend.probe import PHASE_MARKS, design_probe, phase_size_mm
from printmend.twin import Twin
from printmend.twin.gcode import follow_finely
from printmend_lab.sampling import sample
from runner import write_results

NOISE_MM = 0.02
TWOFOLD = 2 * np.pi


def part_gcode(rng: np.random.Generator) -> str:
    """Return a part: a ring, a square and a diagonal wall, somewhere on the bed."""
    at = rng.uniform(70, 150, 2)
    lines = ["G21", "G90", "M83", "G28", "G1 Z0.2 F600"]
    ring = [(at + 25 * np.array([np.cos(t), np.sin(t)])) for t in np.linspace(0, TWOFOLD, 181)]
    square = [at + np.array(corner) for corner in ((-15, -15), (15, -15), (15, 15), (-15, 15), (-15, -15), (15, 15))]
    for path in (ring, square):
        lines.append(f"G0 X{path[0][0]:.3f} Y{path[0][1]:.3f} F6000")
        lines += [f"G1 X{x:.3f} Y{y:.3f} E0.1 F1800" for x, y in path[1:]]
    return "\n".join(lines) + "\n"


def machine(rng: np.random.Generator, printer: Printer, family: str) -> Mechanism:
    """Draw a broken machine."""
    if family == "ripple":
        size, phases = rng.uniform(0.016, 0.04, 2) / printer.x.mm_per_step, rng.uniform(0, TWOFOLD, 2)
        period = (2.0 / printer.x.mm_per_step,)
        return Corruption(
            (
                Drive(Ripple((size[0],), period, (phases[0],)), belt=Play(0.05)),
                Drive(Ripple((size[1],), period, (phases[1],))),
            )
        ).lower(printer)  # type: ignore[return-value]
    if family == "realistic":
        return sample("pulley-play", rng, "realistic").lower(printer)  # type: ignore[return-value]
    e, phase = rng.uniform(0.1, 0.5, 2), rng.uniform(0, TWOFOLD, 2)
    return Corruption(
        (
            Drive(pulley=EccentricBore(e[0], phase[0]), belt=Play(rng.uniform(0, 0.3))),
            Drive(pulley=Ellipse(6.366 + e[1] / 2, 6.366 - e[1] / 2, phase[1]), belt=Play(rng.uniform(0, 0.3))),
        )
    ).lower(printer)  # type: ignore[return-value]


def learned(true: Mechanism, rng: np.random.Generator) -> SavedModel:
    """Learn a printer from its test print."""
    plan = design_probe(true.printer)
    marks = Twin(true).follow(plan.waypoints_mm)[plan.rows]
    trace = plan.trace(marks + rng.normal(0, NOISE_MM, marks.shape))
    return learn_model(replace(trace, placed=True, instrument=None), true.printer)  # measured from home, as a table


def phased(model: SavedModel, true: Mechanism, rng: np.random.Generator) -> SavedModel:
    """Find where the motors of a printer stand now, by its phase print."""
    plan = design_probe(true.printer, size_mm=phase_size_mm(true.printer), marks=PHASE_MARKS)
    marks = Twin(true).follow(plan.waypoints_mm)[plan.rows]
    return learn_phase(model, plan.trace(marks + rng.normal(0, NOISE_MM, marks.shape)), rng=rng).model


def error_mm(wanted: Path, made: Path, true: Mechanism, *, of_shape: bool = False) -> float:
    """Return the RMS distance of a file's print from the lines that another one wants; ``of_shape`` leaves out its
    place."""
    twin = Twin(true)
    ideal, _, draws, _ = follow_finely(read_gcode(wanted, printer=true.printer), twin)
    _, printed, extrudes, _ = follow_finely(read_gcode(made, printer=true.printer), twin)
    begins, ends = ideal[:-1][draws], ideal[1:][draws]
    points = printed[1:][extrudes]
    way = ends - begins
    length = np.maximum(np.hypot(*way.T), 1e-9)
    near = cKDTree((begins + ends) / 2).query(points, k=3)[1]
    along = np.clip(((points[:, None] - begins[near]) * way[near]).sum(axis=2) / length[near] ** 2, 0, 1)
    off = points[:, None] - begins[near] - along[..., None] * way[near]
    best = np.arange(len(off)), np.linalg.norm(off, axis=2).argmin(axis=1)
    off, line = off[best], (way / length[:, None])[near[best]]
    if of_shape:
        normal = line[:, ::-1] * [-1, 1]
        off = off - np.linalg.lstsq(normal, np.sum(off * normal, axis=1), rcond=None)[0]
        off = np.sum(off * normal, axis=1, keepdims=True)
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def main() -> None:
    """Draw printers, home them again and again, and count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--printers", type=int, default=10)
    parser.add_argument("--homings", type=int, default=10)
    parser.add_argument("--scatter", type=float, default=0.1)
    parser.add_argument("--wake-ups", type=float, default=0.2)
    parser.add_argument("--family", choices=("pulleys", "ripple", "realistic"), default="pulleys")
    parser.add_argument("--switch", default="unknown")
    parser.add_argument("--refit", action="store_true")
    parser.add_argument("--csv", type=Path, help="write every printer's figures there")
    given = parser.parse_args()
    printer = replace(read_printer("ender3"), homing=Homing(given.switch))
    rows, table, began = [], [], time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        source, output = Path(name) / "part.gcode", Path(name) / "out.gcode"
        for number in range(given.printers):
            rng = np.random.default_rng([given.seed, number])
            true = machine(rng, printer, given.family)
            model = learned(homed_again(true, homing_mm(printer, rng, scatter_mm=given.scatter, turn_share=0.0)), rng)
            taken_off_mm = refit_mm(printer, rng) if given.refit else np.zeros(2)
            true = homed_again(true, taken_off_mm)
            if given.refit:
                model = phased(
                    model, homed_again(true, homing_mm(printer, rng, scatter_mm=given.scatter, turn_share=0.0)), rng
                )
            source.write_text(part_gcode(rng))
            output.unlink(missing_ok=True)
            try:
                said = mend_gcode(source, model, output).prediction
                promise = said.after
            except RefusedError:
                said = check_gcode(source, model)
                promise = said.before
            own = []
            for _ in range(given.homings):
                by = homing_mm(printer, rng, scatter_mm=given.scatter, turn_share=given.wake_ups)
                now = homed_again(true, by)
                before, after = (
                    error_mm(source, made, now, of_shape=True)
                    for made in (source, output if output.exists() else source)
                )
                own.append((before, after, promise.rms_low_mm, promise.rms_high_mm))
            rows += own
            raw, mended = np.array(own)[:, 0], np.array(own)[:, 1]
            figures = {
                "printer": number, "unmended_mm": np.median(raw), "mended_mm": np.median(mended),
                "mended_most_mm": mended.max(), "promised_low_mm": promise.rms_low_mm,
                "promised_high_mm": promise.rms_high_mm,
            }  # fmt: skip
            table.append({name: round(float(each), 4) for name, each in figures.items()})
            if given.csv is not None:
                write_results(given.csv, "A part's error [mm RMS] after further homings of each printer", table)
            print(
                f"{number:3d} unmended {np.median(raw):.4f}, mended {np.median(mended):.4f} (most {mended.max():.4f}), "
                f"promised {promise.rms_low_mm:.4f}–{promise.rms_high_mm:.4f}, moves {said.moves} -> {said.commands}"
            )
    raw, mended, low, high = np.array(rows).T
    print(
        f"{len(rows)} homings: within the promise {100 * np.mean((mended >= low) & (mended <= high)):.0f} % "
        f"(below {100 * np.mean(mended < low):.0f}, above {100 * np.mean(mended > high):.0f}); "
        f"median {np.median(raw):.4f} -> {np.median(mended):.4f} mm; worse than unmended by at most "
        f"{(mended - raw).max():+.4f} mm; {time.perf_counter() - began:.0f} s"
    )


if __name__ == "__main__":
    main()
