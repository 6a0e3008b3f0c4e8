"""The cheapest plan there is on a model with play, by dynamic programming an axis (physics.md eq. 25, cure 2)."""

from dataclasses import dataclass, replace

import numpy as np

from printmend.machine import LatticeMotor, PlayTables, run_motors
from printmend.protocols import Tables, WorldModel
from printmend_lab.control.beam import Beam
from printmend_lab.control.check import check_plan, increments_by_advance, tables_of
from printmend_lab.control.coupled import Breadth, better, plan_coupled, window
from printmend_lab.control.greedy import Greedy
from printmend_lab.control.kernels import optimal as kernels
from printmend_lab.control.lookahead import Lookahead
from printmend_lab.path import Plan

# Costs kept at a time: about a megabyte, which stays in the processor's cache, whatever the layer's length.
_COSTS_KEPT = 1 << 17
_FIRST_TARGETS = 500  # that are looked at before all are
# States of two coupled motors that are followed together. Where exhaustive searches were made, more changed nothing.
_BREADTH = Breadth(slack=0.3, most=1.2, width=128)


@dataclass(frozen=True)
class Optimal:
    """The least RMSE that any plan can reach on the model, within a window about `Lookahead`'s plan.

    Each axis of a cartesian machine is solved exactly: the states are the motor's index and the places where the play
    can have left the carriage. A CoreXY or a crooked frame couples the axes: both are solved together, guided by what
    each alone would still cost; states that are too far behind to catch up are left out. Never worse than `Greedy` and
    `Lookahead` on the model. Models without tables of play are left to `Greedy`, those without any that remember to
    `Beam`; the plan's ``planner`` says so. With the true model it is the bound of every table, `optimum`.
    """

    name: str = "optimal"

    def plan(self, model: WorldModel, targets_steps: np.ndarray, start_steps: np.ndarray, *, c_max: int = 3) -> Plan:
        """Choose controls [T, 2] for targets [T, 2] from ``start_steps`` [2]. Raise `InputError` off the bed."""
        targets, start = check_plan(model.printer, targets_steps, start_steps, c_max)
        tables = tables_of(model, start, c_max)
        if len(targets) == 0:
            return Greedy().plan(model, targets, start, c_max=c_max)
        if not isinstance(tables, PlayTables):
            return _plan_without_play(model, tables, targets, start, c_max)
        if tables.is_coupled:
            return plan_coupled(model, tables, targets, start, c_max, _BREADTH)
        greedy = Greedy().plan(model, targets, start, c_max=c_max)
        known = better(greedy, Lookahead().plan(model, targets, start, c_max=c_max), targets)
        controls, imagined = known.controls.copy(), known.imagined_steps.copy()
        for axis, motor in enumerate(tables.motors):
            wanted, belt = targets[:, axis], known.imagined_steps[:, axis]
            if not always_nearest(motor, wanted, belt):
                controls[:, axis], imagined[:, axis] = solve(motor, wanted, belt, c_max)
        return Plan(controls, imagined)


def _plan_without_play(
    model: WorldModel, tables: Tables | None, targets: np.ndarray, start: np.ndarray, c_max: int
) -> Plan:
    """Leave a model to `Greedy`, and one that remembers, or couples its axes, and has no tables to `Beam`, too.

    The plan says which it was.
    """
    greedy = replace(Greedy().plan(model, targets, start, c_max=c_max), planner="greedy")
    if tables is not None or increments_by_advance(model, start, c_max=c_max) is not None:
        return greedy
    return better(greedy, replace(Beam().plan(model, targets, start, c_max=c_max), planner="beam"), targets)


def always_nearest(motor: LatticeMotor, targets: np.ndarray, belt: np.ndarray) -> bool:
    """Say whether a plan's belt [T + 1] is, at every tick, at a place nearest to its target: then no plan is better."""
    for part in (targets[:_FIRST_TARGETS], targets):  # with play the answer is no, soon
        least = np.abs(belt[0] - part)
        for branch in (motor.lower_steps, motor.upper_steps):
            at = np.clip(np.searchsorted(branch, part), 1, len(branch) - 1)
            np.minimum(least, np.minimum(np.abs(branch[at] - part), np.abs(branch[at - 1] - part)), out=least)
        if (np.abs(belt[1 : len(part) + 1] - part) > least).any():
            return False
    return True


def solve(motor: LatticeMotor, targets: np.ndarray, known: np.ndarray, c_max: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the controls [T] and positions [T + 1] of a cheapest plan for one motor and targets [T] along it.

    ``known`` [T + 1] are the positions of a plan that can be carried out; the search stays within a window about them
    and the targets, so its plan is never worse.
    """
    states = window(motor, targets, known, c_max)
    index = np.empty(len(targets) + 1, np.int64)
    targets = np.ascontiguousarray(targets)  # one layout, one compilation
    kernels.search(
        targets, states.start, motor.start - states.offset, states.places, states.first, states.last, states.low,
        states.high, states.left, states.right, c_max, _COSTS_KEPT, index,
    )  # fmt: skip
    moves = np.diff(index)
    return moves.astype(np.int8), run_motors((motor,), moves[:, None])[:, 0]


CONTROLLERS = {"optimal": Optimal()}
