"""Algorithm 1, compiled, against the loop as published."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printmend.learn.mechanism_model import MechanismModel
from printmend.machine import Mechanism, PlayTables, healthy_transmission
from printmend.printer import Printer, read_printer
from printmend.protocols import IncrementTables, State, WorldModel
from printmend.twin import Twin
from printmend_lab.control.greedy import Greedy
from printmend_lab.published.increments import AxisModel, moved
from printmend_lab.sampling import families, sample
from tests import naive_control
from tests.shapes import ring_layer

LAYER = ring_layer((530.0, 530.0), 60.0)
START = LAYER.start_steps


def assert_same_plan(model: WorldModel, targets: np.ndarray, start: np.ndarray, c_max: int = 3) -> None:
    fast, slow = Greedy().plan(model, targets, start, c_max=c_max), naive_control.greedy(model, targets, start, c_max)
    np.testing.assert_array_equal(fast.controls, slow.controls)
    # A frame is a polynomial: summed in another order it differs by roundings.
    tables = model.tabulate(start, c_max=c_max)
    crooked = isinstance(tables, PlayTables) and not tables.bed.is_straight
    np.testing.assert_allclose(fast.imagined_steps, slow.imagined_steps, rtol=0, atol=1e-9 if crooked else 0.0)


@pytest.mark.parametrize("family", families())
@pytest.mark.parametrize("preset", ["ender5", "corexy"])
def test_same_plan_for_every_family(family: str, preset: str, rng: np.random.Generator) -> None:
    model = MechanismModel(sample(family, rng).lower(read_printer(preset)))
    at = int(rng.integers(0, LAYER.transitions - 40))
    assert_same_plan(model, LAYER.nominal_steps[at + 1 : at + 41], LAYER.nominal_steps[at])


@pytest.mark.parametrize("c_max", [1, 2, 4])
def test_same_plan_for_any_c_max(printer: Printer, c_max: int, rng: np.random.Generator) -> None:
    model = MechanismModel(sample("pulley-play", rng).lower(printer))
    assert_same_plan(model, LAYER.nominal_steps[1:25], START, c_max)


class Toy:
    """Displacements drawn from a few dyadic values: full of exact ties."""

    def __init__(self, printer: Printer, tables: IncrementTables) -> None:
        self.printer, self.tables = printer, tables

    def start(self, start_steps: np.ndarray):
        return State.at(start_steps)

    def advance(self, state, controls):
        nominal = np.broadcast_to(state.nominal_steps, controls.shape)
        step = [self.tables.displacement_steps[a][nominal[:, a], controls[:, a] + 3] for a in range(2)]
        return moved(state, controls, np.stack(step, axis=1), self.printer)

    def tabulate(self, start_steps: np.ndarray, *, c_max: int = 3) -> IncrementTables:
        return self.tables


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([0.5, 0.1, 1 / 3]))
def test_ties_fall_as_published(seed: int, unit: float) -> None:
    """Equal sums of squares go to the first control of the product; sums that differ by a rounding are not equal."""
    rng, ender5 = np.random.default_rng(seed), read_printer("ender5")
    tables = IncrementTables(tuple(rng.integers(-2, 3, (bed + 1, 7)) * unit for bed in ender5.bed_steps), 3)
    targets = 530 + rng.integers(-8, 9, (12, 2)) * unit
    assert_same_plan(Toy(ender5, tables), targets, np.array([530, 530]))


def test_imagined_is_not_clipped_to_the_bed_but_nominal_is(ender5: Printer) -> None:
    """Physics.md §8.1: at the edge the nominal position stays, the imagined one goes on."""
    model, start = AxisModel(ender5, (np.linspace(0.4, 0.6, 1101), np.full(1101, 0.5))), np.array([1098, 1098])
    targets = np.full((6, 2), 1110.0)
    plan = Greedy().plan(model, targets, start)
    assert_same_plan(model, targets, start)
    np.testing.assert_allclose(plan.imagined_steps[-1], [1098 + 3 * model.gains[0][1098] + 5 * 3 * 0.6, 1107])


def test_stays_inside_the_motor_tables(ender5: Printer) -> None:
    """A motor that would leave its tables is not commanded to."""
    healthy = healthy_transmission(ender5, 0)
    dead = type(healthy)(healthy.first_mm, healthy.pitch_mm, healthy.lower_mm * 0 + 5.0, healthy.upper_mm * 0 + 5.0)
    model = MechanismModel(Mechanism(ender5, (dead, healthy_transmission(ender5, 1))))
    plan = Greedy().plan(model, np.full((2000, 2), 900.0), np.array([500, 500]))
    assert np.isfinite(plan.imagined_steps).all()


def test_deadlocks_with_play_beyond_one_control(ender5: Printer) -> None:
    """Physics.md §6: with perfect knowledge, play of five steps stops Algorithm 1 where it first reverses."""
    from printmend.corruption import Corruption, Drive, Play

    twin = Twin.of(Corruption((Drive(belt=Play(1.0)), Drive(belt=Play(1.0)))), ender5)
    targets = LAYER.nominal_steps
    plan = Greedy().plan(MechanismModel(twin.mechanism), targets[1:], START)
    error = np.sqrt(((twin.run(plan.controls, START) - targets) ** 2).sum(axis=1).mean())
    assert error > 20
