"""The paper's problem for one agent at a time: `OnePrintVectorEnv` with one row, and a picture of it."""

from typing import Any

import gymnasium
import numpy as np

from printmend.corruption.sampling import Severity
from printmend_lab.env.one_vector_env import PRINT, OnePrintVectorEnv
from printmend_lab.env.picture import path_picture
from printmend_lab.env.scenes import draw_scene


class OnePrintEnv(gymnasium.Env):
    """One test print, its scan, one print, as `OnePrintVectorEnv` has it; every episode draws a new machine and path.

    The options are those of `OnePrintVectorEnv`. With ``render_mode="rgb_array"``, `render` draws from above what is
    wanted in grey and what is printed in colour, which no agent sees.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012 - Gymnasium's own

    def __init__(
        self,
        *,
        family: str = "pulley-loose",
        severity: Severity = "damaged",
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        self.render_mode = render_mode
        self.vector = OnePrintVectorEnv(1, family=family, severity=severity, scenes=1, **options)
        self.observation_space = self.vector.single_observation_space
        self.action_space = self.vector.single_action_space
        ticks = len(self.observation_space["path"].low) - 1  # type: ignore[index]
        self._drawn_from = (family, severity, ticks)
        self._printed: list[np.ndarray] = []

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Draw a machine and a path; the machine stands in the middle of the bed, its belts' play centred."""
        super().reset(seed=seed)
        self.vector.np_random = self.np_random
        self.vector.use([draw_scene(self.np_random, self.vector.printer, *self._drawn_from)])
        observation, info = self.vector.reset()
        self._printed = [self.vector.printed_steps()[0]]
        return _only(observation), _only(info)

    def step(self, action: np.ndarray) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Command one control."""
        observation, reward, done, _, info = self.vector.step(np.asarray(action).reshape(1, 2))
        if observation["phase"][0] == PRINT and self.vector.fleet.tick[0] == 0:  # the test print is done
            self._printed = []
        self._printed.append(self.vector.printed_steps()[0])
        return _only(observation), float(reward[0]), bool(done[0]), False, _only(info)

    def render(self) -> np.ndarray | None:
        """Return a picture [H, W, 3] of uint8 where the render mode is rgb_array."""
        if self.render_mode != "rgb_array" or not self._printed:
            return None
        path = self.vector.scenes[0].layer.nominal_steps.astype(float)
        return path_picture(path, np.array(self._printed), self.vector.printer.bed_steps)


def _only(batch: dict[str, Any]) -> dict[str, Any]:
    """Return a copy of the only row of a batch."""
    return {name: value[0].copy() for name, value in batch.items()}
