"""Plans of three axes: the paper's "direct next step".

The screw is planned first: it does not feel the belts. Where it will push the nozzle is then known at every tick, and
the planar targets are moved against it; any controller plans those.
"""

from dataclasses import dataclass, field

import numpy as np

from printmend.errors import InputError
from printmend.machine import lattice_screw
from printmend_lab.control.kernels.lookahead import next_different
from printmend_lab.control.lookahead import plan_motor
from printmend_lab.control.optimal import always_nearest, solve
from printmend_lab.protocols import Controller, SpaceModel

C_MAX = 3  # steps of a motor in a tick, as in Algorithm 1


@dataclass(frozen=True, eq=False)
class SpacePlan:
    """``controls`` [T, 3] int8 steps and the ``imagined`` positions [T + 1, 3] steps, z in its own steps."""

    controls: np.ndarray
    imagined_steps: np.ndarray = field(repr=False)


def plan_space(planner: Controller, model: SpaceModel, targets_steps: np.ndarray, start_steps: np.ndarray) -> SpacePlan:
    """Choose controls [T, 3] for targets [T, 3] from ``start_steps`` [3].

    ``planner`` plans x and y; Z is planned as `Optimal` does, whoever plans the rest. Raise `InputError` for arrays of
    another shape, or off the machine.
    """
    targets, start = np.asarray(targets_steps, float), np.asarray(start_steps, np.int64)
    if targets.ndim != 2 or targets.shape[1] != 3 or start.shape != (3,) or not np.isfinite(targets).all():
        raise InputError(
            "plan", wanted="finite targets [T, 3] and start [3]", came=f"{targets.shape} and {start.shape}",
            todo="reshape them",
        )  # fmt: skip
    z_controls, height, push = _plan_height(model, np.ascontiguousarray(targets[:, 2]), int(start[2]), C_MAX)
    plan = planner.plan(model.planar, targets[:, :2] - push[1:], start[:2], c_max=C_MAX)
    return SpacePlan(
        np.column_stack([plan.controls, z_controls]), np.column_stack([plan.imagined_steps + push, height])
    )


def _plan_height(
    model: SpaceModel, targets: np.ndarray, start: int, c_max: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the controls [T], the heights [T + 1] and the push [T + 1, 2] of a cheapest plan for Z alone."""
    ticks = len(targets)
    if model.screw is None:
        lattice = np.concatenate([[start], np.rint(targets).astype(np.int64)])
        controls = np.clip(np.diff(lattice), -c_max, c_max).astype(np.int8)
        height = start + np.concatenate([[0.0], np.cumsum(controls, dtype=np.int64)])
        return controls, height, np.zeros((ticks + 1, 2))
    screw = lattice_screw(model.screw, model.printer, start)
    following = np.empty(ticks, np.int64)
    next_different(targets, following)
    controls, height = plan_motor(screw.motor, targets, following, c_max)
    if ticks and not always_nearest(screw.motor, targets, height):
        controls, height = solve(screw.motor, targets, height, c_max)
    moved = screw.motor.start + np.concatenate([[0], np.cumsum(controls, dtype=np.int64)])
    return controls, height, screw.push_steps[moved]
