"""Faults that nobody wrote down: how well the grey box and the hybrid print on them.

    .venv/bin/python benchmarks/bench_hybrid.py --seed 1 --draws 4 --coverage 1 --noise-mm 0.05

Each draw bends the tables of both motors by functions that are no part of `printmend.corruption`, prints one layer
of a random body, adds noise, learns, plans the other layers with the optimal controller and prints them. Figures are
full steps, mean over the draws, and the ratio to the optimum (the optimal controller on the true machine).
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from printmend.learn import fit
from printmend.machine import Mechanism, Transmission, healthy_mechanism
from printmend.metrics import rmse
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from printmend_lab.bench.case import drawn_body
from printmend_lab.control.registry import controller
from printmend_lab.published import layer_trace
from printmend_lab.sampling import sample

Bend = Callable[[np.random.Generator, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""From motor positions [N] to what is added to the lower and the upper table [N]."""


def process(rng: np.random.Generator, motor_mm: np.ndarray, size_mm: float, length_mm: float) -> np.ndarray:
    """Return a random smooth function [N] of that standard deviation and length: 400 random waves."""
    rate, phase = rng.normal(0, 1 / length_mm, 400), rng.uniform(0, 2 * np.pi, 400)
    return size_mm * np.sqrt(2 / 400) * np.cos(np.outer(motor_mm, rate) + phase).sum(axis=1)


def both(error_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return error_mm, error_mm


def two_faces(rng: np.random.Generator, motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forwards another error than backwards."""
    lower, upper = (process(rng, motor_mm, 0.25, 15.0) for _ in range(2))
    return np.minimum(lower, upper - 0.05), np.maximum(upper, lower + 0.05)


def idlers(rng: np.random.Generator, motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two eccentric idlers, whose turns are not the motor's."""
    a, b = rng.uniform(0, 2 * np.pi, 2)
    return both(0.25 * np.sin(motor_mm / 5.0 + a) + 0.15 * np.sin(motor_mm / 4.1 + b))


def dents(rng: np.random.Generator, motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sudden steps at a few places: a spliced belt."""
    places = rng.uniform(0, 220, 6)
    return both(sum(rng.uniform(0.1, 0.4) * np.tanh((motor_mm - place) / 0.3) for place in places))


BENDS: dict[str, tuple[str | None, Bend]] = {
    "two-faces": (None, two_faces),
    "short-waves": (None, lambda rng, m: both(process(rng, m, 0.1, 4.0))),
    "idlers": (None, idlers),
    "dents": (None, dents),
    "pulley+dents": ("pulley", dents),
    "pulley-play+smooth": ("pulley-play", lambda rng, m: both(process(rng, m, 0.5, 25.0))),
    "pulley-loose+two-faces": ("pulley-loose", two_faces),
    "pulley": ("pulley", lambda rng, m: both(np.zeros(len(m)))),
    "healthy": (None, lambda rng, m: both(np.zeros(len(m)))),
}


def bent(name: str, printer: Printer, rng: np.random.Generator) -> Mechanism:
    family, bend = BENDS[name]
    base = healthy_mechanism(printer) if family is None else Twin.of(sample(family, rng), printer).mechanism
    assert isinstance(base, Mechanism)
    tables = []
    for table in base.transmissions:
        lower, upper = bend(rng, table.motor_mm)
        low = np.maximum.accumulate(table.lower_mm + lower)
        high = np.maximum(np.maximum.accumulate(table.upper_mm + upper), low)
        tables.append(Transmission(table.first_mm, table.pitch_mm, low, high))
    return replace(base, transmissions=(tables[0], tables[1]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--draws", type=int, default=4)
    parser.add_argument("--coverage", type=float, default=1.0)
    parser.add_argument("--noise-mm", type=float, default=0.05)
    parser.add_argument("--printer", default="ender5")
    parser.add_argument("--fault", action="append")
    parser.add_argument("--model", action="append")
    options = parser.parse_args()
    names = options.model or ["greybox", "hybrid"]
    printer = read_printer(options.printer)
    print(f"{'fault':24} {'optimum':>8} " + " ".join(f"{name:>16} {'s':>5}" for name in names))
    for fault in options.fault or BENDS:
        errors: dict[str, list[float]] = {name: [] for name in ("oracle", *names)}
        seconds: dict[str, list[float]] = {name: [] for name in names}
        notes: list[str] = []
        for draw in range(options.draws):
            rng = np.random.default_rng([options.seed, draw])
            twin = Twin(bent(fault, printer, rng))
            body = drawn_body(rng, printer, size_mm=40.0 * options.coverage)
            layer = body.layers[0]
            trace = layer_trace(layer, twin.run(layer.controls, layer.start_steps), printer)
            noise = rng.normal(0, options.noise_mm, trace.measured_mm.shape)
            trace = replace(trace, measured_mm=trace.measured_mm + noise)
            for name in errors:
                begun = time.perf_counter()
                model = fit(name, trace, printer, rng=np.random.default_rng(0), truth=twin.mechanism)
                seconds.get(name, []).append(time.perf_counter() - begun)
                notes += [each.words for each in getattr(model, "residuals", ()) if each is not None and each.words]
                square, count = 0.0, 0
                for other in body.layers[1:]:
                    plan = controller("optimal").plan(model, other.nominal_steps[1:], other.start_steps)
                    printed = twin.run(plan.controls, other.start_steps)
                    square += rmse(other.nominal_steps, printed) ** 2 * len(printed)
                    count += len(printed)
                errors[name].append(float(np.sqrt(square / count)))
        best = float(np.mean(errors["oracle"])) + 1e-12
        cells = " ".join(
            f"{np.mean(errors[name]):8.3f} ({np.mean(errors[name]) / best:5.2f}) {np.median(seconds[name]):5.2f}"
            for name in names
        )
        print(f"{fault:24} {best:8.3f} {cells}  {'; '.join(sorted(set(notes)))}", flush=True)


if __name__ == "__main__":
    main()
