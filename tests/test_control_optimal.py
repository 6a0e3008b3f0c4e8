"""Controllers that plan ahead: against exhaustive search, and where Algorithm 1 deadlocks."""

from dataclasses import replace

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive, Play, PublishedHull
from printmend.errors import ModelError
from printmend.learn.mechanism_model import MechanismModel
from printmend.machine import PlayTables, lattice_tables, run_motors
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from printmend_lab.control import coupled, optimal
from printmend_lab.control.coupled import window
from printmend_lab.control.kernels import coupled as kernels
from printmend_lab.control.registry import controller
from printmend_lab.path import Plan
from printmend_lab.sampling import sample
from tests import naive_control
from tests.shapes import layer_along, ring_layer

LAYER = ring_layer((530.0, 530.0), 70.0)
START = LAYER.start_steps
TARGETS = LAYER.nominal_steps[1:].astype(float)


def rmse(plan: Plan, targets: np.ndarray = TARGETS) -> float:
    return float(np.sqrt(((plan.imagined_steps[1:] - targets) ** 2).sum(axis=1).mean()))


def worn(hull: str, play_steps: float, printer: Printer) -> MechanismModel:
    """Two equal drives with an authors' hull and constant play, the hard cases of physics.md eq. 25."""
    drive = Drive(pulley=PublishedHull(hull, 0.3), belt=Play(play_steps * printer.x.mm_per_step))
    return MechanismModel(Corruption((drive, drive)).lower(printer))


@pytest.mark.parametrize(("hull", "play"), [("egg", 0.0), ("egg", 2.5), ("egg", 5.0), ("line", 5.0), ("small", 10.0)])
@pytest.mark.parametrize("c_max", [1, 3])
def test_optimal_is_the_optimum(hull: str, play: float, c_max: int, ender5: Printer) -> None:
    """Zigzags of a few steps: the exhaustive search follows every reachable state."""
    zigzag = layer_along(np.array([[530, 530], [538, 533], [529, 529], [533, 531]]))
    targets, start = zigzag.nominal_steps[1:].astype(float), zigzag.start_steps
    model = worn(hull, play, ender5)
    tables = lattice_tables(model.mechanism, start)  # type: ignore[arg-type]
    least = sum(
        naive_control.least_cost_axis(
            targets[:, a], motor.origin_steps, motor.start, motor.lower_steps, motor.upper_steps, c_max,
        )
        for a, motor in enumerate(tables.motors)
    )  # fmt: skip
    plan = controller("optimal").plan(model, targets, start, c_max=c_max)
    assert ((plan.imagined_steps[1:] - targets) ** 2).sum() == pytest.approx(least, abs=1e-9)


