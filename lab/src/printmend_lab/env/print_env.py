"""The paper's printing problem as Gymnasium environments: one print at a time, or many at once, compiled.

The state is the nozzle's position, the pulleys' angles, the corruption and the target path. The observation is
what a printer's computer knows: the start, the path to print and the commands so far, never where the nozzle is.
"""

from collections.abc import Callable, Sequence
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from printmend.corruption import Corruption
from printmend.machine import Mechanism
from printmend.printer import Printer, read_printer
from printmend_lab.env import kernels
from printmend_lab.env.fleet import Fleet, Machines, Tasks, fleet_of, machines_of, mechanisms_of, random_layer, tasks_of
from printmend_lab.path import Layer
from printmend_lab.sampling import sample

C_MAX = 3  # steps of a motor in a tick, as in Algorithm 1
Reward = Literal["final", "dense"]
DrawCorruption = Callable[[np.random.Generator], Corruption]


def draw_damaged(rng: np.random.Generator) -> Corruption:
    """Draw deformed pulleys and loose belts at the paper's scale: the default of both environments."""
    return sample("pulley-loose", rng)


def observation_space(printer: Printer, lookahead: int) -> gymnasium.spaces.Box:
    """Return the space of observations [8 + 2·lookahead], float32, all in full steps (exact integers).

    0–1 start · 2–3 nominal − start, the sum of the commands so far · 4–5 the last command · 6–7 the sign of
    the last motion of each axis, which tells the side of the play that is engaged · 8… the next targets − nominal,
    x and y alternating; past the end of the path the last target repeats.
    """
    bed = np.tile(np.array(printer.bed_steps, np.float32), 4 + lookahead)
    low, high = -3 * bed, 3 * bed
    low[:2] = 0
    low[4:8], high[4:8] = [-C_MAX] * 2 + [-1] * 2, [C_MAX] * 2 + [1] * 2
    return gymnasium.spaces.Box(low, high, dtype=np.float32)


class PrintEnv(gymnasium.Env):
    """Print one path on a machine broken in a way that is drawn anew for every episode.

    An action is a control in Z², |c| ≤ 3, shifted to 0…6 (`MultiDiscrete([7, 7])`; 3 is no motion), one a tick and
    target. The return is −RMSE over the printed points, start included [full steps]: at the end
    (``reward="final"``), or as the difference that each point makes (``"dense"``).

    ``layers`` are the paths to draw from; without them every episode draws a new random shape of ``ticks`` points.
    ``info["rmse_steps"]`` is the RMSE so far.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - Gymnasium's own declaration

    def __init__(
        self,
        *,
        printer: Printer | str = "ender5",
        corruption: DrawCorruption = draw_damaged,
        layers: Sequence[Layer] | None = None,
        ticks: int = 500,
        lookahead: int = 8,
        reward: Reward = "final",
    ) -> None:
        self.printer = read_printer(printer) if isinstance(printer, str) else printer
        self.observation_space = observation_space(self.printer, lookahead)
        self.action_space = gymnasium.spaces.MultiDiscrete([2 * C_MAX + 1] * 2)
        self._corruption, self._ticks, self._lookahead = corruption, ticks, lookahead
        self._dense = reward == "dense"
        self._layers = None if layers is None else tuple(layers)
        self._skip = np.zeros(1, bool)
        self.fleet: Fleet = fleet_of(1)
        self.mechanisms: tuple[Mechanism, ...]
        self.machines: Machines
        self.tasks: Tasks

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Draw a machine and a path; the nozzle stands at the start with its belts' play centred."""
        super().reset(seed=seed)
        self.mechanisms = mechanisms_of([self._corruption(self.np_random)], self.printer)
        self.machines = machines_of(self.mechanisms, self.printer)
        if self._layers is None:
            layer = random_layer(self.np_random, self.printer, self._ticks)
        else:
            layer = self._layers[int(self.np_random.integers(len(self._layers)))]
        self.tasks = tasks_of([layer])
        kernels.restart(np.zeros(1, np.int64), self.machines, self.tasks, self.fleet)
        return self._observe(), self._info()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Command one control towards the next target."""
        controls = np.asarray(action, np.int64).reshape(1, 2) - C_MAX
        reward, done = np.empty(1), np.empty(1, bool)
        kernels.advance(controls, self._skip, self.machines, self.tasks, self.fleet, self._dense, reward, done)
        return self._observe(), float(reward[0]), bool(done[0]), False, self._info()

    def _observe(self) -> np.ndarray:
        out = np.empty((1, self.observation_space.shape[0]), np.float32)  # type: ignore[index]
        kernels.observe(self.tasks, self.fleet, self._lookahead, out)
        return out[0]

    def _info(self) -> dict[str, Any]:
        return {"rmse_steps": float(np.sqrt(self.fleet.squares[0] / (self.tasks.lengths[0] + 1)))}


# The paper's printing problem, many prints at once, compiled.


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
