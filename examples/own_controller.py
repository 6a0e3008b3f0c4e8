"""A controller of one's own: command, tick by tick, what the model says is still missing.

printmend conformance own_controller:MINE       # in this folder: does it keep what a controller must?
printmend bench table1 --bodies generated:4 --families pulley-play --models greybox,greybox+own_controller:MINE
"""

from dataclasses import dataclass

import numpy as np

from printmend_lab.control.check import check_plan
from printmend_lab.path import Plan


@dataclass(frozen=True)
class Missing:
    """Where play swallows a control, the next one is larger by what is missing: it cannot deadlock."""

    name: str = "missing"

    def plan(self, model, targets_steps, start_steps, *, c_max=3):
        targets, start = check_plan(model.printer, targets_steps, start_steps, c_max)
        controls, imagined = np.zeros((len(targets), 2), np.int8), np.empty((len(targets) + 1, 2))
        state = model.start(start)
        imagined[0] = state.position_steps[0]
        for t, target in enumerate(targets):
            controls[t] = np.clip(np.rint(target - imagined[t]), -c_max, c_max)
            state = model.advance(state, controls[t : t + 1].astype(int))
            imagined[t + 1] = state.position_steps[0]
        return Plan(controls, imagined)


MINE = Missing()
