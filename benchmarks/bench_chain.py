"""The whole chain on damaged printers: probe → twin → two scans → measure → learn → mend → a part nobody learned from.

    .venv/bin/python benchmarks/bench_chain.py --seed 100 --printers 5 --dirt default --dirt heavy

Prints for each printer the error of the read marks (the plate's place and turn and the scanner's scale taken off; that
scale), the contour error of the part before and after mending (its place on the bed taken off) and the seconds it took.
Targets: 0.03 mm RMS with default degradations of the scan, 0.05 mm with heavy ones.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np

from printmend.corruption import sample
from printmend.demo.scan import run_chain
from printmend.printer import read_printer

FAMILIES = ("pulley", "play", "pulley-play", "pulley-loose", "frame")
TARGET_MM = {"clean": 0.03, "default": 0.03, "heavy": 0.05}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--printers", type=int, default=5, help="damaged printers, the families in turn")
    parser.add_argument("--dirt", choices=sorted(TARGET_MM), action="append")
    parser.add_argument("--preset", default="ender5")
    parser.add_argument("--severity", choices=("damaged", "realistic"), default="damaged")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    printer = read_printer(options.preset)
    rows = []
    for dirt in options.dirt or ["default", "heavy"]:
        for number in range(options.printers):
            seed, family = options.seed + number, FAMILIES[number % len(FAMILIES)]
            corruption = sample(family, np.random.default_rng(seed), options.severity)
            begun = time.perf_counter()
            with tempfile.TemporaryDirectory() as folder:
                done = run_chain(printer, corruption, Path(folder), seed=seed, dirt=dirt, overlay=False)
            rows.append(
                {
                    "dirt": dirt, "family": family, "seed": seed, "missing": done.missing, "marks": done.marks,
                    "mark_um": 1000 * done.mark_mm,
                    "scale_percent": done.scale_percent, "before_mm": done.before.rms, "after_mm": done.after.rms,
                    "after_p95_mm": done.after.p95, "seconds": time.perf_counter() - begun,
                }
            )  # fmt: skip
            if not options.json:
                show(rows[-1])
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
