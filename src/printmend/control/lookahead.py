"""Greedy with ties broken for the next move: the cure of Algorithm 1's deadlock (physics.md eq. 25)."""

from dataclasses import dataclass

import numpy as np

from printmend.control.check import check_plan, tables_of
from printmend.control.greedy import Greedy, first_motors, frame_arrays
from printmend.control.kernels import lookahead as kernels
from printmend.path import Plan
from printmend.protocols import PlayTables, WorldModel


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
        controls = np.empty((len(targets), 2), np.int8)
        imagined = np.empty((len(targets) + 1, 2))
        motors = first_motors(model.printer, tables, start)
        seen = targets if tables.frame is None else tables.frame.invert(targets)
        seen = model.printer.to_motor(seen)
        following = np.empty((2, len(targets)), np.int64)
        for motor in range(2):
            kernels.next_different(seen[:, motor], following[motor])
        if tables.corexy or tables.frame is not None:
            (lower_a, lower_b), (upper_a, upper_b) = tables.lower_steps, tables.upper_steps
            kernels.plan_coupled(
                targets, seen, following[0], following[1], start, *motors, lower_a, upper_a, lower_b, upper_b, c_max,
                tables.corexy, *frame_arrays(tables), controls, imagined,
            )  # fmt: skip
            return Plan(controls, imagined)
        for axis in range(2):
            kernels.plan_axis(
                targets[:, axis], following[axis], motors[axis], float(start[axis]),
                tables.lower_steps[axis], tables.upper_steps[axis], c_max, controls[:, axis], imagined[:, axis],
            )  # fmt: skip
        return Plan(controls, imagined)


CONTROLLERS = {"lookahead": Lookahead()}
