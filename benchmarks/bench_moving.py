"""What lines at speed bring: the width of the promise, with and without them.

    .venv/bin/python benchmarks/bench_moving.py --seed 1 --printers 8

Each printer has a realistic fault, and strays in motion by an amount drawn from the promise's own prior: it rings after
each corner. `printmend probe` is printed and its lines at speed are scanned. Its dots are measured on the bed with a
noise of 0.02 mm, so that a part's place counts, too. It is learned from with and without what the lines show, and a
part is mended. Its true error is that of the twin's print, of the ringing and of rounding to micro-steps.
A line a printer, then for both ways: upper end over lower end of the promise (median), how often truth lies inside and
above, and the correlation of what is said and true (of logarithms).
"""

import argparse
import itertools
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from printmend.errors import RefusedError
from printmend.learn.learned import learn_model
from printmend.measure.image import write_image
from printmend.measure.measurement import measure_scans
from printmend.mend import check_gcode, mend_gcode
from printmend.mend.against import judge_gcode
from printmend.printer import read_printer
from printmend.probe import design_probe
from printmend.probe.layout import with_moving
from printmend.promise.predict import UNSHOWN_MM, UNSHOWN_SD
from printmend.twin import Twin
from printmend.twin.scanner import DEFAULT, render_scan
from printmend_lab.sampling import sample

sys.path.insert(0, str(Path(__file__).parent))
from runner import options_of, rows_of

FAMILIES = ("pulley-play", "pulley", "play", "frame", "friction", "elastic")
NOISE_MM = 0.02  # of a dot's coordinate
WAVE_MM, FADES_MM, FINE_MM = 1.7, 9.0, 0.05
HEAD = "G21\nG90\nM83\nG28\nG1 Z0.2 F600\n"


def rung(corners_mm: np.ndarray, size_mm: float) -> np.ndarray:
    """Return the way through corners [N, 2] of a head that rings after each, by ``size_mm`` (RMS) across its line."""
    way = []
    for start, end in itertools.pairwise(corners_mm):
        gone = np.arange(0.0, np.hypot(*(end - start)), FINE_MM)
        along = (end - start) / np.hypot(*(end - start))
        off = np.exp(-gone / FADES_MM) * np.sin(2 * np.pi * gone / WAVE_MM)
        off *= size_mm / np.sqrt(np.mean(off**2))
        way.append(start + np.outer(gone, along) + np.outer(off, [-along[1], along[0]]))
    return np.vstack(way)


def part(rng: np.random.Generator) -> str:
    """Return the G-code of six circles anywhere on the bed."""
    text, turns = HEAD, np.linspace(0, 2 * np.pi, 73)
    for _ in range(6):
        middle, radius = rng.uniform(40, 180, 2), rng.uniform(8, 25)
        points = middle + radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
        text += f"G0 X{points[0, 0]:.3f} Y{points[0, 1]:.3f} F6000\n"
        text += "".join(f"G1 X{x:.3f} Y{y:.3f} E0.05 F1800\n" for x, y in points[1:])
    return text


def judged(options: argparse.Namespace, case: tuple[int]) -> dict[str, Any]:
    """Return the motion of a printer, and truth and promise of its mended part without and with lines at speed."""
    rng, printer = np.random.default_rng([options.seed, *case]), read_printer("ender3")
    plan = with_moving(design_probe(printer), printer)
    twin = Twin.of(sample(str(rng.choice(FAMILIES)), rng, severity="realistic"), printer)
    size_mm = UNSHOWN_MM * np.exp(UNSHOWN_SD * rng.standard_normal()) / np.sqrt(2)
    printed = twin.follow(plan.waypoints_mm)
    scan = render_scan(
        printed[plan.rows], plan, degradations=replace(DEFAULT, stretch=0.0), rng=rng,
        line_mm=rung(printed[plan.moving :], size_mm),
    )  # fmt: skip
    step_mm = printer.x.mm_per_step / printer.x.microsteps
    row: dict[str, Any] = {"motion_mm": size_mm}
    with tempfile.TemporaryDirectory() as name:
        source, mended = Path(name, "part.gcode"), Path(name, "mended.gcode")
        source.write_text(part(rng))
        write_image(Path(name, "scan.png"), scan.image, dpi=scan.dpi)
        motion = measure_scans([Path(name, "scan.png")], plan).motion
        trace = plan.trace(printed[plan.rows] + rng.normal(0, NOISE_MM, (len(plan), 2)), np.full(len(plan), NOISE_MM))
        for way, shown in (("without", None), ("with", motion)):
            model = learn_model(replace(trace, placed=True, motion=shown), printer)
            try:
                mend_gcode(source, model, mended)
            except RefusedError:
                mended.write_text(source.read_text())
            said = check_gcode(source, model).after
            left_mm = judge_gcode(source, mended, twin).after.rms_mm
            true_mm = float(np.linalg.norm([left_mm, size_mm, step_mm / np.sqrt(12)]))
            row[way] = [true_mm, said.rms_low_mm, said.rms_mm, said.rms_high_mm]
    return row


def main() -> None:
    options = options_of(__doc__, printers=8)
    rows = []
    for case, row in rows_of(judged, [(number,) for number in range(options.printers)], options):
        rows.append(row)
        said = "; ".join(
            f"{way}: {row[way][0]:.4f} true, {row[way][2]:.4f} ({row[way][1]:.4f}-{row[way][3]:.4f}) said"
            for way in ("without", "with")
        )
        print(f"{case[0]:3} strays by {row['motion_mm']:.4f} mm; {said}", flush=True)
    for way in ("without", "with"):
        true, low, said, high = np.array([row[way] for row in rows]).T
        inside, above = np.mean((low <= true) & (true <= high)), np.mean(true > high)
        alike = np.corrcoef(np.log(true), np.log(said))[0, 1]
        print(
            f"{way:8} upper / lower {np.median(high / low):.2f}, inside {inside:.0%}, above {above:.0%}, "
            f"correlation {alike:.2f}"
        )


if __name__ == "__main__":
    main()
