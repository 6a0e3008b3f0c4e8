"""own-controller: command, tick by tick, what the model says is still missing. Replace the loop by yours.

Where play swallows a control the next one is larger by what is missing, so that the plan never stands still.
"""

from dataclasses import dataclass

import numpy as np

from printmend.protocols import WorldModel
from printmend_lab.control.check import check_plan
from printmend_lab.path import Plan


@dataclass(frozen=True)
class Controller:
    """Chooses a control a target; ``name`` is what tables call it."""

    name: str = "own-controller"

    def plan(self, model: WorldModel, targets_steps: np.ndarray, start_steps: np.ndarray, *, c_max: int = 3) -> Plan:
        """Choose controls [T, 2] in −c_max…c_max for targets [T, 2] from ``start_steps`` [2]."""
        targets, start = check_plan(model.printer, targets_steps, start_steps, c_max)
        controls, imagined = np.zeros((len(targets), 2), np.int8), np.empty((len(targets) + 1, 2))
        state = model.start(start)
        imagined[0] = state.position_steps[0]
        for t, target in enumerate(targets):
            controls[t] = np.clip(np.rint(target - imagined[t]), -c_max, c_max)
            state = model.advance(state, controls[t : t + 1].astype(np.int64))
            imagined[t + 1] = state.position_steps[0]
        return Plan(controls, imagined)


MINE = Controller()
