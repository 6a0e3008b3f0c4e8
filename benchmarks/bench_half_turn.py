"""How well a part that shows half a pulley turn teaches the rest: published hulls and families × noise × learners.

    .venv/bin/python benchmarks/bench_half_turn.py --seed 1 --draws 10 --learner greybox --learner prior

Each draw puts one pulley (the same kind, phases of their own) on both motors of the paper's printer, prints a layer
half a turn across, adds noise, learns, plans two other layers of that body optimally (with ``--then``, those of
another body so many turns across, which meets the angles that were not seen) and prints them on the twin. A line:
learner, pulley, noise, the median and the mean of the draws' ratios to the optimum (the optimal plan on the true
machine), the share of draws at most twice the optimum, the median RMSE in full steps, the median seconds of learning,
and z, the root mean square of error/standard deviation over a whole turn of each motor (1: calibrated), its median.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from printmend.corruption import Corruption, Drive, PublishedHull
from printmend.learn import learner
from printmend.learn.mechanism_model import MechanismModel
from printmend.machine import Mechanism
from printmend.metrics import rmse
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from printmend.units import TURN_RAD
from printmend_lab.bench.case import drawn_body
from printmend_lab.control.registry import controller
from printmend_lab.prior import PriorLearner
from printmend_lab.prior.mixture import mixture, parse_weights
from printmend_lab.published import layer_trace
from printmend_lab.sampling import sample

HULLS = ("small", "line", "triangle", "square", "egg")
TURN_MM = 40.0


def machine(name: str, rng: np.random.Generator, severity: str) -> Corruption:
    """Return a machine with that published hull at random phases, or a draw of that family."""
    if name not in HULLS:
        return sample(name, rng, severity)  # type: ignore[arg-type]
    drives = [Drive(pulley=PublishedHull(name, float(rng.uniform(0, TURN_RAD)))) for _ in range(2)]
    return Corruption((drives[0], drives[1]))


def calibration(model: object, truth: Mechanism, printer: Printer, at_mm: np.ndarray) -> float:
    """Return the RMS of (error of the branches)/(their standard deviation) over one turn about ``at_mm`` [2]."""
    if not hasattr(model, "drives"):
        return float("nan")
    ratios = []
    for motor, drive in enumerate(model.drives):
        turn = np.linspace(-0.5, 0.5, 201) * printer.axes[motor].mm_per_turn
        grid = at_mm[motor] + turn
        learned = model.mechanism.transmissions[motor].branches_mm(grid)[0]  # type: ignore[attr-defined]
        true = truth.transmissions[motor].branches_mm(grid)[0]
        # where the plate lay is a gauge: compare with the middle's error taken off
        error = (learned - true) - (learned - true)[100]
        sd = drive.sd_mm(grid)[0]
        floor = np.hypot(sd, 0.01)
        ratios.append(np.mean((error / floor) ** 2))
    return float(np.sqrt(np.mean(ratios)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--learner", action="append")
    parser.add_argument("--pulley", action="append", help="a published hull or a family [the five hulls]")
    parser.add_argument("--severity", choices=("damaged", "realistic"), default="damaged")
    parser.add_argument("--noise-mm", type=float, action="append")
    parser.add_argument("--turns", type=float, default=0.5)
    parser.add_argument("--weights", help="of the learner `prior`, instead of the shipped ones")
    parser.add_argument("--then", type=float)
    options = parser.parse_args()
    printer = read_printer("ender5")
    plan = controller("optimal")
    unshipped = (
        PriorLearner(mixture=mixture(parse_weights(Path(options.weights).read_bytes()))) if options.weights else None
    )
    titles = f"{'noise':>5} {'median':>8} {'mean':>8} {'≤ 2':>5} {'steps':>7} {'s':>6} {'z':>6}"
    print(f"{'learner':10} {'pulley':10} {titles}")
    for name in options.pulley or HULLS:
        for noise_mm in options.noise_mm or (0.0, 0.05):
            found: dict[str, list[tuple[float, float, float, float]]] = {}
            for draw in range(options.draws):
                rng = np.random.default_rng([options.seed, draw])
                twin = Twin.of(machine(name, rng, options.severity), printer)
                body = drawn_body(rng, printer, size_mm=options.turns * TURN_MM)
                first, *others = body.layers
                if options.then:
                    others = list(drawn_body(rng, printer, size_mm=options.then * TURN_MM).layers[:2])
                trace = layer_trace(first, twin.run(first.controls, first.start_steps), printer)
                trace = replace(trace, measured_mm=trace.measured_mm + rng.normal(0, noise_mm, trace.measured_mm.shape))
                middle = (trace.commanded_mm.min(axis=0) + trace.commanded_mm.max(axis=0)) / 2

                def printed(model: object, twin: Twin = twin, others: list = others) -> float:
                    wanted = np.concatenate([layer.nominal_steps for layer in others])
                    plans = [plan.plan(model, each.nominal_steps[1:], each.start_steps) for each in others]  # type: ignore[arg-type]
                    ways = [twin.run(p.controls, o.start_steps) for p, o in zip(plans, others, strict=True)]
                    return rmse(wanted, np.concatenate(ways))

                assert isinstance(twin.mechanism, Mechanism)
                optimum = printed(MechanismModel(twin.mechanism))
                for each in options.learner or ("greybox",):
                    begun = time.perf_counter()
                    model = (unshipped if unshipped and each == "prior" else learner(each)).fit(
                        trace, printer, rng=np.random.default_rng(draw)
                    )
                    seconds = time.perf_counter() - begun
                    steps = printed(model)
                    z = calibration(model, twin.mechanism, printer, middle)
                    found.setdefault(each, []).append((steps / optimum, steps, seconds, z))
            for each, rows in found.items():
                ratio, steps, seconds, z = np.array(rows).T
                print(
                    f"{each:10} {name:10} {noise_mm:5.2f} {np.median(ratio):8.2f} {ratio.mean():8.2f} "
                    f"{(ratio <= 2).mean():5.2f} {np.median(steps):7.3f} {np.median(seconds):6.2f} {np.median(z):6.2f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
