"""Algorithm 1 of the paper: for each target, the control whose imagined result is nearest (§IV-C, physics.md §8.1)."""

import itertools
from dataclasses import dataclass

import numpy as np

from printmend.machine import PlayTables
from printmend.protocols import IncrementTables, JointTables, WorldModel
from printmend_lab.control.check import advanced, agrees, check_plan, increments_by_advance, tables_of
from printmend_lab.control.kernels import greedy as kernels
from printmend_lab.path import Plan


@dataclass(frozen=True)
class Greedy:
    """The published planner, compiled for models that tabulate or could, and batched for the others.

    Deadlocks where the play exceeds what one control can take up: no control then changes the imagined position
    (physics.md eq. 25). Plans are equal to the published loop's, to the last tie.
    """

    name: str = "greedy"

    def plan(self, model: WorldModel, targets_steps: np.ndarray, start_steps: np.ndarray, *, c_max: int = 3) -> Plan:
        """Choose controls [T, 2] for targets [T, 2] from ``start_steps`` [2]. Raise `InputError` off the bed."""
        targets, start = check_plan(model.printer, targets_steps, start_steps, c_max)
        tables = tables_of(model, start, c_max)
        controls = np.empty((len(targets), 2), np.int8)
        imagined = np.empty((len(targets) + 1, 2))
        match tables:
            case IncrementTables():
                kernels.plan_increments(targets, start, *tables.displacement_steps, controls, imagined)
            case JointTables():
                kernels.plan_joint(
                    targets, start, *tables.cells, tables.unit_steps, tables.rolled, c_max, controls, imagined
                )
            case PlayTables():
                plan = kernels.plan_both if tables.is_coupled else kernels.plan_play
                plan(targets, tables.arrays, c_max, controls, imagined)
            case None:
                _plan_by_advance(model, targets, start, c_max, controls, imagined)
        return Plan(controls, imagined)


def _plan_by_advance(
    model: WorldModel, targets: np.ndarray, start: np.ndarray, c_max: int, controls: np.ndarray, imagined: np.ndarray
) -> None:
    """Plan with tables read off `advance`, where they are worth it and hold; otherwise one call of it a target."""
    asked = sum(steps + 1 for steps in model.printer.bed_steps)  # times the controls of an axis
    if len(targets) * (2 * c_max + 1) > asked and (tables := increments_by_advance(model, start, c_max=c_max)):
        kernels.plan_increments(targets, start, *tables.displacement_steps, controls, imagined)
        if agrees(model, start, controls, imagined):
            return
    _plan_batched(model, targets, start, c_max, controls, imagined)


def _plan_batched(
    model: WorldModel, targets: np.ndarray, start: np.ndarray, c_max: int, controls: np.ndarray, imagined: np.ndarray
) -> None:
    """Plan by advancing all controls of each target at once."""
    candidates = np.array(list(itertools.product(range(-c_max, c_max + 1), repeat=2)))
    state = model.start(start)
    imagined[0] = state.position_steps[0]
    for t, target in enumerate(targets):
        after = advanced(model, state, candidates)
        error = target - after.position_steps
        best = int(np.argmin(error[:, 0] * error[:, 0] + error[:, 1] * error[:, 1]))
        controls[t] = candidates[best]
        state = after[best]
        imagined[t + 1] = state.position_steps[0]


CONTROLLERS = {"greedy": Greedy()}
