"""The paper's printing problem as a Gymnasium environment, one print at a time.

The state is the nozzle's position, the pulleys' angles, the corruption and the target path. The observation is
what a printer's computer knows: the start, the path to print and the commands so far, never where the nozzle is.
"""

from collections.abc import Callable, Sequence
from typing import Any, Literal

import gymnasium
import numpy as np

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
