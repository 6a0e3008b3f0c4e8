"""The whole chain on damaged printers: probe → twin → two scans → measure → learn → mend → a part nobody learned from.

    .venv/bin/python benchmarks/bench_chain.py --seed 100 --printers 5 --dirt default --dirt heavy

Prints for each printer the error of the read marks (the plate's place and turn and the scanner's scale taken off; that
scale), the contour error of the part before and after mending (its place on the bed taken off) and the seconds it took.
Targets: 0.03 mm RMS with default degradations of the scan, 0.05 mm with heavy ones.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from printmend.demo.scan import run_chain
from printmend.printer import read_printer
from printmend_lab.sampling import sample

sys.path.insert(0, str(Path(__file__).parent))
from runner import parsed, parser_of, rows_of

FAMILIES = ("pulley", "play", "pulley-play", "pulley-loose", "frame")
TARGET_MM = {"clean": 0.03, "default": 0.03, "heavy": 0.05}


def chained(options: argparse.Namespace, case: tuple[str, int]) -> dict:
    """Return the figures of one printer's whole way."""
    dirt, number = case
    seed, family = options.seed + number, FAMILIES[number % len(FAMILIES)]
    corruption = sample(family, np.random.default_rng(seed), options.severity)
    begun = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        done = run_chain(read_printer(options.preset), corruption, Path(folder), seed=seed, dirt=dirt, overlay=False)
    return {
        "dirt": dirt, "family": family, "seed": seed, "missing": done.missing, "marks": done.marks,
        "mark_um": 1000 * done.mark_mm, "scale_percent": done.scale_percent, "before_mm": done.before.rms,
        "after_mm": done.after.rms, "after_p95_mm": done.after.p95, "seconds": time.perf_counter() - begun,
    }  # fmt: skip


def main() -> None:
    parser = parser_of(__doc__, seed=100, printers=5, preset="ender5", json=False)
    parser.add_argument("--dirt", choices=sorted(TARGET_MM), action="append")
    parser.add_argument("--severity", choices=("damaged", "realistic"), default="damaged")
    options = parsed(parser)
    rows = []
    for dirt in options.dirt or ["default", "heavy"]:
        for _, row in rows_of(chained, [(dirt, number) for number in range(options.printers)], options):
            rows.append(row)
            if not options.json:
                show(row)
        if not options.json:
            show_all([row for row in rows if row["dirt"] == dirt], dirt)
    if options.json:
        print(json.dumps(rows, indent=1))


def show(row: dict) -> None:
    print(
        f"{row['dirt']:8} {row['family']:13} seed {row['seed']}: {row['missing']:2} of {row['marks']} marks missing, "
        f"{row['mark_um']:5.1f} µm (scale {row['scale_percent']:+.2f} %); "
        f"contour error {row['before_mm']:.3f} → {row['after_mm']:.4f} mm RMS "
        f"(p95 {row['after_p95_mm']:.4f}), {row['seconds']:.0f} s",
        flush=True,
    )


def show_all(rows: list[dict], dirt: str) -> None:
    after = np.array([row["after_mm"] for row in rows])
    print(
        f"{dirt}: mended {np.sqrt(np.mean(after**2)):.4f} mm RMS over {len(rows)} printers, worst {after.max():.4f}; "
        f"target {TARGET_MM[dirt]} mm reached on {int((after <= TARGET_MM[dirt]).sum())}",
        flush=True,
    )


if __name__ == "__main__":
    main()
