"""Plan on nothing but `WorldModel.advance`, for models that have no tables: a beam of machines, moved in batches."""

import itertools
from dataclasses import dataclass

import numpy as np

from printmend.protocols import State, WorldModel
from printmend_lab.control.check import advanced, check_plan
from printmend_lab.path import Plan

# Machines whose commands and positions agree to this many full steps go on alike: one of them is followed.
_ALIKE_STEPS = 0.02
# Of two machines that have cost the same, the one whose nominal position is nearer to where the path will be some ticks
# later is followed; this share of that squared distance.
_AHEAD_TICKS, _AHEAD_SHARE = 4, 1e-3

_MOST_KEYS = 2.0**62


@dataclass(frozen=True)
class Beam:
    """Follow the ``width`` machines with the least sum of squared errors so far from target to target.

    Every tick tries all controls on all of them in one call of `advance`, and of machines that are alike keeps the
    best; the plan is the way of the one that is best in the end. A plan that costs nothing now and pays later, as
    taking up play does, is among those followed where ``width`` is large enough. For models with memory and no tables,
    which `Greedy` would leave standing still in their play.
    """

    name: str = "beam"
    width: int = 64

    def plan(self, model: WorldModel, targets_steps: np.ndarray, start_steps: np.ndarray, *, c_max: int = 3) -> Plan:
        """Choose controls [T, 2] for targets [T, 2] from ``start_steps`` [2]. Raise `InputError` off the bed."""
        targets, start = check_plan(model.printer, targets_steps, start_steps, c_max)
        candidates = np.array(sorted(itertools.product(range(-c_max, c_max + 1), repeat=2), key=_size))
        machines, costs = model.start(start), np.zeros(1)
        states, parents, chosen = [machines.position_steps], [], []
        for t, target in enumerate(targets):
            ahead = targets[min(t + _AHEAD_TICKS, len(targets) - 1)]
            many = len(costs), len(candidates)
            before = _each(machines, np.repeat(np.arange(many[0]), many[1]))
            after = advanced(model, before, np.tile(candidates, (many[0], 1)))
            total = np.repeat(costs, many[1]) + ((after.position_steps - target) ** 2).sum(axis=1)
            nominal = np.broadcast_to(after.nominal_steps, after.position_steps.shape)
            value = total + _AHEAD_SHARE * ((nominal - ahead) ** 2).sum(axis=1)
            kept = _best_of_each(nominal, after.position_steps, value)[: self.width]
            machines, costs = _each(after, kept), total[kept]
            parents.append(kept // many[1])
            chosen.append(candidates[kept % many[1]])
            states.append(machines.position_steps)
        return _way_back(states, parents, chosen, int(np.argmin(costs)))


def _size(control: tuple[int, ...]) -> tuple[int, ...]:
    """Order controls so that of equals the smaller one comes first."""
    return (sum(c * c for c in control), *control)


def _each(state: State, rows: np.ndarray) -> State:
    """Return the states [K] of machines ``rows`` [K]."""
    memory = None if state.memory is None else state.memory[rows]
    return State(state.nominal_steps[rows], state.position_steps[rows], memory)


def _best_of_each(nominal: np.ndarray, position: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Return the rows of the least value among those that are alike, the least first."""
    order = np.argsort(value, kind="stable")
    alike = np.concatenate([nominal, np.rint(position / _ALIKE_STEPS).astype(np.int64)], axis=1)[order]
    alike -= alike.min(axis=0)
    sizes = alike.max(axis=0) + 1
    if sizes.astype(float).prod() < _MOST_KEYS:  # one number a machine sorts ten times as fast as four
        _, first = np.unique(np.ravel_multi_index(tuple(alike.T), tuple(sizes)), return_index=True)
    else:
        _, first = np.unique(alike, axis=0, return_index=True)
    return order[np.sort(first)]


def _way_back(states: list[np.ndarray], parents: list[np.ndarray], chosen: list[np.ndarray], end: int) -> Plan:
    """Return the plan that led to machine ``end`` of the last tick."""
    controls, imagined = np.empty((len(chosen), 2), np.int8), np.empty((len(states), 2))
    for t in range(len(chosen) - 1, -1, -1):
        controls[t], imagined[t + 1] = chosen[t][end], states[t + 1][end]
        end = int(parents[t][end])
    imagined[0] = states[0][end]
    return Plan(controls, imagined)


CONTROLLERS = {"beam": Beam()}
