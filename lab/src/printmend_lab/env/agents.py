"""Agents to measure others against.

For `Print-v0`: random, Naive, and two that know the true machine. Each is a function of observations [N, D] that
returns actions [N, 2] for `PrintVectorEnv`; `PrintEnv` takes row 0. Algorithm 1 (the paper's Oracle) takes the control
whose result is nearest to the next target. If the play of a belt is more than one control takes up, no control changes
anything. Then the first of the 49 wins, and the motor never gets through its play (physics.md §6). With loose belts
that is far worse than commanding the path as it is. `planning_agent` knows the same machine and takes up the play ahead
of the next move.

For the one-print environments: Naive, and a learner with a controller. Both know nothing but observations. Each is a
function of observations (a dictionary of arrays, a row a machine) that returns actions [N, 2] for `OnePrintVectorEnv`;
`score_agent` runs one.
"""

from collections.abc import Callable

import numpy as np

from printmend.learn.mechanism_model import MechanismModel
from printmend.learn.registry import fitted
from printmend.learn.registry import learner as learner_of
from printmend.machine import Mechanism
from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.control.lookahead import Lookahead
from printmend_lab.control.registry import controller as controller_of
from printmend_lab.env import kernels
from printmend_lab.env.one_print_env import KEPT_SEED, PRINT, OnePrintVectorEnv
from printmend_lab.env.print_env import C_MAX, PrintEnv, PrintVectorEnv
from printmend_lab.protocols import Controller
from printmend_lab.sampling import Severity

Agent = Callable[[np.ndarray], np.ndarray]


def random_agent(rng: np.random.Generator) -> Agent:
    """Return an agent that commands anything."""
    return lambda observation: rng.integers(0, 2 * C_MAX + 1, (len(observation), 2))


def naive_agent(observation: np.ndarray) -> np.ndarray:
    """Assume a healthy machine: command what brings the nominal position to the next target."""
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


OneAgent = Callable[[dict[str, np.ndarray]], np.ndarray]
Plan = Callable[[np.ndarray, np.ndarray], np.ndarray]
_LEAST_STEPS = 230  # of the test print along each axis: somewhat more than a motor's turn on the presets


def probing_controls(ticks: int, path: np.ndarray, start: np.ndarray, bed_steps: np.ndarray) -> np.ndarray:
    """Return controls [ticks, 2] of a test print from ``start`` [2], for a ``path`` [N, 2] that is printed afterwards.

    Each axis goes to the path by the shortest way. Then it goes to and fro over the path's width, or over a turn of the
    motor if that is wider, as slowly as still brings it back once.
    """
    controls = np.zeros((ticks, 2), np.int64)
    for axis in range(2):
        low, high = float(path[:, axis].min()), float(path[:, axis].max())
        wider = max(_LEAST_STEPS - (high - low), 0.0) / 2
        low, high = max(low - wider, 0.0), min(high + wider, float(bed_steps[axis]))
        near, far = sorted((low, high), key=lambda end: abs(end - start[axis]))
        there = int(np.ceil(abs(near - start[axis]) / C_MAX))
        speed = np.clip(np.ceil(2 * (high - low) / max(ticks - there, 1)), 1, C_MAX)
        leg = max((high - low) / speed, 1.0)
        back = np.abs((np.arange(max(ticks - there, 0)) / leg + 1) % 2 - 1)  # 0 at the near end, 1 at the far one
        places = np.concatenate([np.linspace(start[axis], near, there + 1), near + (far - near) * back])[: ticks + 1]
        # Round halves up: rounding to even would turn some steps of three into four.
        controls[:, axis] = np.clip(np.diff(np.floor(places + 0.5)), -C_MAX, C_MAX)
    return controls


def one_naive_agent(observation: dict[str, np.ndarray]) -> np.ndarray:
    """Assume a healthy machine: whatever the scan says, command the path as it is."""
    return np.clip(observation["now"][:, 8:10], -C_MAX, C_MAX).astype(np.int64) + C_MAX


def learning_agent(learner: str, printer: Printer, *, controller: str = "optimal") -> OneAgent:
    """Return an agent that prints `probing_controls`, learns from the scan, plans the path and follows the plan."""
    learns, plans = learner_of(learner), controller_of(controller)
    low_mm, pitch_mm = np.array([printer.x.min_mm, printer.y.min_mm]), np.array(printer.mm_per_step)

    def plan(path: np.ndarray, scan: np.ndarray) -> np.ndarray:
        commanded, beside = np.split(scan, 2, axis=1)
        trace = Trace(low_mm + commanded * pitch_mm, low_mm + (commanded + beside) * pitch_mm)
        model = fitted(learns, trace, printer, rng=np.random.default_rng(0))
        return plans.plan(model, path[1:], path[0].astype(int), c_max=C_MAX).controls

    return open_loop_agent(plan, printer)


def open_loop_agent(plan: Plan, printer: Printer) -> OneAgent:
    """Return an agent that prints `probing_controls`, and then the controls that ``plan`` returns for a path and a
    scan.

    ``plan`` takes the path [T + 1, 2] and the scan [P + 1, 4] of an observation as float64 and returns controls [T, 2].
    """
    bed = np.array(printer.bed_steps)
    chosen: dict[int, np.ndarray] = {}  # of each row: the controls of the test print, or of the print

    def act(observation: dict[str, np.ndarray]) -> np.ndarray:
        ticks, controls = observation["tick"][:, 0], np.zeros((len(observation["tick"]), 2), np.int64)
        for n, tick in enumerate(ticks.tolist()):
            if tick == 0:
                path, scan = (observation[name][n].astype(float) for name in ("path", "scan"))
                if observation["phase"][n] == PRINT:
                    chosen[n] = plan(path, scan)
                else:
                    chosen[n] = probing_controls(len(scan) - 1, path, observation["now"][n, :2], bed)
            if tick < len(chosen[n]):  # the step after an episode's end does nothing
                controls[n] = chosen[n][tick]
        return controls + C_MAX

    return act


def score_agent(
    agent: OneAgent, family: str, severity: Severity = "damaged", *, scenes: int = 32, seed: int = KEPT_SEED
) -> np.ndarray:
    """Return the agent's score on each of the scenes [scenes]; without a ``seed``, on the kept ones."""
    env = OnePrintVectorEnv(scenes, family=family, severity=severity, scenes=scenes)
    observation, _ = env.reset(seed=seed)
    score, done = np.zeros(scenes), np.zeros(scenes, bool)
    while not done.all():
        observation, reward, done, _, _ = env.step(agent(observation))
        score += reward
    return score
