"""Agents to measure others against: random, Naive, and two that know the true machine.

Algorithm 1 (the paper's Oracle) is not the best that knowledge can do: it takes the control whose result is nearest to
the next target, and where the play of a belt is more than one control takes up, no control changes anything, the first
of the 49 wins, and the motor never gets through its play (physics.md §6). With loose belts that is far worse than
commanding the path as it is. `planning_agent` knows the same machine and takes up the play ahead of the next move.

Each is a function of observations [N, D] that returns actions [N, 2] for `PrintVectorEnv`; `PrintEnv` takes row 0.
"""

from collections.abc import Callable

import numpy as np

from printmend.learn.mechanism_model import MechanismModel
from printmend.machine import Mechanism
from printmend.protocols import Controller
from printmend_lab.control.lookahead import Lookahead
from printmend_lab.env import kernels
from printmend_lab.env.print_env import C_MAX, PrintEnv
from printmend_lab.env.vector_env import PrintVectorEnv

Agent = Callable[[np.ndarray], np.ndarray]


def random_agent(rng: np.random.Generator) -> Agent:
    """Return an agent that commands anything."""
    return lambda observation: rng.integers(0, 2 * C_MAX + 1, (len(observation), 2))


def naive_agent(observation: np.ndarray) -> np.ndarray:
    """Believe in a healthy machine: command what brings the nominal position to the next target."""
    return np.clip(observation[:, 8:10], -C_MAX, C_MAX).astype(np.int64) + C_MAX


def algorithm1_agent(env: PrintEnv | PrintVectorEnv) -> Agent:
    """Return the paper's greedy Algorithm 1 with a perfect model, deadlocks included. It reads hidden state."""

    def act(observation: np.ndarray) -> np.ndarray:
        controls = np.empty((len(observation), 2), np.int64)
        kernels.greedy(C_MAX, env.machines, env.tasks, env.fleet, controls)
        return controls + C_MAX

    return act


def planning_agent(env: PrintEnv | PrintVectorEnv, controller: Controller | None = None) -> Agent:
    """Return an agent that plans each whole path on the true machine, and follows the plan. It reads hidden state.

    Without a ``controller`` it is `Lookahead`, which is honest about play.
    """
    planner = controller or Lookahead()
    plans: dict[tuple[Mechanism, int], np.ndarray] = {}

    def plan(machine: int, task: int) -> np.ndarray:
        mechanism, tasks = env.mechanisms[machine], env.tasks
        key = mechanism, task
        if key not in plans:
            targets = tasks.targets[task, : tasks.lengths[task]].astype(float)
            plans[key] = planner.plan(MechanismModel(mechanism), targets, tasks.starts[task], c_max=C_MAX).controls
        return plans[key]

    def act(observation: np.ndarray) -> np.ndarray:
        fleet = env.fleet
        rows = zip(fleet.machine, fleet.task, fleet.tick, strict=True)
        controls = np.zeros((len(observation), 2), np.int64)
        for n, (machine, task, tick) in enumerate(rows):
            steps = plan(machine, task)
            if tick < len(steps):
                controls[n] = steps[tick]
        return controls + C_MAX

    return act
