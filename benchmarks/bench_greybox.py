"""How well and how fast the grey box learns: families × noise × traces, errors of the learned machine in mm.

    .venv/bin/python benchmarks/bench_greybox.py --seed 1 --draws 5 --noise-mm 0.05 [--printer ender3] [--trace probe]

Each draw breaks a printer, prints a trace on the twin, adds noise, learns, and sends both machines, the true and the
learned, through the same 4000 random moves over the bed: the error is the RMS distance between the two. ``--trace`` is
``probe`` (the marks of `printmend probe`), or a number of points on diagonals and staircases over the bed.
"""

import argparse
import json
import time

import numpy as np

from printmend.corruption import HEALTHY
from printmend.machine import Mechanism
from printmend.path import Trace
from printmend.printer import Printer, read_printer
from printmend.probe import design_probe
from printmend.twin import Twin
from printmend_lab.greybox import Greybox
from printmend_lab.sampling import families, sample

MOVES = 4000


def diagonals(printer: Printer, points: int) -> np.ndarray:
    """Return way-points [points, 2]: home, then both diagonals there and back, with shrinking reversals."""
    low = np.array([printer.x.min_mm, printer.y.min_mm]) + 8.0
    high = np.array([printer.x.max_mm, printer.y.max_mm]) - 8.0
    corners = [np.array([low[0], low[1]]), high, np.array([low[0], high[1]]), np.array([high[0], low[1]])]
    path = [np.array(printer.home_mm)]
    for a, b in ((corners[0], corners[1]), (corners[2], corners[3])):
        path += [a, b, a]
        share, reach = 0.0, 0.25
        while share < 1.0 and reach > 0.008:
            path += [a + (b - a) * min(share + reach, 1.0), a + (b - a) * (share + 0.4 * reach)]
            share, reach = share + 0.4 * reach, 0.9 * reach
    corner = np.array(path)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corner, axis=0), axis=1))])
    wanted = np.union1d(along, np.linspace(0, along[-1], max(points - len(along), 0)))
    return np.stack([np.interp(wanted, along, corner[:, axis]) for axis in range(2)], axis=1)


def make_trace(twin: Twin, kind: str, noise_mm: float, rng: np.random.Generator) -> Trace:
    if kind == "probe":
        plan = design_probe(twin.printer)
        printed = twin.follow(plan.waypoints_mm)[plan.rows]
        return plan.trace(printed + rng.normal(0, noise_mm, printed.shape))
    points = diagonals(twin.printer, int(kind))
    printed = twin.follow(points)
    return Trace(points, printed + rng.normal(0, noise_mm, printed.shape), homed=True)


def machine_error_mm(learned: Mechanism, truth: Mechanism, rng: np.random.Generator) -> float:
    """Return the RMS distance of two machines over random moves on the part of the bed that the true one reaches."""
    printer = truth.printer
    low, high = np.array([printer.x.min_mm, printer.y.min_mm]), np.array([printer.x.max_mm, printer.y.max_mm])
    points = np.concatenate([[printer.home_mm], low + (high - low) * rng.random((MOVES, 2))])
    ways = []
    for machine in (learned, truth):
        motors = printer.to_motor(points)
        belts = np.empty_like(motors)
        for motor, table in enumerate(machine.transmissions):
            lower, upper = table.branches_mm(motors[:, motor])
            place = lower[0]
            for i in range(len(points)):
                place = min(max(place, lower[i]), upper[i])
                belts[i, motor] = place
        ways.append(machine.frame.apply(printer.from_motor(belts)))
    return float(np.sqrt(np.mean(np.sum((ways[0] - ways[1])[50:] ** 2, axis=1))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--draws", type=int, default=5)
    parser.add_argument("--noise-mm", type=float, action="append")
    parser.add_argument("--printer", action="append")
    parser.add_argument("--family", action="append")
    parser.add_argument("--severity", choices=("damaged", "realistic"), default="damaged")
    parser.add_argument("--trace", default="probe")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    names = options.family or ["healthy", *(f for f in families() if f != "gain-table")]
    learner = Greybox()
    if not options.json:
        print(
            f"{'printer':8} {'family':17} {'noise':>5}  {'before':>8}  {'median':>8} {'p90':>8} {'worst':>8}  seconds"
        )
    for preset in options.printer or ["ender3"]:
        printer = read_printer(preset)
        for noise_mm in options.noise_mm or [0.0, 0.05, 0.1]:
            for name in names:
                rows = []
                for draw in range(options.draws):
                    rng = np.random.default_rng([options.seed, draw])
                    corruption = HEALTHY if name == "healthy" else sample(name, rng, options.severity)
                    twin = Twin.of(corruption, printer)
                    trace = make_trace(twin, options.trace, noise_mm, rng)
                    start = time.perf_counter()
                    model = learner.fit(trace, printer, rng=rng)
                    seconds = time.perf_counter() - start
                    assert isinstance(twin.mechanism, Mechanism)
                    error = machine_error_mm(model.mechanism, twin.mechanism.homed(), rng)
                    rows.append((error, model.residual_before_mm, seconds, model.is_healthy))
                    if options.json:
                        record = dict(zip(("error_mm", "before_mm", "seconds", "healthy"), rows[-1], strict=True))
                        print(
                            json.dumps(
                                {"printer": preset, "family": name, "noise_mm": noise_mm, "draw": draw, **record}
                            )
                        )
                error, before, seconds, healthy = np.array(rows, float).T
                if not options.json:
                    print(
                        f"{preset:8} {name:17} {noise_mm:5.2f}  {np.median(before):8.3f}  {np.median(error):8.4f} "
                        f"{np.quantile(error, 0.9):8.4f} {error.max():8.4f}  {np.median(seconds):.2f}"
                        f"{f'  {int(healthy.sum())} found healthy' if healthy.any() else ''}",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
