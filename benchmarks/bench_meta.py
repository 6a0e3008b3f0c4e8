"""How much a learner makes of few points: on faults of known kinds, on kinds that `meta` was not taught, on half a
turn.

    .venv/bin/python benchmarks/bench_meta.py --samples 6 --learners meta,greybox,hybrid

For each kind and number of points: the RMS over drawn machines [mm] of how far another print is from where the model
says, median over the machines, and how often it lies within 1.645 standard deviations (90 % is right), where the
learner states some. Last, how long each takes to learn from 5000 rows of a layer. The seed is kept for the table in
results.md: take another to develop. `taught` are drives like
those of the lessons, drawn anew.
"""

import argparse
import time

import numpy as np

from printmend.errors import PrintmendError
from printmend.learn import fit
from printmend.machine import Mechanism, Transmission
from printmend.machine.printing import print_from_home
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend_lab.bench.prints import SHAPES, path_print
from printmend_lab.body import body_of, demo_body_gcode
from printmend_lab.meta.tasks import draw_drive
from printmend_lab.published import layer_trace
from printmend_lab.sampling import sample

SEED, NOISE_MM = 77001, 0.05
KINDS = ("pulley-play", "pulley-loose", "elastic", "frame", "smooth", "taught, no family")
WAYS = (("zigzag", 30), ("zigzag", 60), ("zigzag", 250), ("zigzag", 1000), ("half-turn", 250))
ASKED = 300
ROWS, REPEATS = 5000, 12


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=6)
    parser.add_argument("--learners", default="meta,greybox,hybrid")
    parser.add_argument("--seed", type=int, default=SEED)
    options = parser.parse_args()
    names = options.learners.split(",")
    print(f"| kind | print | points | {' | '.join(names)} | within 90 %: {', '.join(names)} |")
    print("|---|---|---:|" + "---:|" * len(names) + "---|")
    seconds = dict.fromkeys(names, 0.0)
    for kind in KINDS:
        for shape, points in WAYS:
            errors: dict[str, list[float]] = {name: [] for name in names}
            inside: dict[str, list[float]] = {name: [] for name in names}
            for number in range(options.samples):
                for name, (error, share, spent) in judged(kind, shape, points, (options.seed, number), names).items():
                    errors[name].append(error)
                    seconds[name] += spent
                    inside[name] += [share] * (share >= 0)
            texts = [f"{np.median(errors[name]):.3f}" for name in names]
            shares = [f"{100 * np.mean(inside[name]):.0f} %" if inside[name] else "–" for name in names]
            print(f"| {kind} | {shape} | {points} | {' | '.join(texts)} | {', '.join(shares)} |", flush=True)
    total = len(KINDS) * len(WAYS) * options.samples
    print("seconds of processor a print:", {name: round(spent / total, 3) for name, spent in seconds.items()})
    print(f"seconds of processor for {ROWS} rows:", {name: round(seconds_to_learn(name), 4) for name in names})


def drawn(kind: str, shape: str, points: int, seed: tuple[int, int]) -> tuple[Trace, Twin, np.ndarray]:
    """Return what was measured of a drawn machine's print, the machine, and a way that was not seen."""
    printer = read_printer("ender5")
    rng = np.random.default_rng([*seed, KINDS.index(kind)])
    twin = Twin(_machine(kind, rng, printer))
    way = path_print(printer, SHAPES[shape](printer, rng), points)
    printed = twin.follow(way.waypoints_mm)
    measured = np.full(printed.shape, np.nan)
    measured[way.rows] = printed[way.rows] + rng.normal(0.0, NOISE_MM, (len(way.rows), 2))
    middle, span = way.waypoints_mm[1:].mean(axis=0), 20.0 if shape == "half-turn" else 50.0
    asked = np.vstack([way.waypoints_mm[0], middle + rng.uniform(-span, span, (ASKED, 2))])
    return Trace(way.waypoints_mm, measured, homed=True), twin, asked


def judged(
    kind: str, shape: str, points: int, seed: tuple[int, int], names: list[str]
) -> dict[str, tuple[float, float, float]]:
    """Return for each learner the RMS error [mm] of a way that it has not seen, the share inside its band (−1 where it
    states none), and the processor's seconds."""
    trace, twin, asked = drawn(kind, shape, points, seed)
    truth = twin.follow(asked)[1:]
    found = {}
    for name in names:
        begun = time.process_time()
        try:
            model = fit(name, trace, twin.printer, rng=np.random.default_rng(0))
        except PrintmendError:
            found[name] = (np.inf, -1.0, time.process_time() - begun)
            continue
        spent = time.process_time() - begun
        error = print_from_home(model.mechanism, asked[1:]) - truth  # type: ignore[attr-defined]
        found[name] = (float(np.sqrt(np.mean(error**2))), _inside(model, twin, asked), spent)
    return found


def seconds_to_learn(name: str) -> float:
    """Return what learning takes from `ROWS` rows of the shipped body's largest layer, the least of `REPEATS` times."""
    printer = read_printer("ender5")
    layer = body_of(demo_body_gcode(), printer, name="demo").training_layer
    twin = Twin.of(sample("pulley-play", np.random.default_rng(1)), printer)
    trace = layer_trace(layer, twin.run(layer.controls, layer.start_steps), printer)
    trace = Trace(trace.commanded_mm[:ROWS], trace.measured_mm[:ROWS], homed=trace.homed)
    spent = []
    for _ in range(REPEATS):
        begun = time.process_time()
        fit(name, trace, printer, rng=np.random.default_rng(0))
        spent.append(time.process_time() - begun)
    return min(spent)


def _inside(model: object, twin: Twin, asked: np.ndarray) -> float:
    """Return how often the true branches lie within 1.645 standard deviations of the model's; −1 without any."""
    drives = getattr(getattr(model, "greybox", model), "drives", None)
    if drives is None or kind_of_frame(twin):
        return -1.0
    hits = []
    for motor, drive in enumerate(drives):
        at = np.sort(asked[1:, motor])
        sides = zip(
            model.mechanism.transmissions[motor].branches_mm(at),  # type: ignore[attr-defined]
            twin.homed().transmissions[motor].branches_mm(at), drive.sd_mm(at), strict=True,
        )  # fmt: skip
        hits += [np.abs(said - true) <= 1.645 * sd for said, true, sd in sides]
    return float(np.mean(hits))


def kind_of_frame(twin: Twin) -> bool:
    return not twin.homed().frame.is_identity


def _machine(kind: str, rng: np.random.Generator, printer) -> Mechanism:  # type: ignore[no-untyped-def]
    if kind in KINDS[:-1]:
        found = sample(kind, rng).lower(printer)
        assert isinstance(found, Mechanism)
        return found
    tables = []
    for _ in range(2):
        drive = draw_drive(rng, printer, outside=1.0)
        at = np.arange(len(drive.lower_mm)) * 0.2
        grid = np.arange(0.0, at[-1] + 1e-9, 0.0125)
        lower, upper = (np.interp(grid, at, at + one) for one in (drive.lower_mm, drive.upper_mm))
        tables.append(Transmission(0.0, 0.0125, lower, upper))
    return Mechanism(printer, (tables[0], tables[1]))


if __name__ == "__main__":
    main()
