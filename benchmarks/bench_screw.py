"""A bent Z screw, from a measured print to mended files, by the commands that a user types.

    .venv/bin/python benchmarks/bench_screw.py --printers 3 --seed 1 --noise-mm 0 --noise-mm 0.05

For each printer (random damaged belts and pulleys, and a random damaged screw): `twin` prints a tower of 60 layers with
a z-hop in each and measures it, heights too; `learn` learns from that; `mend` mends the tower and a spiral of 40 turns
(vase mode); `check --against` judges both with the true machine. RMS and largest error in x, y and in height, mm.
"""

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from printmend.corruption.toml import corruption_toml
from printmend.model import exact_model, write_model
from printmend.printer import read_printer
from printmend_lab.sampling import sample

sys.path.insert(0, str(Path(__file__).parent))
from runner import run

PRESET = "ender3"
HEAD = ["G21", "G90", "M83", "G28"]
LOW_MM, HIGH_MM, PART_MM = 60.0, 140.0, 2.9  # the tower, and the parts of its sides: no fraction of a pulley's turn


def tower(layers: int = 60) -> str:
    """Squares on top of each other, drawn in short parts; a z-hop over each."""
    lines = list(HEAD)
    there = np.append(np.arange(LOW_MM + PART_MM, HIGH_MM, PART_MM), HIGH_MM)
    back = np.append(np.arange(HIGH_MM - PART_MM, LOW_MM, -PART_MM), LOW_MM)
    for layer in range(layers):
        z = 0.2 + 0.3 * layer
        lines += [f"G1 Z{z:.2f} F600", f"G1 X{LOW_MM} Y{LOW_MM} F6000", "G1 F1800"]
        lines += [f"G1 X{x:.2f} Y{LOW_MM} E0.1" for x in there] + [f"G1 X{HIGH_MM} Y{y:.2f} E0.1" for y in there]
        lines += [f"G1 X{x:.2f} Y{HIGH_MM} E0.1" for x in back]
        lines += [f"G1 Z{z + 0.4:.2f} F600", f"G0 X{HIGH_MM} Y{HIGH_MM} F6000", f"G0 X{LOW_MM} Y{HIGH_MM}"]
        lines += [f"G1 Z{z:.2f} F600", "G1 F1800"] + [f"G1 X{LOW_MM} Y{y:.2f} E0.1" for y in back]
    return "\n".join(lines) + "\n"


def spiral(turns: int = 40) -> str:
    """A cylinder in vase mode: every line rises."""
    angles = np.linspace(0, 2 * np.pi * turns, 48 * turns)
    lines = [*HEAD, "G1 Z0.2 F600", "G1 X120 Y100 F6000", "G1 F1800"]
    for angle in angles:
        x, y, z = 100 + 20 * np.cos(angle), 100 + 20 * np.sin(angle), 0.2 + 0.3 * angle / (2 * np.pi)
        lines.append(f"G1 X{x:.3f} Y{y:.3f} Z{z:.4f} E0.1")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--printers", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--noise-mm", type=float, action="append")
    parser.add_argument("--family", default="pulley-play", help="the fault of the belts")
    options = parser.parse_args()
    printer = read_printer(PRESET)
    print(
        f"{'seed':>5} {'noise':>6} {'part':8} {'x, y before':>14} {'x, y after':>14} {'z before':>14} {'z after':>14}"
    )
    for seed in range(options.seed, options.seed + options.printers):
        rng = np.random.default_rng(seed)
        fault = replace(sample(options.family, rng), screw=sample("screw", rng).screw)
        with tempfile.TemporaryDirectory() as folder:
            at = Path(folder)
            (at / "broken.toml").write_text(corruption_toml(fault), encoding="utf-8")
            for name, text in (("tower", tower()), ("spiral", spiral())):
                (at / f"{name}.gcode").write_text(text, encoding="utf-8")
            write_model(at / "exact.json", exact_model(fault.lower(printer)))
            for noise_mm in options.noise_mm or [0.0, 0.05]:
                judge(at, seed, noise_mm)


def judge(at: Path, seed: int, noise_mm: float) -> None:
    trace, model, exact = (str(at / name) for name in ("trace.csv", "model.json", "exact.json"))
    printed = ["--corruption", str(at / "broken.toml"), "--noise-mm", str(noise_mm), "--seed", str(seed), "-o", trace]
    run("twin", str(at / "tower.gcode"), "--printer", PRESET, *printed)
    said = run("learn", trace, "--printer", PRESET, "-o", model).stdout
    for name in ("tower", "spiral"):
        wanted, out = str(at / f"{name}.gcode"), str(at / f"{name}.mended.gcode")
        run("mend", wanted, "-m", model, "-o", out, "--overwrite")
        found = json.loads(run("check", wanted, "-m", exact, "--against", out, "--json").stdout)
        errors = [found["before"], found["after"], *found["heights"]]
        cells = "".join(f"{each['rms_mm']:7.3f} ({each['max_mm']:5.3f})".rjust(15) for each in errors)
        print(f"{seed:5d} {noise_mm:6.2f} {name:8}{cells}", flush=True)
    print("     ", "\n      ".join(line.strip() for line in said.splitlines() if "Z lead" in line or "lifts" in line))


if __name__ == "__main__":
    main()
