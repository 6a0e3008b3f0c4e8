"""Train an agent by reinforcement learning (PPO of skrl) for the shape of a print, and set it beside planning.

pip install 'printmend-lab[agents]' && python examples/train_agent.py

One machine: both pulleys off their bore, both belts with play. The loss is of the shape: how far a printed point lies
from the line about it; being early or late along the line costs nothing, which no sum over time-stamped targets says.
The agent learns by trying: at every tick it says how far beside the next target to aim, and is told how far off that
printed, which on a real machine would be a sensor that watches every step. Planning needs one printed layer.
"""

import argparse
from collections.abc import Sequence

import gymnasium
import jax
import numpy as np
from flax import linen
from skrl import config
from skrl.agents.jax.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.jax import wrap_env
from skrl.memories.jax import RandomMemory
from skrl.models.jax import DeterministicMixin, GaussianMixin, Model
from skrl.trainers.jax import SequentialTrainer
from skrl.utils import set_seed

from printmend.corruption import Corruption, Drive, EccentricBore, Play
from printmend.learn.mechanism_model import MechanismModel
from printmend.learn.registry import fit
from printmend.metrics import rmse
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend_lab.control.area import LeastArea
from printmend_lab.control.optimal import Optimal
from printmend_lab.env import PrintVectorEnv, random_layer
from printmend_lab.path import Layer
from printmend_lab.published import layer_trace

MACHINE = Corruption((Drive(pulley=EccentricBore(0.3), belt=Play(0.8)), Drive(pulley=EccentricBore(0.2, 2.0),
                                                                              belt=Play(0.6))))  # fmt: skip
FARTHEST_STEPS = 6.0  # that the agent may aim beside a target
HASTE = 0.3  # share of the way to a new aim that a tick goes: tries that jump about would shake the play, not cross it
ABOUT = 8  # ticks before and after, in which a printed point may lie on the line
TICKS, AHEAD = 500, 6
LESSON_TICKS = 2000  # of the layer that the planner's model is learned from
C_MAX = 3


class ShapeEnv(gymnasium.vector.VectorEnv):
    """`PrintVectorEnv` on one machine: an action [N, 2] in −1…1 is how far beside the targets to aim, over
    `FARTHEST_STEPS`; the reward is minus the distance of the printed point from the line about that target."""

    metadata = {"autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}  # noqa: RUF012 - Gymnasium's own way

    def __init__(self, count: int, *, layers: Sequence[Layer] | None = None) -> None:
        self.num_envs = count
        self.env = PrintVectorEnv(
            count, corruption=lambda _: MACHINE, machines=1, layers=layers, ticks=TICKS, lookahead=AHEAD
        )
        self.single_observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (14 + 2 * AHEAD,), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, count)
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, count)
        self.turn_steps = np.array([axis.steps_per_turn for axis in (self.env.printer.x, self.env.printer.y)])

    def reset(self, *, seed=None, options=None):
        self.seen, _ = self.env.reset(seed=seed)
        self.aside = np.zeros((self.num_envs, 2))
        return self._features(), {}

    def step(self, actions):
        fleet, tasks = self.env.fleet, self.env.tasks
        job, tick = fleet.task.copy(), fleet.tick.copy()
        self.aside += HASTE * (FARTHEST_STEPS * np.clip(actions, -1, 1) - self.aside)
        controls = np.rint(self.seen[:, 8:10] + self.aside)
        self.seen, _, done, cut, info = self.env.step(np.clip(controls, -C_MAX, C_MAX).astype(np.int64) + C_MAX)
        self.aside[done] = 0.0
        about = np.clip(tick[:, None] + np.arange(-ABOUT, ABOUT + 1), 0, TICKS - 1)
        lines = tasks.targets[job[:, None], about].astype(float)
        return self._features(), -_distance(fleet.position, lines), done, cut, info

    def _features(self) -> np.ndarray:
        seen = self.seen
        targets = seen[:, 8:].reshape(len(seen), AHEAD, 2)
        aimed = seen[:, :2] + seen[:, 2:4] + targets[:, 0]
        # of the pulleys, here and where the layer began: there the belts lay where they should
        phase = 2 * np.pi * np.concatenate([aimed, seen[:, :2]], axis=1) / np.tile(self.turn_steps, 2)
        way = (targets[:, 1:] - targets[:, :1]).reshape(len(seen), -1) / AHEAD
        parts = [
            seen[:, 6:8],
            self.aside / FARTHEST_STEPS,
            targets[:, 0] / FARTHEST_STEPS,
            np.sin(phase),
            np.cos(phase),
            way,
            seen[:, 4:6] / C_MAX,
        ]
        return np.concatenate(parts, axis=1).astype(np.float32)


