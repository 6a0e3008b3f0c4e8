"""Where a belt rests in its play at a layer's start: learned from one layer, used when others are planned."""

from dataclasses import replace

import numpy as np
import pytest

from printmend.learn.mechanism_model import MechanismModel
from printmend.machine import PlayTables
from printmend.metrics import rmse
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend_lab.bench.case import drawn_body
from printmend_lab.control.registry import controller
from printmend_lab.greybox import Greybox
from printmend_lab.published import layer_trace
from printmend_lab.sampling import sample

ENDER5 = read_printer("ender5")
MIDDLE, FORWARDS, BACK = (0.5, 0.5), (0.0, 0.0), (1.0, 1.0)


def resting(family: str, rest: tuple[float, float], seed: int) -> Twin:
    mechanism = sample(family, np.random.default_rng(seed)).lower(ENDER5)
    return Twin(replace(mechanism, rest_share=rest))


def noisy(twin: Twin, layer, noise_mm: float, seed: int) -> Trace:
    trace = layer_trace(layer, twin.run(layer.controls, layer.start_steps), ENDER5)
    noise = np.random.default_rng(seed).normal(0.0, noise_mm, trace.measured_mm.shape)
    return replace(trace, measured_mm=trace.measured_mm + noise)


def learned(trace: Trace):
    return Greybox().fit(trace, ENDER5, rng=np.random.default_rng(0))


@pytest.mark.parametrize(
    ("rest", "noise_mm"), [(MIDDLE, 0.05), (FORWARDS, 0.05), (BACK, 0.0), ((0.0, 1.0), 0.0), ((0.0, 1.0), 0.05)]
)
def test_the_first_layer_tells_where_the_belts_rest_and_others_are_planned_from_there(rest, noise_mm):
    twin = resting("pulley-loose", rest, seed=5)
    first, second, _ = drawn_body(np.random.default_rng(8), ENDER5, size_mm=60.0).layers
    model = learned(noisy(twin, first, noise_mm, seed=3))

    assert model.mechanism.rest_share == rest
    targets = second.nominal_steps[1:]
    errors = []
    for one in (model, MechanismModel(twin.mechanism)):
        plan = controller("optimal").plan(one, targets, second.start_steps)
        errors.append(rmse(second.nominal_steps, twin.run(plan.controls, second.start_steps)))
    assert errors[0] <= 1.05 * errors[1]


def test_a_layer_begins_at_its_start_wherever_the_belts_rest():
    for rest in (MIDDLE, FORWARDS, BACK, (0.3, 0.8)):
        tables = MechanismModel(resting("pulley-play", rest, seed=2).mechanism).tabulate(np.array([500, 600]))
        assert isinstance(tables, PlayTables)
        for motor, start in enumerate((500, 600)):
            each = tables.motors[motor]
            lower, upper = each.lower_steps[each.start], each.upper_steps[each.start]
            assert lower + rest[motor] * (upper - lower) == pytest.approx(start, abs=1e-9)


@pytest.mark.parametrize(("family", "seed"), [("pulley", 0), ("play", 1), ("smooth", 1), ("frame", 1)])
def test_belts_rest_in_the_middle_unless_the_trace_says_otherwise(family, seed):
    twin = resting(family, MIDDLE, seed=4)
    layer = drawn_body(np.random.default_rng(seed), ENDER5, size_mm=40.0).layers[0]
    assert learned(noisy(twin, layer, 0.1, seed=seed)).mechanism.rest_share == MIDDLE


def test_homing_says_nothing_of_layers():
    layer = drawn_body(np.random.default_rng(1), ENDER5, size_mm=50.0).layers[0]
    trace = noisy(resting("play", FORWARDS, seed=4), layer, 0.02, seed=1)
    assert learned(trace).mechanism.rest_share == FORWARDS
    assert learned(replace(trace, homed=True)).mechanism.rest_share == MIDDLE
