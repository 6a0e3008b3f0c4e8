"""Scans: error and share of the marks found, marks taken for another, time and memory.

.venv/bin/python benchmarks/bench_scan.py [--scans 20] [--photos 5] [--identities 1000] [--seed 1]

Every scan shows a fresh printer, broken by a random family and severity but off by 10 mm at most, in a random pose
(also mirrored), with fresh dirt; heavy dirt also with random colours. The error of a mark is its distance, along one
axis, from where the nozzle was; the scanner's own stretch is not counted (a second scan removes it). Without --seed the
seed is fresh and printed. With --lost a share of the marks came off, and points alone are identified: of any marks, of
one corner, one stripe or one side.
"""

import argparse
import secrets
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from printmend.errors import PrintmendError
from printmend.measure import ProbePlan, write_plan
from printmend.measure.image import write_image
from printmend.measure.marks import read_marks
from printmend.measure.scan import read_scan
from printmend.printer import read_printer
from printmend.probe import design_probe
from printmend.twin import Twin
from printmend.twin.scanner import DEFAULT, HEAVY, Degradations, render_scan
from printmend_lab.camera import render_photo
from printmend_lab.sampling import families, sample

PRINTER = read_printer("ender3")
OFF_MM = 10.0
LEAST_CONTRAST = 70
# the peak of the child alone: what getrusage reports for children includes what the parent had when it forked
CHILD = """
import sys, time
from printmend.cli.main import group
group(standalone_mode=False)
peak = [line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")]
print(time.process_time(), peak[0])
"""


def printed_marks(plan: ProbePlan, rng: np.random.Generator) -> np.ndarray:
    """Print the plan on a fresh broken printer that is off by OFF_MM at most."""
    while True:
        family = str(rng.choice([name for name in families() if name != "gain-table"]))
        severity = "damaged" if rng.random() < 0.7 else "realistic"
        try:
            twin = Twin.of(sample(family, rng, severity=severity), PRINTER)
            printed = twin.follow(plan.waypoints_mm)[plan.rows]
        except PrintmendError:
            continue
        off = printed - plan.marks_mm
        if np.abs(off - off.mean(axis=0)).max() <= OFF_MM:
            return printed


def random_colours(dirt: Degradations, rng: np.random.Generator) -> Degradations:
    while True:
        filament, background = rng.integers(20, 235, (2, 3))
        if np.linalg.norm(filament - background) > LEAST_CONTRAST:
            return replace(dirt, filament=tuple(map(int, filament)), background=tuple(map(int, background)))


def bench_scans(name: str, dirt: Degradations, count: int, rng: np.random.Generator, folder: Path) -> None:
    plan = design_probe(PRINTER)
    errors, found, wrong, refused, seconds = [], [], 0, 0, []
    for _ in range(count):
        look = random_colours(dirt, rng) if dirt is HEAVY else dirt
        printed = printed_marks(plan, rng)
        scan = render_scan(
            printed, plan, degradations=look, rng=rng,
            quarter_turns=int(rng.integers(4)), mirrored=bool(rng.random() < 0.3),
        )  # fmt: skip
        write_image(folder / "scan.png", scan.image, dpi=scan.dpi)
        begun = time.perf_counter()
        try:
            reading = read_scan(folder / "scan.png", plan)
        except PrintmendError as error:
            refused += 1
            print(f"  refused: {error}")
            continue
        seconds.append(time.perf_counter() - begun)
        dot = reading.marks.match.dot
        have = dot >= 0
        off_px = reading.dots.centre_px[dot[have]] - scan.marks_px[have]
        errors.append(off_px * 25.4 / scan.dpi)
        found.append((have & scan.present).sum() / scan.present.sum())
        wrong += int((np.hypot(*errors[-1].T) > 0.5 * plan.pitch_mm).sum())
    error = np.concatenate(errors) * 1000
    print(
        f"{name}: {count} scans of {len(plan)} marks, error {np.sqrt((error**2).mean()):.1f} um RMS, "
        f"p99 {np.quantile(np.abs(error), 0.99):.0f}, max {np.abs(error).max():.0f}; found {np.mean(found):.2%} "
        f"of the dots that are there (worst scan {np.min(found):.2%}); taken for another {wrong}; refused {refused}; "
        f"median {np.median(seconds):.1f} s to read"
    )


def bench_photos(count: int, rng: np.random.Generator, folder: Path) -> None:
    plan = design_probe(PRINTER, size_mm=150)
    errors, found = [], []
    for _ in range(count):
        printed = plan.marks_mm + 0.3 * np.sin(plan.marks_mm / 6 + rng.uniform(0, 6, 2))
        write_image(folder / "photo.jpg", render_photo(printed, plan, rng=rng), dpi=72)
        try:
            measured = read_scan(folder / "photo.jpg", plan).marks.measured_mm
        except PrintmendError as error:
            print(f"  refused: {error}")
            continue
        have = np.isfinite(measured).all(axis=1)
        off = (measured - printed)[have]
        # the turn of the plate is not known: take out what one rotation explains
        xy = printed[have] - printed[have].mean(axis=0)
        off -= off.mean(axis=0)
        turn = (xy[:, 0] * off[:, 1] - xy[:, 1] * off[:, 0]).sum() / (xy**2).sum()
        errors.append(off - turn * np.stack([-xy[:, 1], xy[:, 0]], axis=1))
        found.append(have.mean())
    error = np.concatenate(errors) * 1000
    print(f"photos: {count}, error {np.sqrt((error**2).mean()):.1f} um RMS, found {np.mean(found):.2%}")


