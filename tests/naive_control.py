"""Slow, obvious versions of the controllers."""

import itertools

import numpy as np

from printmend.machine import PlayTables
from printmend.protocols import WorldModel
from printmend_lab.control.coupled import Window
from printmend_lab.path import Plan


def greedy(model: WorldModel, targets: np.ndarray, start: np.ndarray, c_max: int = 3) -> Plan:
    """Algorithm 1: try every control of the product, keep the first of the nearest (physics.md §8.1)."""
    candidates = np.array(list(itertools.product(range(-c_max, c_max + 1), range(-c_max, c_max + 1))))
    state = model.start(start)
    controls, imagined = [], [state.position_steps[0]]
    for target in targets:
        after = model.advance(state, candidates)
        best, least = 0, np.inf
        for k in range(len(candidates)):
            dx, dy = target - after.position_steps[k]
            squared = dx * dx + dy * dy
            if squared < least:
                best, least = k, squared
        controls.append(candidates[best])
        state = after[best]
        imagined.append(state.position_steps[0])
    return Plan(np.array(controls, np.int8).reshape(-1, 2), np.array(imagined))


def least_cost_axis(
    targets: np.ndarray, position: float, motor: int, lower: np.ndarray, upper: np.ndarray, c_max: int = 3
) -> float:
    """The least sum of squared errors of one motor with play: every state that can be reached is followed."""
    costs = {(motor, position): 0.0}
    for target in targets:
        after: dict[tuple[int, float], float] = {}
        for (m, u), cost in costs.items():
            for c in range(-c_max, c_max + 1):
                if 0 <= m + c < len(lower):
                    v = min(max(u, lower[m + c]), upper[m + c])
                    value = cost + (target - v) ** 2
                    after[m + c, v] = min(after.get((m + c, v), np.inf), value)
        costs = after
    return min(costs.values())


def least_cost(model: WorldModel, targets: np.ndarray, start: np.ndarray, c_max: int = 3) -> float:
    """The least sum of squared distances on a model whose state is its nominal position and memory."""
    candidates = np.array(list(itertools.product(range(-c_max, c_max + 1), repeat=2)))
    states = {(): (0.0, model.start(start))}
    for target in targets:
        after: dict[tuple, tuple] = {}
        for cost, state in states.values():
            moved = model.advance(state, candidates)
            values = cost + ((moved.position_steps - target) ** 2).sum(axis=1)
            for k, value in enumerate(values):
                assert moved.memory is not None
                key = (*moved.nominal_steps[k], *moved.memory[k])
                if key not in after or value < after[key][0]:
                    after[key] = (value, moved[k])
        states = after
    return min(cost for cost, _ in states.values())


def least_cost_corexy(
    targets: np.ndarray, start: np.ndarray, tables: PlayTables, bound: float, c_max: int = 3
) -> float:
    """The least sum of squared distances of two motors with play, a = x + y and b = x − y.

    Follows every state that costs no more than ``bound``, the cost of a plan that is known. States in the same place
    with the same motors are one; the cheapest stays.
    """
    controls = np.array(list(itertools.product(range(-c_max, c_max + 1), repeat=2)))
    moves = np.column_stack([controls.sum(axis=1), controls[:, 0] - controls[:, 1]])
    origin = np.array([start[0] + start[1], start[0] - start[1]])
    motors, belts, costs = np.array([[motor.start for motor in tables.motors]]), origin[None].astype(float), np.zeros(1)
    for target in targets:
        motors = (motors[:, None] + moves).reshape(-1, 2)
        belts, costs = np.repeat(belts, len(moves), axis=0), np.repeat(costs, len(moves))
        belts = np.column_stack(
            [
                np.clip(belts[:, k], motor.lower_steps[motors[:, k]], motor.upper_steps[motors[:, k]])
                for k, motor in enumerate(tables.motors)
            ]
        )
        place = np.column_stack([belts.sum(axis=1), belts[:, 0] - belts[:, 1]]) / 2
        costs = costs + ((place - target) ** 2).sum(axis=1)
        kept = costs <= bound + 1e-9
        motors, belts, costs = motors[kept], belts[kept], costs[kept]
        order = np.lexsort((costs, *belts.T, *motors.T))
        state = np.column_stack([motors, belts])[order]
        first = np.concatenate([[True], (state[1:] != state[:-1]).any(axis=1)])
        motors, belts, costs = motors[order][first], belts[order][first], costs[order][first]
    return float(costs.min())


def arrival_costs(
    wanted: np.ndarray, weight: np.ndarray, price: np.ndarray, states: Window, reach: int
) -> list[dict[tuple[int, int], float]]:
    """What each state (k, m) of ticks 1…T of one motor costs with all that comes after it: every move is tried."""
    costs: list[dict[tuple[int, int], float]] = [{} for _ in range(len(wanted) + 1)]
    for t in range(len(wanted), 0, -1):
        for k in range(states.left[t], states.right[t]):
            for m in range(states.first[k], states.last[k] + 1):
                ahead = 0.0 if t == len(wanted) else np.inf
                for after in range(max(m - reach, 0), min(m + reach, len(states.low) - 1) + 1):
                    place = min(max(k, states.low[after]), states.high[after])
                    if t < len(wanted):
                        ahead = min(ahead, costs[t + 1].get((place, after), np.inf))
                missed = states.places[k] - wanted[t - 1]
                costs[t][k, m] = weight[t - 1] * missed**2 + price[t - 1, m % 2] + ahead
    return costs
