"""Inverse feed-forward: command what the model needs to be where it should, as compensators of hysteresis do.

Algorithm 1 asks only for the next control, and stands still where none of them moves the carriage (physics.md §6). An
inverse asks where the motor would have to be, however far that is, and goes there as fast as the lattice lets it: the
play is crossed. Any world model can be asked, tables or none; each axis is inverted by itself.
"""

from dataclasses import dataclass

import numpy as np

from printmend.protocols import WorldModel
from printmend_lab.control.check import check_plan
from printmend_lab.path import Plan


@dataclass(frozen=True)
class Inverse:
    """Look ``reach_steps`` either way along each axis for the place that comes nearest to the target."""

    name: str = "inverse"
    reach_steps: int = 16

    def plan(self, model: WorldModel, targets_steps: np.ndarray, start_steps: np.ndarray, *, c_max: int = 3) -> Plan:
        """Choose controls [T, 2] for targets [T, 2] from ``start_steps`` [2]. Raise `InputError` off the bed."""
        targets, start = check_plan(model.printer, targets_steps, start_steps, c_max)
        far = np.arange(-self.reach_steps, self.reach_steps + 1)
        far = far[np.argsort(np.abs(far), kind="stable")]  # of equals the nearest
        asked = np.zeros((2, len(far), 2), np.int64)
        asked[0, :, 0] = asked[1, :, 1] = far
        state, controls, imagined = model.start(start), np.empty((len(targets), 2), np.int8), [start.astype(float)]
        for t, target in enumerate(targets):
            reached = model.advance(state, asked.reshape(-1, 2)).position_steps.reshape(2, len(far), 2)
            error = np.abs(np.stack([reached[axis, :, axis] - target[axis] for axis in range(2)]))
            best = far[np.argmin(np.round(error, 6), axis=1)]  # what rounding alone parts are equals
            controls[t] = np.clip(best, -c_max, c_max)
            state = model.advance(state, controls[t].astype(np.int64)[None])
            imagined.append(state.position_steps[0])
        return Plan(controls, np.array(imagined))


INVERSE = Inverse()
