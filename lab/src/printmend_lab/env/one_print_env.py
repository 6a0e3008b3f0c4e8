"""The paper's problem: one test print of the agent's choice, its noisy scan, then a print without feedback."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from printmend.printer import Printer, read_printer
from printmend_lab.env import kernels
from printmend_lab.env.fleet import Fleet, Machines, Scene, Tasks, draw_scene, fleet_of, machines_of, tasks_of
from printmend_lab.env.print_env import C_MAX, Reward, observation_space
from printmend_lab.path import Layer
from printmend_lab.sampling import Severity

KEPT_SEED = 20261124  # of the scenes that agents are compared on: train on others
TEST_PRINT, PRINT = 0, 1
_LOOKAHEAD = 8  # of the next targets in `now`; all of them are in `path`
_NOISE_MM = 0.05  # of a coordinate, standard deviation, as a flatbed scan or callipers have it
_SCAN_STEPS = 600  # bound of a scan's space: how far a printed point may lie beside its command, a coordinate


def one_print_space(printer: Printer, ticks: int, probe_ticks: int) -> gymnasium.spaces.Dict:
    """Return the space of an agent's observations, all in full steps.

    `phase` is 0 during the test print and 1 during the print; `tick` [1] counts the controls of the phase so far. `now`
    [24] is what `Print-v0` shows; during the test print its "next targets" are the start. `path` [ticks + 1, 2] is the
    start and the targets of the print, known from the beginning. `scan` [probe_ticks + 1, 4] holds the test print's
    nominal x and y and how far beside them the scan saw it; zeros until the test print is done.
    """
    beds = np.array(printer.bed_steps, np.float32)
    path_high = np.broadcast_to(beds, (ticks + 1, 2))
    # Motors stop a bed's length beyond the bed; printed points may lie farther, but never this far.
    most = np.concatenate([2 * beds, np.full(2, max(_SCAN_STEPS, 4 * beds.max()), np.float32)])
    scan_high = np.broadcast_to(most, (probe_ticks + 1, 4))
    return gymnasium.spaces.Dict(
        {
            "phase": gymnasium.spaces.Discrete(2),
            "tick": gymnasium.spaces.Box(0, max(ticks, probe_ticks), (1,), np.int64),
            "now": observation_space(printer, _LOOKAHEAD),
            "path": gymnasium.spaces.Box(np.zeros_like(path_high), path_high, dtype=np.float32),
            "scan": gymnasium.spaces.Box(-scan_high, scan_high, dtype=np.float32),
        }
    )


class OnePrintVectorEnv(VectorEnv):
    """``num_envs`` of the paper's problem side by side, stepped in compiled code.

    An episode begins with the machine in the middle of the bed. ``probe_ticks`` controls of the agent's choice are the
    test print. Then the agent sees its scan, with normal noise of ``noise_mm`` a coordinate. The machine is put at the
    path's start, and one control for each target prints the path; nothing of that is ever observed. An action is a
    control in Z², |c| ≤ 3, shifted to 0…6.

    The return is the score, (Naive − RMSE) / (Naive − optimum): 0 for the path commanded as it is, 1 for the best plan
    on the true machine. It comes at the end (``reward="final"``), or as the share of each printed point (``"dense"``;
    the same sum).

    ``scenes`` machines and paths of a family are drawn at a `reset` with a seed. Row n begins with scene n, so that as
    many rows as scenes see each once; later episodes draw. Follows Gymnasium's next-step autoreset. The arrays of an
    observation are read-only and do not change.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - Gymnasium's own declaration
        "render_modes": [],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int,
        *,
        family: str = "pulley-loose",
        severity: Severity = "damaged",
        printer: Printer | str = "ender5",
        ticks: int = 500,
        probe_ticks: int = 600,
        noise_mm: float = _NOISE_MM,
        reward: Reward = "final",
        scenes: int = 64,
    ) -> None:
        self.num_envs = num_envs
        self.printer = read_printer(printer) if isinstance(printer, str) else printer
        self.single_observation_space = one_print_space(self.printer, ticks, probe_ticks)
        self.single_action_space = gymnasium.spaces.MultiDiscrete([2 * C_MAX + 1] * 2)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._drawn_from = (family, severity, ticks)
        self._noise_steps = noise_mm / np.array(self.printer.mm_per_step)
        self._dense, self._count = reward == "dense", scenes
        middle = np.array(self.printer.bed_steps) // 2
        self._test_print = Layer(0, 0.2, middle, np.zeros((probe_ticks, 2)), np.ones(probe_ticks, bool))
        self._done = np.zeros(num_envs, bool)
        self._way = np.zeros((num_envs, probe_ticks + 1, 4))
        self.scenes: tuple[Scene, ...] = ()
        self.fleet: Fleet = fleet_of(num_envs)
        self.machines: Machines
        self.tasks: Tasks  # the first is the test print, the others are the scenes' paths

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode in every row; with a seed, draw new scenes."""
        super().reset(seed=seed)
        if seed is not None or not self.scenes:
            self.use([draw_scene(self.np_random, self.printer, *self._drawn_from) for _ in range(self._count)])
        self._begin(np.arange(self.num_envs), np.arange(self.num_envs) % len(self.scenes))
        self._done[:] = False
        return self._observe(), self._info()

    def use(self, scenes: list[Scene]) -> None:
        """Play on these scenes from the next `reset` without a seed on."""
        self.scenes = tuple(scenes)
        self.machines = machines_of([scene.mechanism for scene in scenes], self.printer)
        self.tasks = tasks_of([self._test_print, *(scene.layer for scene in scenes)])
        self._naive, self._gain = np.array([[scene.naive_steps, scene.gain_steps] for scene in scenes]).T
        paths = [scene.layer.nominal_steps for scene in scenes]
        self._paths = np.stack(paths).astype(np.float32)

    def step(
        self, actions: np.ndarray
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Command one control [N, 2] to every machine."""
        controls = np.asarray(actions, np.int64) - C_MAX
        over, reward, ended = self._done, np.empty(self.num_envs), np.empty(self.num_envs, bool)
        probing, first = self._probing & ~over, ~self._probing & (self.fleet.tick == 0) & ~over
        kernels.advance(controls, over, self.machines, self.tasks, self.fleet, self._dense, reward, ended)
        kernels.follow(probing, self.fleet, self._way)
        naive, gain = self._naive[self.fleet.machine], self._gain[self.fleet.machine]
        done = ended & ~probing
        reward = np.where(probing | over, 0.0, (reward + naive * (first if self._dense else done)) / gain)
        if over.any():
            rows = np.flatnonzero(over)
            self._begin(rows, self.np_random.integers(len(self.scenes), size=len(rows)))
        if (scanned := ended & probing).any():
            self._scan_of(np.flatnonzero(scanned))
        self._done = done
        return self._observe(), reward, done.copy(), np.zeros(self.num_envs, bool), self._info()

    def printed_steps(self) -> np.ndarray:
        """Return where each nozzle is [N, 2], full steps: for spectators; no agent sees it."""
        out = np.empty((self.num_envs, 2))
        kernels.where(self.fleet, out)
        return out

    @property
    def _probing(self) -> np.ndarray:
        return self.fleet.task == 0

    def _begin(self, rows: np.ndarray, scenes: np.ndarray) -> None:
        """Begin episodes: the machines of these scenes stand in the middle of the bed."""
        self.fleet.machine[rows], self.fleet.task[rows] = scenes, 0
        kernels.restart(rows, self.machines, self.tasks, self.fleet)
        self._way[rows, 0] = np.tile(self._test_print.start_steps, 2)
        shape = (self.num_envs, *self.single_observation_space["scan"].shape)  # type: ignore[index]
        scan = np.zeros(shape, np.float32)
        if len(rows) < self.num_envs:
            scan[:] = self._scan
            scan[rows] = 0.0
        self._show(scan)

    def _scan_of(self, rows: np.ndarray) -> None:
        """Show these rows the scan of their test prints, and put their machines where their paths start."""
        nominal, printed = self._way[rows, :, :2], self._way[rows, :, 2:]
        noise = self.np_random.normal(0.0, 1.0, printed.shape) * self._noise_steps
        scan = self._scan.copy()
        scan[rows] = np.concatenate([nominal, printed + noise - nominal], axis=2)
        self.fleet.task[rows] = 1 + self.fleet.machine[rows]
        kernels.restart(rows, self.machines, self.tasks, self.fleet)
        self._show(scan)

    def _show(self, scan: np.ndarray) -> None:
        """Let observations have a new scan [N, P + 1, 4], and the paths that belong to it."""
        path = self._paths[self.fleet.machine]
        for array in (scan, path):
            array.setflags(write=False)
        self._scan, self._path = scan, path

    def _observe(self) -> dict[str, np.ndarray]:
        now = np.empty((self.num_envs, 8 + 2 * _LOOKAHEAD), np.float32)
        kernels.observe(self.tasks, self.fleet, _LOOKAHEAD, now)
        phase, tick = np.where(self._probing, TEST_PRINT, PRINT), self.fleet.tick[:, None].copy()
        return {"phase": phase, "tick": tick, "now": now, "path": self._path, "scan": self._scan}

    def _info(self) -> dict[str, Any]:
        """Return each scene's RMSE for a score of 0 and of 1 [full steps]."""
        scenes = self.fleet.machine
        return {"naive_steps": self._naive[scenes], "optimum_steps": self._naive[scenes] - self._gain[scenes]}


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
