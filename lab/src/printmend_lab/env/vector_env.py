"""The paper's printing problem, many prints at once, compiled."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from printmend.machine import Mechanism
from printmend.printer import Printer, read_printer
from printmend_lab.env import kernels
from printmend_lab.env.fleet import Fleet, Machines, Tasks, fleet_of, machines_of, mechanisms_of, random_layer, tasks_of
from printmend_lab.env.print_env import C_MAX, DrawCorruption, Reward, draw_damaged, observation_space
from printmend_lab.path import Layer


class PrintVectorEnv(VectorEnv):
    """``num_envs`` prints side by side; spaces, actions and rewards of each are those of `PrintEnv`.

    Machines and paths come from pools, drawn at `reset` with a seed (or at the first reset): ``machines``
    corruptions, and the ``layers`` given or ``paths`` random shapes. Each episode draws one of each. Follows
    Gymnasium's next-step autoreset: the step after an end ignores its action, starts anew and rewards nothing.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - Gymnasium's own declaration
        "render_modes": [],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int,
        *,
        printer: Printer | str = "ender5",
        corruption: DrawCorruption = draw_damaged,
        layers: Sequence[Layer] | None = None,
        ticks: int = 500,
        lookahead: int = 8,
        reward: Reward = "final",
        machines: int = 64,
        paths: int = 64,
    ) -> None:
        self.num_envs = num_envs
        self.printer = read_printer(printer) if isinstance(printer, str) else printer
        self.single_observation_space = observation_space(self.printer, lookahead)
        self.single_action_space = gymnasium.spaces.MultiDiscrete([2 * C_MAX + 1] * 2)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._corruption, self._ticks, self._lookahead = corruption, ticks, lookahead
        self._dense, self._pools = reward == "dense", (machines, paths)
        self._layers = None if layers is None else tuple(layers)
        self._done = np.zeros(num_envs, bool)
        self._drawn = False
        self.fleet: Fleet = fleet_of(num_envs)
        self.mechanisms: tuple[Mechanism, ...]
        self.machines: Machines
        self.tasks: Tasks

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start every print; with a seed, draw new pools of machines and paths."""
        super().reset(seed=seed)
        if seed is not None or not self._drawn:
            rng, (machines, paths) = self.np_random, self._pools
            self.mechanisms = mechanisms_of([self._corruption(rng) for _ in range(machines)], self.printer)
            self.machines = machines_of(self.mechanisms, self.printer)
            layers = self._layers or [random_layer(rng, self.printer, self._ticks) for _ in range(paths)]
            self.tasks = tasks_of(layers)
            self._drawn = True
        self._done[:] = False
        self._restart(np.arange(self.num_envs))
        return self._observe(), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Command one control [N, 2] to every print."""
        controls = np.asarray(actions, np.int64) - C_MAX
        ended, reward, done = self._done, np.empty(self.num_envs), np.empty(self.num_envs, bool)
        kernels.advance(controls, ended, self.machines, self.tasks, self.fleet, self._dense, reward, done)
        if ended.any():
            self._restart(np.flatnonzero(ended))
        self._done = done
        return self._observe(), reward, done.copy(), np.zeros(self.num_envs, bool), {}

    def _restart(self, rows: np.ndarray) -> None:
        self.fleet.machine[rows] = self.np_random.integers(len(self.machines.lower), size=len(rows))
        self.fleet.task[rows] = self.np_random.integers(len(self.tasks.lengths), size=len(rows))
        kernels.restart(rows, self.machines, self.tasks, self.fleet)

    def _observe(self) -> np.ndarray:
        out = np.empty((self.num_envs, self.single_observation_space.shape[0]), np.float32)  # type: ignore[index]
        kernels.observe(self.tasks, self.fleet, self._lookahead, out)
        return out
