"""Judge the owner's ways of measuring by a slicer, a printer and scanners that share no code with printmend.

    .venv/bin/python benchmarks/bench_owner.py --seed 1

The judges are tests/foreign_layer.py's: uneven pulleys and play, beads of uneven width, blobs, texture, dust, JPEG. One
line for each way: how far a part that nobody learned from is off, as it is and mended [mm RMS, its place taken off],
and the processor time of measure [s] (of dots of plastic that of printing and drawing them, too).
"""

import argparse
import re
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))
from PIL import Image
from tests import foreign_layer as foreign

from printmend.learn.learned import learn_model
from printmend.measure.measurement import measure_scans
from printmend.measure.plan import ProbePlan
from printmend.mend.mend import mend_gcode
from printmend.mend.part import measure_part
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.probe import design_probe, write_probe
from printmend.probe.layout import with_net
from printmend.probe.paper import design_sheets, on_paper, papers_of
from printmend.probe.pen import with_pen
from printmend.probe.probe import gcode_of
from printmend.units import A4_MM

PRINTER = read_printer("ender3")
TIP_MM = 0.8
_WORD = re.compile(r"([XYZ])(-?[\d.]+)")


def machine(rng: np.random.Generator) -> foreign.Machine:
    waves = tuple(
        ((1, rng.uniform(0.05, 0.4), rng.uniform(0, 6)), (2, rng.uniform(0, 0.1), rng.uniform(0, 6))) for _ in range(2)
    )
    return foreign.Machine(waves=waves, play=tuple(rng.uniform(0.05, 0.4, 2)))


def drawn(path: Path, broken: foreign.Machine) -> list[np.ndarray]:
    """Return what a pen leaves: the places of its tip while it is down, printed by the broken machine."""
    way, down, at, low = [], [], np.zeros(2), False
    for line in path.read_text().splitlines():
        if not line.startswith(("G0", "G1")):
            continue
        words = {letter: float(value) for letter, value in _WORD.findall(line)}
        if "Z" in words:
            low = words["Z"] < 5.0
        at = np.array([words.get("X", at[0]), words.get("Y", at[1])])
        way.append(at)
        down.append(low)
    printed, down = broken.run(way), np.array(down)
    ends = np.flatnonzero(np.diff(np.concatenate([[0], down, [0]])))
    return [np.vstack([printed[a:b], printed[b - 1] + [1e-3, 0]]) for a, b in zip(ends[::2], ends[1::2], strict=True)]


def plastic(folder: Path, plan: ProbePlan, broken: foreign.Machine, rng: np.random.Generator, dpi: float) -> Trace:
    """Print a probe's dots on the broken machine, sheet after sheet, and measure their scans."""
    write_probe(folder / "dots.gcode", plan)
    scans = []
    for number, path in enumerate(gcode_of(folder / "dots.gcode", plan)):
        places, filament, threads = foreign.printed_dots(path, broken)
        radii = np.where(filament > 1.4 * filament.min(), plan.big_dot_mm, plan.dot_mm) / 2
        if not plan.net:  # the prime line lies beside the dots, with a blob at its end
            prime = plan.sheets[number].waypoints_mm[1:3]
            places, radii, threads = np.vstack([places, prime[1:]]), np.append(radii, 0.5), [*threads, prime]
        scans.append(folder / f"dots{number}.jpg")
        scans[-1].write_bytes(
            foreign.plate(places, radii, rng, threads=threads, dpi=dpi, angle=3.0 - 5 * number, quarter=number)
        )
    return measure_scans(scans, plan).trace


def judged(trace: Trace, broken: foreign.Machine, folder: Path) -> tuple[float, float]:
    mend_gcode(folder / "star.gcode", learn_model(trace, PRINTER), folder / "mended.gcode")
    wanted = folder / "star.gcode"
    return tuple(foreign.paired_error(broken, wanted, folder / name) for name in ("star.gcode", "mended.gcode"))


def said(way: str, before: float, after: float, seconds: float) -> None:
    print(f"{way:22} {before:.3f} → {after:.4f} mm, measured in {seconds:.1f} s of processor time", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--dpi", type=float, default=300.0)
    parser.add_argument(
        "--way", choices=("dots", "net", "sheets", "pen", "scan", "photo"), action="append", help="all without"
    )
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    broken, ways = machine(rng), options.way or ["dots", "net", "sheets", "pen", "scan", "photo"]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "star.gcode").write_text(foreign.gcode(foreign.star())[0])
        text, strokes = foreign.gcode(foreign.gear())
        (folder / "gear.gcode").write_text(text)
        for way, words in (("dots", "dots of plastic"), ("net", "dots in a net"), ("sheets", "dots on two sheets")):
            if way in ways:
                plan = design_probe(PRINTER, glass_mm=(210.0, 297.0))
                if way == "sheets":
                    plan = design_sheets(PRINTER, (150.0, 210.0), 2)
                elif way == "net":
                    plan = with_net(plan, PRINTER)
                if way != "net":  # the prime line lies on the sheet, too
                    paper_mm = A4_MM if way == "dots" else (150.0, 210.0)
                    plan = on_paper(plan, PRINTER, papers_of(plan, PRINTER, paper_mm))
                begun = time.process_time()
                trace = plastic(folder, plan, broken, rng, options.dpi)
                said(words, *judged(trace, broken, folder), time.process_time() - begun)
        if "pen" in ways:
            plan = design_probe(PRINTER, glass_mm=(210.0, 297.0))
            plan = with_pen(on_paper(plan, PRINTER, papers_of(plan, PRINTER, A4_MM)))
            write_probe(folder / "pen.gcode", plan)
            tips = drawn(folder / "pen.gcode", broken)
            scan = foreign.scan(
                tips, rng, dpi=options.dpi, swell=TIP_MM / 2 - foreign.NOZZLE / 2, size_mm=None, stretch=(4e-4, -4e-4)
            )
            (folder / "whole.jpg").write_bytes(scan)
            begun = time.process_time()
            one = measure_scans([folder / "whole.jpg"], plan)
            took = time.process_time() - begun
            said("pen on paper", *judged(one.trace, broken, folder), took)
            picture = Image.open(folder / "whole.jpg")
            halves = []
            for k, (low, high) in enumerate(((0.0, 0.66), (0.34, 1.0))):
                half = picture.crop((int(low * picture.width), 0, int(high * picture.width), picture.height))
                halves.append(folder / f"half{k}.jpg")
                half.rotate(2.0 - 5 * k, Image.Resampling.BICUBIC, expand=True, fillcolor=(226, 224, 220)).save(
                    halves[-1], quality=90, dpi=(options.dpi, options.dpi)
                )
            begun = time.process_time()
            joined = measure_scans(halves, plan)
            took = time.process_time() - begun
            said("pen, two halves joined", *judged(joined.trace, broken, folder), took)
        for way in ("scan", "photo"):
            if way in ways:
                laid = broken.strokes(strokes)
                taken = (
                    foreign.scan(laid, rng, dpi=options.dpi)
                    if way == "scan"
                    else foreign.photo(laid, rng, size_px=(3000, 4000))
                )
                (folder / f"{way}.jpg").write_bytes(taken)
                begun = time.process_time()
                part = measure_part(folder / f"{way}.jpg", folder / "gear.gcode", PRINTER)
                took = time.process_time() - begun
                said(f"a part's first layer, {way}", *judged(part.trace, broken, folder), took)


if __name__ == "__main__":
    main()