def _distance(points: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Return how far each point [N, 2] lies from its own polyline [N, M, 2]."""
    begin, along = lines[:, :-1], np.diff(lines, axis=1)
    away = points[:, None] - begin
    length = np.maximum((along**2).sum(axis=2), 1e-12)
    share = np.clip((away * along).sum(axis=2) / length, 0, 1)
    return np.hypot(*np.moveaxis(away - share[..., None] * along, 2, 0)).min(axis=1)


class Policy(GaussianMixin, Model):
    def __init__(self, observation_space, action_space, **more):
        Model.__init__(self, observation_space=observation_space, action_space=action_space, **more)
        GaussianMixin.__init__(self, clip_actions=False)

    @linen.compact
    def __call__(self, inputs, role):
        hidden = inputs["observations"]
        for _ in range(2):
            hidden = linen.tanh(linen.Dense(64)(hidden))
        mean = linen.Dense(self.num_actions, kernel_init=linen.initializers.orthogonal(0.01))(hidden)
        return mean, {"log_std": self.param("log_std", lambda _: -1.0 * np.ones(self.num_actions, np.float32))}


class Value(DeterministicMixin, Model):
    def __init__(self, observation_space, action_space, **more):
        Model.__init__(self, observation_space=observation_space, action_space=action_space, **more)
        DeterministicMixin.__init__(self)

    @linen.compact
    def __call__(self, inputs, role):
        hidden = inputs["observations"]
        for _ in range(2):
            hidden = linen.tanh(linen.Dense(64)(hidden))
        return linen.Dense(1)(hidden), {}


def train(prints: gymnasium.vector.VectorEnv, steps: int, *, seed: int = 0, rollouts: int = 64) -> Policy:
    """Train for so many steps of prints side by side; return the policy."""
    config.jax.backend = "jax"
    set_seed(seed)
    env, count = wrap_env(prints, wrapper="gymnasium", verbose=False), prints.num_envs
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space}
    models = {"policy": Policy(**spaces), "value": Value(**spaces)}
    for role, model in models.items():
        model.init_state_dict(role=role)
    cfg = PPO_CFG(
        rollouts=rollouts, learning_epochs=4, mini_batches=4, discount_factor=0.9, gae_lambda=0.9, learning_rate=1e-3,
        entropy_loss_scale=0.0, value_loss_scale=0.5, value_clip=0.0,
    )  # fmt: skip
    cfg.experiment.write_interval = cfg.experiment.checkpoint_interval = 0
    agent = PPO(models=models, memory=RandomMemory(memory_size=rollouts, num_envs=count), cfg=cfg, **spaces)
    SequentialTrainer(
        env=env,
        agents=agent,
        cfg={"timesteps": steps, "headless": True, "disable_progressbar": True, "close_environment_at_exit": False},
    ).train()
    return models["policy"]


def compare(policy: Policy, *, count: int = 12, seed: int = 77) -> dict[str, tuple[float, float]]:
    """Return for each way (mean distance from the line about, RMSE), in full steps, over paths kept from training."""
    printer, rng = read_printer("ender5"), np.random.default_rng(seed)
    twin = Twin.of(MACHINE, printer)
    kept, lesson = [random_layer(rng, printer, TICKS) for _ in range(count)], random_layer(rng, printer, LESSON_TICKS)
    trace = layer_trace(lesson, twin.run(lesson.controls, lesson.start_steps), printer)
    models = {
        "learned from one layer": fit("greybox", trace, printer, rng=rng),
        "true machine": MechanismModel(twin.mechanism),
    }
    prints = {"Naive": [twin.run(layer.controls, layer.start_steps) for layer in kept],
              "agent": played(policy, kept)}  # fmt: skip
    for name, model in models.items():
        for planner in (Optimal(), LeastArea()):
            plans = [planner.plan(model, layer.nominal_steps[1:], layer.start_steps) for layer in kept]
            prints[f"{planner.name}, {name}"] = [
                twin.run(plan.controls, layer.start_steps) for plan, layer in zip(plans, kept, strict=True)
            ]
    lines = [layer.nominal_steps.astype(float) for layer in kept]
    return {
        name: (np.mean([shape_error(*pair) for pair in zip(lines, made, strict=True)]),
               rmse(np.concatenate(lines), np.concatenate(made)))
        for name, made in prints.items()
    }  # fmt: skip


def played(policy: Policy, layers: list[Layer]) -> list[np.ndarray]:
    """Return what the agent prints [T + 1, 2] of each layer."""
    aim = jax.jit(lambda seen: policy.apply(policy.state_dict.params, {"observations": seen}, "policy")[0])
    prints = []
    for layer in layers:
        env = ShapeEnv(1, layers=[layer])
        seen, _ = env.reset(seed=0)
        printed = [env.env.fleet.position[0].copy()]
        for _ in range(TICKS):
            seen, *_ = env.step(np.asarray(aim(seen)))
            printed.append(env.env.fleet.position[0].copy())
        prints.append(np.array(printed))
    return prints


def shape_error(line: np.ndarray, printed: np.ndarray) -> float:
    """Return the mean distance of printed points [T + 1, 2] from the line [T + 1, 2] about them."""
    about = np.clip(np.arange(len(line))[:, None] + np.arange(-ABOUT, ABOUT + 1), 0, len(line) - 1)
    return float(_distance(printed, line[about]).mean())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=5000, help="of 64 prints side by side")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    found = compare(train(ShapeEnv(64), options.steps, seed=options.seed))
    for name, (shape, error) in found.items():
        print(f"{name:40} {shape:6.3f} steps from the line, RMSE {error:6.3f}")
