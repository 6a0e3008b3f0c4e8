"""Model predictive control: the best of sampled control sequences over a short horizon, its first control, and again.

The cross-entropy method as PETS plans (K. Chua et al., NeurIPS 2018; Z. I. Botev et al., Handbook of Statistics 31
(2013) ch. 3): sample sequences about a mean, keep the elite, narrow, repeat; the rest of the plan warms the next one.
Any world model can be asked. Where a model has tables, `optimal` is better and faster: it searches the whole layer.
"""

from dataclasses import dataclass

import numpy as np

from printmend.protocols import State, WorldModel
from printmend_lab.control.check import check_plan
from printmend_lab.path import Plan

_LEAST_SPREAD = 0.3  # steps, so that a sampled control can still differ from the mean


@dataclass(frozen=True)
class Mpc:
    """Plan ``horizon`` targets ahead with ``rounds`` of ``samples`` sequences, of which ``elite`` are kept."""

    name: str = "mpc"
    horizon: int = 6
    samples: int = 64
    elite: int = 8
    rounds: int = 2
    seed: int = 0

    def plan(self, model: WorldModel, targets_steps: np.ndarray, start_steps: np.ndarray, *, c_max: int = 3) -> Plan:
        """Choose controls [T, 2] for targets [T, 2] from ``start_steps`` [2]. Raise `InputError` off the bed."""
        targets, start = check_plan(model.printer, targets_steps, start_steps, c_max)
        rng, state = np.random.default_rng(self.seed), model.start(start)
        controls, imagined = np.empty((len(targets), 2), np.int8), [start.astype(float)]
        asked = np.diff(targets, axis=0, prepend=start[None].astype(float))
        warm = np.zeros((0, 2))
        for t in range(len(targets)):
            ahead = targets[t : t + self.horizon]
            known = asked[t : t + self.horizon].copy()
            known[0] = targets[t] - state.position_steps[0]
            mean = np.concatenate([warm, known[len(warm) :]])
            best, warm = self._best(model, state, ahead, mean, known, c_max, rng)
            controls[t] = best
            state = model.advance(state, best[None])
            imagined.append(state.position_steps[0])
        return Plan(controls, np.array(imagined))

    def _best(
        self, model: WorldModel, state: State, targets: np.ndarray, mean: np.ndarray, known: np.ndarray, c_max: int,
        rng: np.random.Generator,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Return the first control [2] of the best sequence, and what comes after it [H − 1, 2]."""
        spread, least, chosen = np.full(mean.shape, c_max / 2), np.inf, np.zeros(mean.shape, np.int64)
        for _ in range(self.rounds):
            drawn = mean + spread * rng.normal(size=(self.samples, *mean.shape))
            drawn[0], drawn[1], drawn[2] = mean, known, 0.0  # as planned, as a healthy printer would need, rest
            sequences = np.clip(np.rint(drawn), -c_max, c_max).astype(np.int64)
            cost = cost_steps2(model, state, sequences, targets)
            order = np.argsort(cost, kind="stable")[: self.elite]
            if cost[order[0]] < least:
                least, chosen = float(cost[order[0]]), sequences[order[0]]
            mean, spread = sequences[order].mean(axis=0), np.maximum(sequences[order].std(axis=0), _LEAST_SPREAD)
        return chosen[0], chosen[1:].astype(float)


def cost_steps2(model: WorldModel, state: State, sequences: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Return the summed square error [K] of control sequences [K, H, 2] against targets [H, 2]."""
    cost = np.zeros(len(sequences))
    for t, target in enumerate(targets):
        state = model.advance(state, sequences[:, t])
        cost += ((state.position_steps - target) ** 2).sum(axis=1)
    return cost


MPC = Mpc()
