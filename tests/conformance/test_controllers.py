"""What every registered controller must keep, whatever tables the model has."""

import numpy as np
import pytest

from printmend.control.objective import Refined
from printmend.control.registry import controller, controller_names
from printmend.corruption import HEALTHY, sample
from printmend.errors import InputError
from printmend.learn.mechanism_model import MechanismModel
from printmend.learn.naive import NaiveModel
from printmend.learn.published.transitions import layer_trace
from printmend.learn.registry import fit
from printmend.printer import Printer, read_printer
from printmend.protocols import Controller, WorldModel
from printmend.twin import Twin
from tests.shapes import ring_layer

LAYER = ring_layer((530.0, 530.0), 25.0, turn=0.7, gap=9.0)
TARGETS, START = LAYER.nominal_steps[1:], LAYER.start_steps


@pytest.fixture(params=controller_names())
def planner(request: pytest.FixtureRequest) -> Controller:
    return controller(request.param)


@pytest.fixture(params=["play", "corexy", "increments", "joint"])
def model(request: pytest.FixtureRequest) -> WorldModel:
    """A faulty model of each kind of tables."""
    preset = "corexy" if request.param == "corexy" else "ender5"
    family = "gain-table" if request.param in ("increments", "joint") else "pulley-play"
    twin = Twin.of(sample(family, np.random.default_rng(3), "realistic"), read_printer(preset))
    trace = layer_trace(LAYER, twin.run(LAYER.controls, START), twin.printer)
    name = "lightgbm" if request.param == "joint" else "oracle"
    return fit(name, trace, twin.printer, rng=np.random.default_rng(0), truth=twin.mechanism)


def rmse(twin: Twin, controls: np.ndarray) -> float:
    return float(np.sqrt(((twin.run(controls, START)[1:] - TARGETS) ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("c_max", [1, 2, 3, 6])
def test_controls_stay_in_range_and_lead_where_imagined(planner: Controller, model: WorldModel, c_max: int) -> None:
    plan = planner.plan(model, TARGETS, START, c_max=c_max)
    assert plan.controls.shape == TARGETS.shape
    assert plan.controls.dtype == np.int8
    assert np.abs(plan.controls).max() <= c_max
    assert plan.imagined_steps.shape == (len(TARGETS) + 1, 2)
    state = model.start(START)
    for t, control in enumerate(plan.controls[:200]):
        np.testing.assert_allclose(plan.imagined_steps[t], state.position_steps[0], rtol=0, atol=1e-9)
        state = model.advance(state, control[None])


def test_is_repeatable(planner: Controller, model: WorldModel) -> None:
    first, second = (planner.plan(model, TARGETS, START) for _ in range(2))
    np.testing.assert_array_equal(first.controls, second.controls)
    np.testing.assert_array_equal(first.imagined_steps, second.imagined_steps)


def test_leaves_a_healthy_printer_alone(planner: Controller, printer: Printer) -> None:
    for healthy in (NaiveModel(printer), MechanismModel(HEALTHY.lower(printer))):
        plan = planner.plan(healthy, TARGETS, START)
        np.testing.assert_array_equal(plan.controls, LAYER.controls)
        np.testing.assert_array_equal(plan.imagined_steps, LAYER.nominal_steps)


@pytest.mark.parametrize("family", ["pulley", "published", "eccentric", "play", "pulley-play", "friction"])
def test_prints_what_it_imagines_and_better_than_naive(planner: Controller, printer: Printer, family: str) -> None:
    twin = Twin.of(sample(family, np.random.default_rng(11), "realistic"), printer)
    plan = planner.plan(MechanismModel(twin.mechanism), TARGETS, START)
    np.testing.assert_array_equal(plan.imagined_steps, twin.run(plan.controls, START))
    if not isinstance(planner, Refined):  # those give the RMSE away for what they are asked for
        assert rmse(twin, plan.controls) <= rmse(twin, LAYER.controls) + 1e-12


@pytest.mark.parametrize("family", ["frame", "everything"])
def test_crooked_frames(planner: Controller, printer: Printer, family: str) -> None:
    twin = Twin.of(sample(family, np.random.default_rng(12), "realistic"), printer)
    plan = planner.plan(MechanismModel(twin.mechanism), TARGETS[:300], START)
    np.testing.assert_allclose(plan.imagined_steps, twin.run(plan.controls, START), rtol=0, atol=1e-9)


def test_no_targets(planner: Controller, model: WorldModel) -> None:
    plan = planner.plan(model, np.empty((0, 2)), START)
    assert plan.controls.shape == (0, 2)
    assert plan.imagined_steps.tolist() == [START.tolist()]


@pytest.mark.parametrize(
    ("targets", "start", "c_max"),
    [
        (TARGETS, np.array([-1, 5]), 3),
        (TARGETS, np.array([0.5, 5]), 3),
        (TARGETS[:, :1], START, 3),
        (np.full((3, 2), np.nan), START, 3),
        (TARGETS, START, 0),
    ],
)
def test_bad_input_is_refused(
    planner: Controller, ender5: Printer, targets: np.ndarray, start: np.ndarray, c_max: int
) -> None:
    with pytest.raises(InputError, match="wanted"):
        planner.plan(NaiveModel(ender5), targets, start, c_max=c_max)
