"""Planning on nothing but `advance`: tables read off it, and a beam for what remembers."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from printmend.errors import ModelError
from printmend.learn.mechanism_model import MechanismModel
from printmend.metrics import rmse
from printmend.printer import Printer
from printmend.protocols import State
from printmend_lab.conformance.learners import LearnerCandidate, is_planned_for
from printmend_lab.control.beam import Beam
from printmend_lab.control.check import agrees, increments_by_advance
from printmend_lab.control.greedy import Greedy
from printmend_lab.control.optimal import Optimal
from printmend_lab.env import random_layer
from printmend_lab.env.fleet import draw_scene
from printmend_lab.path import Layer
from printmend_lab.sampling import sample


@dataclass(frozen=True, eq=False)
class Untold(MechanismModel):
    """A machine of which only `advance` is known; ``asked`` counts the states that it is asked for."""

    asked: tuple[list[int]] = ([0],)

    def advance(self, state: State, controls: np.ndarray) -> State:
        self.asked[0][0] += len(controls)
        return super().advance(state, controls)

    def tabulate(self, start_steps: np.ndarray, *, c_max: int = 3) -> None:
        return None


@dataclass(frozen=True, eq=False)
class Coupled(Untold):
    """One whose x goes farther where y is high: no table of an axis says so."""

    def advance(self, state: State, controls: np.ndarray) -> State:
        after = super().advance(state, controls)
        more = 1e-3 * np.broadcast_to(state.nominal_steps, controls.shape)[:, 1] * controls[:, 0]
        return replace(after, position_steps=after.position_steps + np.column_stack([more, np.zeros(len(more))]))


def layer_of(rng: np.random.Generator, printer: Printer, ticks: int = 400) -> Layer:
    return random_layer(rng, printer, ticks)


@pytest.mark.parametrize("c_max", [1, 3])
def test_a_model_without_memory_is_planned_on_the_tables_it_could_have_given(
    c_max: int, ender5: Printer, rng: np.random.Generator
) -> None:
    mechanism = sample("gain-table", rng).lower(ender5)
    told, untold, layer = MechanismModel(mechanism), Untold(mechanism, ([0],)), layer_of(rng, ender5, 2500)
    tables = increments_by_advance(untold, layer.start_steps, c_max=c_max)
    for mine, wanted in zip(
        tables.displacement_steps, told.tabulate(layer.start_steps, c_max=c_max).displacement_steps, strict=True
    ):
        np.testing.assert_allclose(mine, wanted, rtol=0, atol=1e-10)
    untold.asked[0][0] = 0
    plan = Greedy().plan(untold, layer.nominal_steps[1:], layer.start_steps, c_max=c_max)
    wanted = Greedy().plan(told, layer.nominal_steps[1:], layer.start_steps, c_max=c_max)
    np.testing.assert_array_equal(plan.controls, wanted.controls)
    np.testing.assert_allclose(plan.imagined_steps, wanted.imagined_steps, rtol=0, atol=1e-9)
    # The tables and one look at the plan, not all controls at every target.
    assert untold.asked[0][0] == 2 * 1101 * (2 * c_max + 1) + 2500 < 2500 * (2 * c_max + 1) ** 2


def test_tables_that_do_not_hold_are_not_planned_on(ender5: Printer, rng: np.random.Generator) -> None:
    mechanism, layer = sample("gain-table", rng).lower(ender5), layer_of(rng, ender5, 700)
    targets, start = layer.nominal_steps[1:], layer.start_steps
    model = Coupled(mechanism, ([0],))
    tables = increments_by_advance(model, start)
    assert tables is not None  # at the start's own y nothing shows of it
    plan = Greedy().plan(model, targets, start)
    assert agrees(model, start, plan.controls, plan.imagined_steps)
    state = model.start(start)
    for t, control in enumerate(plan.controls):
        np.testing.assert_allclose(plan.imagined_steps[t], state.position_steps[0], rtol=0, atol=1e-9)
        state = model.advance(state, control[None].astype(int))
    assert not agrees(Untold(mechanism, ([0],)), start, plan.controls, plan.imagined_steps)
    assert increments_by_advance(Untold(sample("play", rng).lower(ender5), ([0],)), start) is None  # it remembers


def test_the_beam_crosses_play_that_greedy_stands_still_in(ender5: Printer) -> None:
    scene = draw_scene(np.random.default_rng(3), ender5, "play", "damaged", 150)
    model, wanted, start = Untold(scene.mechanism, ([0],)), scene.layer.nominal_steps, scene.layer.start_steps
    plan = Beam().plan(model, wanted[1:], start)
    assert rmse(wanted, plan.imagined_steps) <= 1.02 * scene.optimum_steps
    assert rmse(wanted, Greedy().plan(model, wanted[1:], start).imagined_steps) > scene.naive_steps


def test_optimal_says_to_whom_it_left_a_model(ender5: Printer, rng: np.random.Generator) -> None:
    scene = draw_scene(np.random.default_rng(3), ender5, "play", "damaged", 60)
    layer, loose, gains = scene.layer, scene.mechanism, sample("gain-table", rng).lower(ender5)
    for model, planner in (
        (MechanismModel(loose), ""),
        (MechanismModel(gains), "greedy"),
        (Untold(gains, ([0],)), "greedy"),
        (Untold(loose, ([0],)), "beam"),
    ):
        plan = Optimal().plan(model, layer.nominal_steps[1:], layer.start_steps)
        assert plan.planner == planner
    said = is_planned_for(LearnerCandidate("naive"), "pulley-play")
    assert "`greedy`" in said
    assert "know nothing of play" in said
    assert "on its tables of play" in is_planned_for(LearnerCandidate("greybox"), "pulley-play")


def test_positions_that_are_none_are_refused(ender5: Printer, rng: np.random.Generator) -> None:
    @dataclass(frozen=True, eq=False)
    class Lost(Untold):
        def advance(self, state: State, controls: np.ndarray) -> State:
            after = super().advance(state, controls)
            return replace(after, position_steps=after.position_steps * np.nan)

    layer = layer_of(rng, ender5, 20)
    with pytest.raises(ModelError, match="finite positions"):
        Beam().plan(Lost(sample("play", rng).lower(ender5), ([0],)), layer.nominal_steps[1:], layer.start_steps)
