"""Planning speed of every model and controller, with the error reached and whether plans equal the published loop's.

python benchmarks/bench_planning.py [--targets 200000] [--check 300] [--json]
python benchmarks/bench_planning.py --loose

Trains on the longest layer of the shipped pulley, plans others. `first` is the first plan call, tables included;
`targets/s` the best of three later calls on a layer there and back, as often as needed. Seconds are of the CPU, which
a busy machine disturbs less. With --loose: one layer on machines with much play, cartesian and CoreXY, in targets a
second an axis: a layer of N targets has 2N of them. Of a CoreXY it also says how many states the search follows.
"""

import argparse
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from printmend.corruption import Corruption, Drive, Play, PublishedHull
from printmend.errors import InputError
from printmend.learn import fit, model_names
from printmend.learn.mechanism_model import MechanismModel
from printmend.printer import read_printer
from printmend.protocols import State, WorldModel
from printmend.twin import Twin
from printmend_lab.body import body_of, demo_body_gcode
from printmend_lab.control.kernels import coupled
from printmend_lab.control.registry import controller, controller_names
from printmend_lab.path import Layer
from printmend_lab.published import layer_trace
from printmend_lab.sampling import sample


@dataclass(frozen=True, eq=False)
class Untabulated:
    """A model stripped of its tables, so that a planner must try all controls one target at a time."""

    base: Any

    @property
    def printer(self):
        return self.base.printer

    def start(self, start_steps: np.ndarray) -> State:
        return self.base.start(start_steps)

    def advance(self, state: State, controls: np.ndarray) -> State:
        return self.base.advance(state, controls)

    def tabulate(self, start_steps: np.ndarray, *, c_max: int = 3) -> None:
        return None


def rmse(twin: Twin, controls: np.ndarray, layer: Layer) -> float:
    try:
        missed = twin.run(controls, layer.start_steps) - layer.nominal_steps
    except InputError:  # the plan drifts off the machine
        return float("inf")
    return float(np.sqrt((missed**2).sum(axis=1).mean()))


def measure(name: str, planner: str, model: WorldModel, twin: Twin, layers: list[Layer], args) -> dict:
    plan = controller(planner).plan
    started = time.process_time()
    plan(model, layers[0].nominal_steps[1:], layers[0].start_steps)
    first_s = time.process_time() - started
    errors = []
    for layer in layers:
        controls = plan(model, layer.nominal_steps[1:], layer.start_steps).controls
        errors.append(rmse(twin, controls, layer))
    lap = np.concatenate([layers[0].nominal_steps[1:], layers[0].nominal_steps[-2::-1]])
    long = np.tile(lap, (args.targets // len(lap) + 1, 1))[: args.targets]
    best_s = np.inf
    for _ in range(3):
        started = time.process_time()
        plan(model, long, layers[0].start_steps)
        best_s = min(best_s, time.process_time() - started)
    equal = None
    if planner == "greedy":
        few = layers[0].nominal_steps[1 : args.check + 1]
        fast, slow = (plan(each, few, layers[0].start_steps) for each in (model, Untabulated(model)))
        equal = bool(np.array_equal(fast.controls, slow.controls))
    return {
        "model": name,
        "controller": planner,
        "first_s": first_s,
        "targets_per_s": args.targets / best_s,
        "rmse_steps": float(np.mean(errors)),
        "equal": equal,
    }


@contextmanager
def counted(states: list[int]) -> Iterator[None]:
    """Add to ``states`` how many the search for both motors follows meanwhile."""
    follow = coupled.follow

    def counting(*arguments: object) -> tuple:
        found = follow(*arguments)
        states[0] += len(found[3])
        return found

    coupled.follow = counting
    try:
        yield
    finally:
        coupled.follow = follow


def loose() -> None:
    for preset in ("ender5", "corexy"):
        printer = read_printer(preset)
        layer = body_of(demo_body_gcode(), printer, name="pulley").layers[0]
        machines = {
            f"{family}, seed {seed}": sample(family, np.random.default_rng(seed))
            for family in ("pulley-loose", "everything")
            for seed in range(4 if family == "pulley-loose" else 2)
        }
        for hull in ("ideal", "egg", "line", "small"):
            drive = Drive(pulley=PublishedHull(hull, 0.3), belt=Play(2.0))
            machines[f"{hull} hull, 2 mm of play"] = Corruption((drive, drive))
        print(f"\n{preset}: million targets/s an axis, RMSE in steps")
        for name, corruption in machines.items():
            model, shown, followed = MechanismModel(corruption.lower(printer)), [], [0]
            for planner in ("greedy", "lookahead", "optimal"):
                best_s = np.inf
                for _ in range(4):
                    started = time.process_time()
                    plan = controller(planner).plan(model, layer.nominal_steps[1:], layer.start_steps)
                    best_s = min(best_s, time.process_time() - started)
                missed = float(np.sqrt(((plan.imagined_steps - layer.nominal_steps) ** 2).sum(axis=1).mean()))
                shown.append(f"{planner} {2 * layer.transitions / best_s / 1e6:5.2f} {missed:6.3f}")
            with counted(followed):
                controller("optimal").plan(model, layer.nominal_steps[1:], layer.start_steps)
            if followed[0]:
                shown.append(f"{followed[0] / layer.transitions:.1f} states followed a target")
            print(f"{name:28}{'   '.join(shown)}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--targets", type=int, default=200_000)
    parser.add_argument("--check", type=int, default=300)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--loose", action="store_true")
    args = parser.parse_args()
    if args.loose:
        loose()
        return
    planners = [name for name in controller_names() if name != "beam" and "-" not in name]  # neither is for speed
    for preset, family in (
        ("ender5", "gain-table"),
        ("ender5", "pulley"),
        ("ender5", "pulley-loose"),
        ("corexy", "pulley-loose"),
    ):
        printer, rng = read_printer(preset), np.random.default_rng(7)
        twin = Twin.of(sample(family, rng), printer)
        body = body_of(demo_body_gcode(), printer, name="pulley")
        training = body.training_layer
        layers = [layer for layer in body.layers if layer is not training][::8]
        trace = layer_trace(training, twin.run(training.controls, training.start_steps), printer)
        if not args.json:
            print(
                f"\n{preset}, {family}: {len(layers)} layers of the pulley, {training.transitions} points to learn from"
            )
        for name in model_names():
            started = time.process_time()
            model = fit(name, trace, printer, rng=np.random.default_rng(0), truth=twin.mechanism)
            fit_s = time.process_time() - started
            for planner in planners if name in ("oracle", "greybox") else ["greedy"]:
                row = {"printer": preset, "family": family, "fit_s": fit_s}
                row |= measure(name, planner, model, twin, layers, args)
                if args.json:
                    print(json.dumps(row))
                    continue
                print(
                    f"{name:24}{planner:10}{row['targets_per_s'] / 1e6:7.2f} M targets/s  "
                    f"first {row['first_s'] * 1e3:6.1f} ms  "
                    f"learned in {fit_s:5.2f} s  RMSE {row['rmse_steps']:8.3f} steps  "
                    f"{'' if row['equal'] is None else 'plan equal' if row['equal'] else 'PLAN DIFFERS'}"
                )


if __name__ == "__main__":
    main()
