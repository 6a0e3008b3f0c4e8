"""The paper's problem for one agent at a time: `OnePrintVectorEnv` with one row, and a picture of it for people."""

from typing import Any

import gymnasium
import numpy as np

from printmend_lab.env.one_vector_env import PRINT, OnePrintVectorEnv
from printmend_lab.env.scenes import draw_scene
from printmend_lab.sampling import Severity

_SIZE_PX, _MARGIN_PX = 400, 12
_PAPER, _WANTED, _PRINTED, _HEAD = (250, 250, 248), (176, 176, 176), (214, 90, 20), (20, 60, 160)
_HEAD_PX = 3  # half the side of the square where the nozzle is


def path_picture(wanted: np.ndarray, printed: np.ndarray, bed_steps: tuple[int, int]) -> np.ndarray:
    """Return a picture [400, 400, 3] of uint8 of a wanted path [N, 2] and a printed one [M, 2], full steps.

    It shows the square around both; y points up.
    """
    both = np.concatenate([wanted, printed])
    low, high = (
        np.maximum(both.min(axis=0), -np.array(bed_steps)),
        np.minimum(both.max(axis=0), 2 * np.array(bed_steps)),
    )
    scale = (_SIZE_PX - 1 - 2 * _MARGIN_PX) / max(float((high - low).max()), 1.0)
    picture = np.empty((_SIZE_PX, _SIZE_PX, 3), np.uint8)
    picture[:] = _PAPER

    def pixels(points: np.ndarray) -> np.ndarray:
        places = np.rint((points - (low + high) / 2) * scale) + (_SIZE_PX - 1) / 2
        return np.clip(places, 0, _SIZE_PX - 1).astype(int)

    for points, colour in ((wanted, _WANTED), (printed, _PRINTED)):
        x, y = pixels(_dense(points, 1 / scale)).T
        picture[_SIZE_PX - 1 - y, x] = colour
    x, y = pixels(printed[-1:])[0]
    row = _SIZE_PX - 1 - y
    picture[max(row - _HEAD_PX, 0) : row + _HEAD_PX + 1, max(x - _HEAD_PX, 0) : x + _HEAD_PX + 1] = _HEAD
    return picture


def _dense(points: np.ndarray, apart: float) -> np.ndarray:
    """Return a polyline with points in between, no farther than ``apart`` from each other."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.linspace(0.0, along[-1], max(int(along[-1] / apart), 1) + 1)
    return np.stack([np.interp(at, along, axis) for axis in points.T], axis=1)


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
