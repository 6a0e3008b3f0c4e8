"""The cheapest plan there is on a model with play, by dynamic programming an axis (physics.md §6, cure 2)."""

from dataclasses import dataclass

import numpy as np

from printmend.control.beam import Beam
from printmend.control.check import check_plan
from printmend.control.greedy import Greedy, first_motors
from printmend.control.kernels import optimal as kernels
from printmend.control.lookahead import Lookahead
from printmend.control.window import better, followed, window
from printmend.path import Plan
from printmend.protocols import LatticeFrame, PlayTables, WorldModel

# Costs kept at a time: about a megabyte, which stays in the processor's cache, whatever the layer's length.
_ROOM = 1 << 17
# Passes over the two axes of a crooked frame, each with the other's plan known.
_PASSES = 3


@dataclass(frozen=True)
class Optimal:
    """The least RMSE that any plan can reach on the model, within a window about `Lookahead`'s plan.

    Each axis of a cartesian machine is solved exactly: the states are the motor's index and the places where the play
    can have left the carriage. A crooked frame couples the axes: they are solved in turn, each with the other's plan
    known. A CoreXY couples them through and through: there it is `Beam`. Never worse than `Greedy` and `Lookahead` on
    the model; models without memory are left to `Greedy`. With the true model it is the bound of every table,
    `optimum`.
    """

    name: str = "optimal"

    def plan(self, model: WorldModel, targets_steps: np.ndarray, start_steps: np.ndarray, *, c_max: int = 3) -> Plan:
        """Choose controls [T, 2] for targets [T, 2] from ``start_steps`` [2]. Raise `InputError` off the bed."""
        targets, start = check_plan(model.printer, targets_steps, start_steps, c_max)
        greedy = Greedy().plan(model, targets, start, c_max=c_max)
        tables = model.tabulate(start, c_max=c_max)
        if not isinstance(tables, PlayTables) or len(targets) == 0:
            return greedy
        if tables.corexy:
            return Beam().plan(model, targets, start, c_max=c_max)
        known = better(greedy, Lookahead().plan(model, targets, start, c_max=c_max), targets)
        motors = first_motors(model.printer, tables, start)
        if tables.frame is None:
            controls, imagined = known.controls.copy(), known.imagined_steps.copy()
            for axis in range(2):
                wanted, belt = targets[:, axis], known.imagined_steps[:, axis]
                if not always_nearest(tables, axis, wanted, belt):
                    controls[:, axis], imagined[:, axis] = solve(
                        wanted, int(start[axis]), motors[axis], tables, axis, belt, c_max
                    )
            return Plan(controls, imagined)
        return _plan_framed(tables, tables.frame, targets, start, motors, known, c_max)


def always_nearest(tables: PlayTables, axis: int, targets: np.ndarray, belt: np.ndarray) -> bool:
    """Say whether a plan's belt [T + 1] is, at every tick, at a place nearest to its target: then no plan is better."""
    least = np.abs(belt[0] - targets)
    for branch in (tables.lower_steps[axis], tables.upper_steps[axis]):
        at = np.clip(np.searchsorted(branch, targets), 1, len(branch) - 1)
        np.minimum(least, np.minimum(np.abs(branch[at] - targets), np.abs(branch[at - 1] - targets)), out=least)
    return bool((np.abs(belt[1:] - targets) <= least).all())


def solve(
    targets: np.ndarray,
    start: int,
    motor: int,
    tables: PlayTables,
    axis: int,
    known: np.ndarray,
    c_max: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the controls [T] and positions [T + 1] of a cheapest plan for one motor.

    ``known`` [T + 1] are the positions of a plan that can be carried out; the search stays within a window about them
    and the targets, so its plan is never worse.
    """
    states = window(tables, axis, targets, float(start), known, c_max)
    motors = np.empty(len(targets) + 1, np.int64)
    kernels.search(
        targets, states.start, motor - states.offset, states.places, states.first, states.last, states.low, states.high,
        states.left, states.right, c_max, _ROOM, motors,
    )  # fmt: skip
    controls = np.diff(motors).astype(np.int8)
    positions = np.empty(len(motors))
    kernels.follow(motors + states.offset, float(start), tables.lower_steps[axis], tables.upper_steps[axis], positions)
    return controls, positions


def _plan_framed(
    tables: PlayTables,
    frame: LatticeFrame,
    targets: np.ndarray,
    start: np.ndarray,
    motors: tuple[int, int],
    known: Plan,
    c_max: int,
) -> Plan:
    """Improve a plan behind a crooked frame axis by axis.

    Near a target the squared error is (b − b*)ᵀ JᵀJ (b − b*) in the belts' positions b, with b* the target's and J the
    frame's slopes. With one axis's plan known it is least along the other at a shifted target.
    """
    seen = frame.invert(targets)
    slopes = frame.slopes(seen)
    weights = np.swapaxes(slopes, -1, -2) @ slopes
    controls = known.controls.copy()
    belts = followed(tables, motors, start, controls)[1]
    best = known
    for _ in range(_PASSES):
        for axis in range(2):
            other = 1 - axis
            shift = weights[:, axis, other] / weights[:, axis, axis] * (belts[1:, other] - seen[:, other])
            wanted = np.ascontiguousarray(seen[:, axis] - shift)
            controls[:, axis], belts[:, axis] = solve(
                wanted, int(start[axis]), motors[axis], tables, axis, np.ascontiguousarray(belts[:, axis]), c_max
            )
        found = Plan(controls.copy(), frame.apply(belts))
        if better(best, found, targets) is best:
            break
        best = found
    return best


CONTROLLERS = {"optimal": Optimal()}
