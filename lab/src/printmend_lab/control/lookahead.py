"""Greedy with ties broken for the next move: the cure of Algorithm 1's deadlock (physics.md eq. 25)."""

from dataclasses import dataclass

import numpy as np

from printmend.machine import LatticeMotor, PlayTables
from printmend.protocols import WorldModel
from printmend_lab.control.check import check_plan, tables_of
from printmend_lab.control.greedy import Greedy
from printmend_lab.control.kernels import lookahead as kernels
from printmend_lab.path import Plan


@dataclass(frozen=True)
class Lookahead:
    """As `Greedy`, but where several controls leave the carriage equally near, take up the play for the next move.

    Costs no more than `Greedy` and cannot deadlock. Models without play have nothing to take up: for them it is
    `Greedy`.
    """

    name: str = "lookahead"

    def plan(self, model: WorldModel, targets_steps: np.ndarray, start_steps: np.ndarray, *, c_max: int = 3) -> Plan:
        """Choose controls [T, 2] for targets [T, 2] from ``start_steps`` [2]. Raise `InputError` off the bed."""
        targets, start = check_plan(model.printer, targets_steps, start_steps, c_max)
        tables = tables_of(model, start, c_max)
        if not isinstance(tables, PlayTables):
            return Greedy().plan(model, targets, start, c_max=c_max)
        seen = tables.bed.wanted(targets)
        following = np.empty((2, len(targets)), np.int64)
        for each, wanted in zip(following, np.ascontiguousarray(seen.T), strict=True):
            kernels.next_different(wanted, each)
        if tables.is_coupled:
            controls, imagined = np.empty((len(targets), 2), np.int8), np.empty((len(targets) + 1, 2))
            kernels.plan_both(targets, seen, following, tables.arrays, c_max, controls, imagined)
            return Plan(controls, imagined)
        plans = [plan_motor(*each, c_max) for each in zip(tables.motors, targets.T, following, strict=True)]
        controls, imagined = (np.stack(both, axis=1) for both in zip(*plans, strict=True))
        return Plan(controls, imagined)


def plan_motor(
    motor: LatticeMotor, targets: np.ndarray, following: np.ndarray, c_max: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the controls [T] and imagined positions [T + 1] of one motor for targets [T] along it."""
    controls, imagined = np.empty(len(targets), np.int8), np.empty(len(targets) + 1)
    targets = np.ascontiguousarray(targets)  # one layout, one compilation
    lower, upper = motor.lower_steps, motor.upper_steps
    kernels.plan_axis(
        targets, following, motor.start, motor.origin_steps, lower, upper, c_max, controls, imagined
    )  # fmt: skip
    return controls, imagined


CONTROLLERS = {"lookahead": Lookahead()}
