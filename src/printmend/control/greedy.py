"""Algorithm 1 of the paper: for each target, the control whose imagined result is nearest (§IV-C, physics.md §8.1)."""

import itertools
from dataclasses import dataclass

import numpy as np

from printmend.control.check import check_plan, tables_of
from printmend.control.kernels import greedy as kernels
from printmend.errors import ModelError
from printmend.path import Plan
from printmend.printer import Printer
from printmend.protocols import IncrementTables, JointTables, PlayTables, WorldModel


@dataclass(frozen=True)
class Greedy:
    """The published planner, compiled for models that tabulate and batched for those that do not.

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
                _plan_play(model.printer, tables, targets, start, c_max, controls, imagined)
            case None:
                _plan_batched(model, targets, start, c_max, controls, imagined)
        return Plan(controls, imagined)


def first_motors(printer: Printer, tables: PlayTables, start: np.ndarray) -> tuple[int, int]:
    """Return the indices in the tables at which the motors stand at the layer's start."""
    first = printer.to_motor(start) - np.array(tables.first_steps)
    return int(first[0]), int(first[1])


def frame_arrays(tables: PlayTables) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the frame as the kernels take it; coefficients [2, 0] stand for a straight one."""
    frame = tables.frame
    if frame is None:
        return np.empty((2, 0)), np.zeros(2), np.ones(2)
    return frame.coefficients_steps, frame.origin_steps, frame.scale_steps


def _plan_play(
    printer: Printer,
    tables: PlayTables,
    targets: np.ndarray,
    start: np.ndarray,
    c_max: int,
    controls: np.ndarray,
    imagined: np.ndarray,
) -> None:
    (lower_a, lower_b), (upper_a, upper_b) = tables.lower_steps, tables.upper_steps
    machine = (*first_motors(printer, tables, start), lower_a, upper_a, lower_b, upper_b, c_max)
    if tables.frame is not None:
        frame = frame_arrays(tables)
        kernels.plan_framed(targets, start, *machine, tables.corexy, *frame, controls, imagined)
    elif tables.corexy:
        kernels.plan_corexy(targets, start, *machine, controls, imagined)
    else:
        kernels.plan_play(targets, start, *machine, controls, imagined)


def _plan_batched(
    model: WorldModel,
    targets: np.ndarray,
    start: np.ndarray,
    c_max: int,
    controls: np.ndarray,
    imagined: np.ndarray,
) -> None:
    """Plan by advancing all controls of each target at once."""
    candidates = np.array(list(itertools.product(range(-c_max, c_max + 1), repeat=2)))
    state = model.start(start)
    imagined[0] = state.position_steps[0]
    for t, target in enumerate(targets):
        after = model.advance(state, candidates)
        error = target - np.asarray(after.position_steps, float)
        if error.shape != candidates.shape or not np.isfinite(error).all():
            came = f"{error.shape}, nan or infinity among them" if error.shape == candidates.shape else f"{error.shape}"
            raise ModelError(
                "the model", wanted=f"finite positions {candidates.shape}", came=came, todo="correct its `advance`"
            )
        best = int(np.argmin(error[:, 0] * error[:, 0] + error[:, 1] * error[:, 1]))
        controls[t] = candidates[best]
        state = after[best]
        imagined[t + 1] = state.position_steps[0]


CONTROLLERS = {"greedy": Greedy()}
