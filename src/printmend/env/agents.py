"""Three agents to measure others against: random, Naive, and Algorithm 1 with the true machine (the paper's Oracle).

Each is a function of observations [N, D] that returns actions [N, 2] for `PrintVectorEnv`; `PrintEnv` takes row 0.
"""

from collections.abc import Callable

import numpy as np

from printmend.env import kernels
from printmend.env.print_env import C_MAX, PrintEnv
from printmend.env.vector_env import PrintVectorEnv

Agent = Callable[[np.ndarray], np.ndarray]


def random_agent(rng: np.random.Generator) -> Agent:
    """Return an agent that commands anything."""
    return lambda observation: rng.integers(0, 2 * C_MAX + 1, (len(observation), 2))


def naive_agent(observation: np.ndarray) -> np.ndarray:
    """Believe in a healthy machine: command what brings the nominal position to the next target."""
    return np.clip(observation[:, 8:10], -C_MAX, C_MAX).astype(np.int64) + C_MAX


def algorithm1_agent(env: PrintEnv | PrintVectorEnv) -> Agent:
    """Return the paper's greedy Algorithm 1 with a perfect model. It reads the hidden state of ``env``."""

    def act(observation: np.ndarray) -> np.ndarray:
        controls = np.empty((len(observation), 2), np.int64)
        kernels.greedy(C_MAX, env.machines, env.tasks, env.fleet, controls)
        return controls + C_MAX

    return act