@pytest.mark.parametrize("family", ["pulley-play", "frame", "everything"])
def test_a_wide_search_is_the_optimum_of_coupled_axes(family: str, printer: Printer) -> None:
    model = MechanismModel(sample(family, np.random.default_rng(4), "realistic").lower(printer))
    targets, start = np.array([[531, 530], [532, 531], [531, 531], [530, 530]], float), np.array([530, 530])
    least = naive_control.least_cost(model, targets, start, 1)
    everything = coupled.Breadth(slack=0.6, most=0.6, width=500)
    plan = coupled.plan_coupled(model, model.tabulate(start), targets, start, 1, everything)  # type: ignore[arg-type]
    assert ((plan.imagined_steps[1:] - targets) ** 2).sum() == pytest.approx(least, abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("family", ["pulley-play", "pulley-loose", "play", "set-screw"])
def test_optimal_is_the_optimum_of_a_corexy(family: str, seed: int) -> None:
    """Sixty targets, about a corner, against every state that could be better."""
    model = MechanismModel(sample(family, np.random.default_rng(100 + seed)).lower(read_printer("corexy")))
    at = 37 + 271 * seed
    targets, start = TARGETS[at : at + 60], LAYER.nominal_steps[at]
    plan = controller("optimal").plan(model, targets, start)
    cost = float(((plan.imagined_steps[1:] - targets) ** 2).sum())
    least = naive_control.least_cost_corexy(targets, start, model.tabulate(start), cost)  # type: ignore[arg-type]
    assert cost == pytest.approx(least, abs=1e-9)


@pytest.mark.parametrize(("play", "reach"), [(0.0, 3), (5.0, 2), (9.0, 6), (14.0, 1)])
def test_costs_of_arriving_are_the_slow_costs(
    play: float, reach: int, ender5: Printer, rng: np.random.Generator
) -> None:
    model = worn("egg", play, ender5)
    tables = lattice_tables(model.mechanism, START)  # type: ignore[arg-type]
    targets = TARGETS[:30, 0] + rng.uniform(-2.0, 2.0, 30)
    belt = controller("lookahead").plan(model, TARGETS[:30], START).imagined_steps[:, 0]
    states = window(tables.motors[0], targets, belt, reach)
    weight, price = rng.uniform(0.5, 1.0, 30), rng.normal(size=(30, 2))
    out = np.full((31, int((states.right - states.left).max()), states.longest), np.nan)
    kernels.arrivals(
        targets, weight, price, states.places, states.first, states.last, states.low, states.high,
        states.left, states.right, reach, out,
    )  # fmt: skip
    for t, costs in enumerate(naive_control.arrival_costs(targets, weight, price, states, reach)):
        for (k, m), cost in costs.items():
            assert out[t, k - states.left[t], m - states.first[k]] == pytest.approx(cost, abs=1e-9)


@pytest.mark.parametrize(
    ("hull", "play", "tie_break", "best"),
    [("egg", 5.0, 0.55, 0.50), ("line", 5.0, 0.60, 0.40), ("small", 10.0, 1.30, 0.40)],
)
def test_deadlock_is_cured(hull: str, play: float, tie_break: float, best: float, ender5: Printer) -> None:
    """Physics.md §6: greedy 110–190 steps, with the tie-break about .5, with dynamic programming less."""
    model = worn(hull, play, ender5)
    greedy, lookahead, optimum = (
        controller(name).plan(model, TARGETS, START) for name in ("greedy", "lookahead", "optimal")
    )
    assert rmse(greedy) > 50
    assert rmse(lookahead) < tie_break
    assert rmse(optimum) < min(best, rmse(lookahead))


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("family", ["pulley-loose", "set-screw", "everything", "pulley"])
def test_planning_ahead_is_never_worse(family: str, seed: int, printer: Printer) -> None:
    model = MechanismModel(sample(family, np.random.default_rng(seed)).lower(printer))
    targets = TARGETS[200 * seed : 200 * seed + 150]
    start = LAYER.nominal_steps[200 * seed]
    errors = {name: rmse(controller(name).plan(model, targets, start), targets) for name in
              ("greedy", "lookahead", "optimal")}  # fmt: skip
    assert errors["optimal"] <= min(errors["greedy"], errors["lookahead"]) + 1e-9


def test_without_play_one_step_greedy_is_optimal(ender5: Printer) -> None:
    """Physics.md §6: without hysteresis nothing is gained by planning ahead."""
    model = MechanismModel(sample("ellipse", np.random.default_rng(2)).lower(ender5))
    assert rmse(controller("optimal").plan(model, TARGETS, START)) == pytest.approx(
        rmse(controller("greedy").plan(model, TARGETS, START)), abs=1e-9
    )


def test_the_lattice_leaves_the_error_of_its_steps(ender5: Printer) -> None:
    """Physics.md eq. 23: targets at every place between two of the lattice, on pulleys whose steps differ."""
    model, ends = worn("egg", 0.0, ender5), np.array([[300.0, 320.0], [700.0, 730.0]])
    targets = ends[0] + np.linspace(0, 1, 8001)[:, None] * (ends[1] - ends[0])
    tables = lattice_tables(model.mechanism, ends[0].astype(int))  # type: ignore[arg-type]
    squares = []
    for motor, (low, high) in zip(tables.motors, ends.T, strict=True):
        at = motor.lower_steps[(motor.lower_steps > low) & (motor.lower_steps < high)]
        gains = np.diff(at)
        squares.append((gains**3).sum() / (12 * gains.sum()))
    found = rmse(controller("optimal").plan(model, targets, ends[0].astype(int)), targets)
    assert found == pytest.approx(np.sqrt(sum(squares)), rel=0.01)
    assert found > 1.02 * np.sqrt(2 / 12)  # steps that differ leave more than equal ones


@pytest.mark.parametrize("preset", ["ender5", "corexy"])
def test_long_layers_in_blocks_are_planned_alike(preset: str, monkeypatch: pytest.MonkeyPatch) -> None:
    model = worn("egg", 5.0, read_printer(preset))
    whole = controller("optimal").plan(model, TARGETS, START)
    monkeypatch.setattr(optimal, "_COSTS_KEPT", 1)
    monkeypatch.setattr(coupled, "_BLOCK_TICKS", 50)
    blocks = controller("optimal").plan(model, TARGETS, START)
    assert rmse(blocks) == pytest.approx(rmse(whole), abs=1e-9)


@pytest.mark.parametrize("name", ["lookahead", "optimal"])
def test_targets_that_run_away(name: str, ender5: Printer) -> None:
    """Where one control cannot keep up the plan lags, but stays finite and no worse than greedy."""
    model = worn("small", 5.0, ender5)
    way = np.concatenate([np.linspace(500, 800, 120), np.linspace(800, 480, 60)])
    targets = np.stack([way, way], axis=1)
    start = np.array([500, 500])
    plan = controller(name).plan(model, targets, start, c_max=2)
    np.testing.assert_array_equal(plan.imagined_steps, Twin(model.mechanism).run(plan.controls, start))
    assert rmse(plan, targets) <= rmse(controller("greedy").plan(model, targets, start, c_max=2), targets)


def test_a_plan_whose_belts_no_branch_explains_ends_before_the_kernels(ender5: Printer) -> None:
    """They hold the law of the play as indices, and check none: another law would lead them beyond their arrays."""
    motor = lattice_tables(worn("egg", 5.0, ender5).mechanism, START).motors[0]  # type: ignore[arg-type]
    belt = run_motors((motor,), np.tile([[1], [-1]], (20, 1)))[:, 0]
    window(motor, TARGETS[:40, 0], belt, 3)
    belt[20] += 1e-3
    with pytest.raises(RuntimeError, match="no branch of its play"):
        window(motor, TARGETS[:40, 0], belt, 3)


@pytest.mark.parametrize("wrong", ["falls", "crosses"])
@pytest.mark.parametrize("name", ["greedy", "lookahead", "optimal", "optimal-area"])
def test_tables_of_no_play_are_refused(name: str, wrong: str, ender5: Printer) -> None:
    """Kernels trust the branches that a model of another package gives: they must rise, lower ≤ upper."""

    class Wrong(MechanismModel):
        def tabulate(self, start_steps: np.ndarray, *, c_max: int = 3) -> PlayTables:
            tables = super().tabulate(start_steps, c_max=c_max)
            motor = tables.motors[0]
            lower = motor.lower_steps.copy()
            lower[300] += -50.0 if wrong == "falls" else 0.0
            upper = motor.upper_steps - (60.0 if wrong == "crosses" else 0.0)
            return replace(tables, motors=(replace(motor, lower_steps=lower, upper_steps=upper), tables.motors[1]))

    with pytest.raises(ModelError, match="never fall"):
        controller(name).plan(Wrong(worn("egg", 5.0, ender5).mechanism), TARGETS[:20], START)
