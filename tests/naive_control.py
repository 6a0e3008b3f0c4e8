"""Slow, obvious versions of the controllers."""

import itertools

import numpy as np

from printmend.path import Plan
from printmend.protocols import WorldModel


def greedy(model: WorldModel, targets: np.ndarray, start: np.ndarray, c_max: int = 3) -> Plan:
    """Algorithm 1: try every control of the product, keep the first of the nearest (physics.md §8.1)."""
    candidates = np.array(list(itertools.product(range(-c_max, c_max + 1), range(-c_max, c_max + 1))))
    state = model.start(start)
    controls, imagined = [], [state.position_steps[0]]
    for target in targets:
        after = model.advance(state, candidates)
        best, best_distance = 0, np.inf
        for k in range(len(candidates)):
            dx, dy = target - after.position_steps[k]
            distance = np.sqrt(dx * dx + dy * dy)
            if distance < best_distance:
                best, best_distance = k, distance
        controls.append(candidates[best])
        state = after[best]
        imagined.append(state.position_steps[0])
    return Plan(np.array(controls, np.int8).reshape(-1, 2), np.array(imagined))
