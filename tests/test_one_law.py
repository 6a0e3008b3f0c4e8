"""What is imagined is what is printed, to the last bit: planners, world models, the environment and the twin."""

from dataclasses import replace

import numpy as np
import pytest

from printmend.corruption.frame import Screw
from printmend.learn.mechanism_model import MechanismModel
from printmend.machine import Mechanism
from printmend.machine.kernels import run
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend_lab.control.registry import controller
from printmend_lab.control.space import plan_space
from printmend_lab.env import kernels
from printmend_lab.env.fleet import fleet_of, machines_of, tasks_of
from printmend_lab.path import Layer
from printmend_lab.protocols import SpaceModel
from printmend_lab.sampling import families, sample

SCREW = Screw(0.03, 0.1, 1.0, 0.3, 2.0, 0.3)
START = np.array([531, 467, 60])
PATH = np.cumsum(np.random.default_rng(3).integers(-1, 2, (40, 3)), axis=0) + START
FAMILIES = [name for name in families() if name != "gain-table"]


@pytest.mark.parametrize("preset", ["ender5", "corexy"])
@pytest.mark.parametrize("family", FAMILIES)
def test_what_is_imagined_is_printed_bit_for_bit(family: str, preset: str) -> None:
    mechanism = replace(sample(family, np.random.default_rng(8)), screw=SCREW).lower(read_printer(preset))
    assert isinstance(mechanism, Mechanism)
    twin, model = Twin(mechanism), MechanismModel(mechanism)
    for name in ("greedy", "lookahead", "optimal"):
        plan = plan_space(controller(name), SpaceModel(model, mechanism.screw), PATH, START)
        printed = twin.run(plan.controls, START)
        assert np.array_equal(plan.imagined_steps, printed), name
    controls = plan.controls[:, :2].astype(np.int64)
    planar = twin.run(controls, START[:2])
    assert np.array_equal(_advanced(model, controls), planar)
    assert np.array_equal(_in_the_environment(mechanism, controls), planar)


def _advanced(model: MechanismModel, controls: np.ndarray) -> np.ndarray:
    state = model.start(START[:2])
    states = [state, *(state := model.advance(state, control[None]) for control in controls)]
    return np.concatenate([each.position_steps for each in states])


def _in_the_environment(mechanism: Mechanism, controls: np.ndarray) -> np.ndarray:
    task = Layer(0, 0.2, START[:2], np.sign(controls), np.ones(len(controls), bool))
    machines, tasks, fleet = machines_of([mechanism], mechanism.printer), tasks_of([task]), fleet_of(1)
    kernels.restart(np.array([0]), machines, tasks, fleet)
    printed, reward, done = np.empty((len(controls) + 1, 2)), np.empty(1), np.empty(1, bool)
    for t in range(len(printed)):
        run.printed_each(fleet.beds[0], fleet.position, printed[t : t + 1])
        if t < len(controls):
            kernels.advance(controls[t : t + 1], np.zeros(1, bool), machines, tasks, fleet, True, reward, done)
    return printed
