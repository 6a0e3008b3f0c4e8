"""Slow, obvious versions of the controllers."""

import itertools

import numpy as np

from printmend.errors import InputError
from printmend.path import Plan
from printmend.protocols import WorldModel


def greedy(model: WorldModel, targets: np.ndarray, start: np.ndarray, c_max: int = 3) -> Plan:
    """Algorithm 1, one control at a time (physics.md §8.1)."""
    state = model.start(start)
    controls, imagined = [], [state.position_steps[0]]
    for target in targets:
        best, best_distance = None, np.inf
        for cx, cy in itertools.product(range(-c_max, c_max + 1), range(-c_max, c_max + 1)):
            try:
                after = model.advance(state, np.array([[cx, cy]]))
            except InputError:  # a motor would leave its tables
                continue
            dx, dy = target - after.position_steps[0]
            distance = np.sqrt(dx * dx + dy * dy)
            if distance < best_distance:
                best, best_distance = (cx, cy, after), distance
        assert best is not None
        controls.append(best[:2])
        state = best[2]
        imagined.append(state.position_steps[0])
    return Plan(np.array(controls, np.int8).reshape(-1, 2), np.array(imagined))