def lost_marks(kind: str, share: float, plan: ProbePlan, rng: np.random.Generator) -> np.ndarray:
    """Return which marks [M] came off: any, one corner, one stripe across the plate, or one side."""
    at = plan.marks_mm
    if kind == "any":
        return rng.random(len(at)) < share
    if kind == "corner":
        from_corner = np.abs(at - np.where(rng.random(2) < 0.5, at.min(axis=0), at.max(axis=0))).max(axis=1)
        return from_corner <= np.quantile(from_corner, share)
    place = at[:, rng.integers(2)] * rng.choice([-1, 1])
    first = 0.0 if kind == "side" else rng.uniform(0.1, 0.9 - share)
    return (place >= np.quantile(place, first)) & (place <= np.quantile(place, first + share))


def bench_identities(count: int, rng: np.random.Generator, kind: str = "any", share: float = 0.03) -> None:
    """Points instead of pixels: a share of the dots gone, dust of the size of dots, 30 um of noise, any turn,
    mirrored."""
    plan = design_probe(PRINTER)
    wrong, refused, shares = 0, 0, []
    for _ in range(count):
        printed = printed_marks(plan, rng)
        angle = rng.uniform(0, 2 * np.pi)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        kept = np.flatnonzero(~lost_marks(kind, share, plan, rng))
        dots = (printed * [rng.choice([-1.0, 1.0]), -1.0] @ turn)[kept] + rng.normal(0, 0.03, (len(kept), 2))
        dust = rng.uniform(dots.min(axis=0), dots.max(axis=0), (rng.poisson(15), 2))
        sizes = plan.diameter_mm[kept] * (1 + rng.normal(0, 0.1, len(kept)))
        sizes = np.concatenate([sizes, rng.uniform(0.6, 1.6, len(dust))])
        order = rng.permutation(len(sizes))
        marks = read_marks(np.vstack([dots, dust])[order], sizes[order], plan)
        if marks is None:
            refused += 1
            continue
        truth = np.full(len(plan), -1)
        truth[kept] = np.argsort(order)[: len(kept)]
        other = marks.found & (marks.match.dot != truth)
        # dust within a quarter of a millimetre of a lost dot is a bad measurement, not another mark
        wrong += int((other & np.isin(marks.match.dot, truth[truth >= 0])).sum())
        shares.append((marks.found & ~other).sum() / len(kept))
    print(
        f"identity, {share:.0%} lost ({kind}): {count} prints, marks taken for another {wrong}, refused {refused}, "
        f"found {np.mean(shares or [0]):.2%} (worst {np.min(shares or [0]):.2%})"
    )


def bench_process(rng: np.random.Generator, folder: Path) -> None:
    plan = design_probe(PRINTER)
    write_plan(folder / "probe.json", plan)
    scan = render_scan(plan.marks_mm, plan, rng=rng)
    for name in ("scan.png", "scan.jpg"):
        write_image(folder / name, scan.image, dpi=scan.dpi)
        arguments = [
            "measure",
            str(folder / name),
            "--probe",
            str(folder / "probe.json"),
            "-o",
            str(folder / "trace.csv"),
        ]
        begun = time.perf_counter()
        child = subprocess.run([sys.executable, "-c", CHILD, *arguments], check=True, capture_output=True, text=True)  # noqa: S603 — our own command
        wall = time.perf_counter() - begun
        cpu, peak_kb = child.stdout.splitlines()[-1].split()
        height, width = scan.image.shape[:2]
        print(
            f"process, {name} {width} × {height}: {wall:.1f} s ({float(cpu):.1f} s of CPU), "
            f"{int(peak_kb) / 1024:.0f} MB"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scans", type=int, default=20)
    parser.add_argument("--photos", type=int, default=5)
    parser.add_argument("--identities", type=int, default=1000)
    parser.add_argument("--lost", type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=None)
    options = parser.parse_args()
    seed = secrets.randbits(32) if options.seed is None else options.seed
    print(f"seed {seed}")
    rng = np.random.default_rng(seed)
    if options.lost:
        for kind in ("any", "corner", "stripe", "side"):
            bench_identities(options.identities, rng, kind, options.lost)
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bench_process(rng, folder)
        if options.identities:
            bench_identities(options.identities, rng)
        if options.photos:
            bench_photos(options.photos, rng, folder)
        if options.scans:
            bench_scans("default", DEFAULT, options.scans, rng, folder)
            bench_scans("heavy", HEAVY, options.scans, rng, folder)


if __name__ == "__main__":
    main()
