"""Train two agents for the paper's problem, and set them beside Naive and the grey box on scenes kept from training.

pip install 'printmend-lab[agents]' && python examples/train_one_print.py --family play

`PPO` (of skrl) learns by trying: at every tick it says how far beside the next target to aim, knowing what the scan
says about that place. `GRU` is recurrent: it reads the whole scan, then the path, and is taught to say what the optimal
plan on the true machine would. Both train on thousands of simulated machines of the family; a learner with a controller
needs none. In training they see what a simulator knows; when they are scored, only what the environment shows.
"""

import argparse
from collections.abc import Iterator

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import optax
from flax import linen
from train_agent import Policy, train

from printmend.learn.mechanism_model import MechanismModel
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from printmend_lab.control.optimal import Optimal
from printmend_lab.env import OnePrintVectorEnv, learning_agent, one_naive_agent, open_loop_agent, score_agent
from printmend_lab.env.agents import probing_controls
from printmend_lab.env.fleet import draw_scene

PROBE_TICKS, TICKS, NOISE_MM = 600, 500, 0.05  # as in the registered environments
C_MAX = 3
FARTHEST_STEPS, HASTE = 10.0, 0.5  # of PPO's aims beside the targets, and of changing them
NEAR_STEPS = 8.0  # of a place, in which the scan says something about it
SECOND = 2  # the GRU reads every second row of a scan
WIDTH = 96  # of its memory


def ways(places: np.ndarray) -> np.ndarray:
    """Return which way [N, 2] each axis moved last on its way [N, 2] to each place, 0 before it moves."""
    way = np.sign(np.diff(places, axis=0, prepend=places[:1]))
    last = np.maximum.accumulate(np.where(way != 0, np.arange(len(way))[:, None], 0), axis=0)
    return np.take_along_axis(way, last, axis=0)


def scanned_about(path: np.ndarray, scan: np.ndarray) -> np.ndarray:
    """Return what a scan says about each place of a path [T + 1, 2], going up and going down: [T + 1, 4], less what it
    says about the path's start, where the belts lie in the middle of their play."""
    places, beside, moved, out = scan[:, :2], scan[:, 2:], ways(scan[:, :2]), np.empty((len(path), 4))
    for axis in range(2):
        for k, way in enumerate((1, -1)):
            mine = moved[:, axis] == way
            away = (path[:, None, axis] - places[None, mine, axis]) / NEAR_STEPS
            weight = np.exp(-(away**2)) + 1e-9
            out[:, 2 * axis + k] = (weight * beside[mine, axis]).sum(axis=1) / weight.sum(axis=1)
        out[:, 2 * axis : 2 * axis + 2] -= out[0, 2 * axis : 2 * axis + 2].mean()
    return out


def followed(aims: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return the controls [T, 2] that follow aims [T, 2] from a start as nearly as motors can."""
    controls, at = np.empty((len(aims), 2), np.int64), start.astype(np.int64)
    for t, aim in enumerate(np.rint(aims).astype(np.int64)):
        controls[t] = np.clip(aim - at, -C_MAX, C_MAX)
        at = at + controls[t]
    return controls


def shown(path: np.ndarray, about: np.ndarray) -> np.ndarray:
    """Return what PPO knows at every tick [T, 8]: the scan about its target, and which way the axes move next."""
    ahead = np.sign(path[np.minimum(np.arange(1, len(path)) + 4, len(path) - 1)] - path[:-1])
    return np.concatenate([about[1:] / FARTHEST_STEPS, ahead, ways(path)[1:]], axis=1).astype(np.float32)


class AimEnv(gymnasium.vector.VectorEnv):
    """The print of `OnePrintVectorEnv`; the test print is done by itself. An action in −1…1 is how far beside the next
    target to aim; the reward is minus the distance from the target, as a share of what Naive misses it by."""

    metadata = {"autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}  # noqa: RUF012 - Gymnasium's own way

    def __init__(self, family: str, count: int, scenes: int) -> None:
        self.num_envs = count
        self.env = OnePrintVectorEnv(count, family=family, scenes=scenes)
        self.single_observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (10,), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, count)
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, count)

    def reset(self, *, seed=None, options=None):
        observation, info = self.env.reset(seed=seed)
        self._probe(observation, info)
        return self._seen(0), {}

    def _probe(self, observation, info) -> None:
        bed = np.array(self.env.printer.bed_steps)
        starts = observation["now"][:, :2]
        tests = np.stack([probing_controls(PROBE_TICKS, path, start, bed)
                          for path, start in zip(observation["path"], starts, strict=True)])  # fmt: skip
        for t in range(PROBE_TICKS):
            observation, *_ = self.env.step(tests[:, t] + C_MAX)
        pairs = zip(observation["path"].astype(float), observation["scan"].astype(float), strict=True)
        self.path, self.naive = observation["path"], info["naive_steps"]
        self.known = np.stack([shown(path, scanned_about(path, scan)) for path, scan in pairs])
        self.aside, self.tick, self.over = np.zeros((self.num_envs, 2)), 0, False
        self.at = self.path[:, 0].copy()

    def step(self, actions):
        none = np.zeros(self.num_envs)
        if self.over:  # all prints are equally long
            observation, *_, info = self.env.step(np.zeros((self.num_envs, 2), int))
            self._probe(observation, info)
            return self._seen(0), none, none > 0, none > 0, {}
        self.aside += HASTE * (FARTHEST_STEPS * np.clip(actions, -1, 1) - self.aside)
        target = self.path[:, self.tick + 1]
        controls = np.clip(np.rint(target + self.aside - self.at), -C_MAX, C_MAX)
        self.at += controls
        _, _, done, cut, _ = self.env.step(controls.astype(np.int64) + C_MAX)
        reward = -np.hypot(*(self.env.printed_steps() - target).T) / self.naive
        self.tick, self.over = self.tick + 1, bool(done.all())
        return self._seen(min(self.tick, TICKS - 1)), reward, done, cut, {}

    def _seen(self, tick: int) -> np.ndarray:
        return np.concatenate([self.known[:, tick], self.aside / FARTHEST_STEPS], axis=1).astype(np.float32)


def ppo_plan(policy: Policy):
    """Return the plan of a trained policy for `open_loop_agent`."""
    mean = jax.jit(lambda seen: policy.apply(policy.state_dict.params, {"observations": seen}, "policy")[0])

    def plan(path: np.ndarray, scan: np.ndarray) -> np.ndarray:
        known, aside, aims = shown(path, scanned_about(path, scan)), np.zeros(2), np.empty((len(path) - 1, 2))
        for t, seen in enumerate(known):
            action = np.asarray(mean(np.concatenate([seen, aside / FARTHEST_STEPS])[None].astype(np.float32)))[0]
            aside = aside + HASTE * (FARTHEST_STEPS * np.clip(action, -1, 1) - aside)
            aims[t] = path[t + 1] + aside
        return followed(aims, path[0])

    return plan


class Reader(linen.Module):
    """Reads a scan and then a path, row by row, both ways along; says at each row how far beside it to aim."""

    @linen.compact
    def __call__(self, rows: jax.Array) -> jax.Array:
        hidden = linen.RNN(linen.GRUCell(WIDTH))(linen.tanh(linen.Dense(WIDTH)(rows)))
        return linen.Dense(2, kernel_init=linen.initializers.zeros)(linen.tanh(linen.Dense(WIDTH)(hidden)))


def rows_of(path: np.ndarray, scan: np.ndarray, printer: Printer) -> tuple[np.ndarray, float]:
    """Return what the GRU reads [R, 14] of a scan and a path, and the size of the scan's errors, by which it counts."""
    size = float(np.sqrt((scan[:, 2:] ** 2).mean())) + 1e-3
    turn = np.array([printer.x.steps_per_turn, printer.y.steps_per_turn])

    def part(places: np.ndarray, beside: np.ndarray, printing: float) -> np.ndarray:
        phase = 2 * np.pi * places / turn
        ahead = places[np.minimum(np.arange(len(places)) + 4, len(places) - 1)] - places
        columns = [beside, np.sin(phase), np.cos(phase), (places - path[0]) / 300.0, ways(places), np.sign(ahead)]
        flags = np.tile([printing, np.log(size)], (len(places), 1))
        return np.concatenate([*columns, flags], axis=1)

    read = part(scan[:, :2], scan[:, 2:] / size, 0.0)[::SECOND]
    asked = part(path, np.zeros_like(path), 1.0)[1:]
    return np.concatenate([read, asked]).astype(np.float32), size


def lessons(family: str, count: int, printer: Printer, rng: np.random.Generator) -> Iterator[tuple]:
    """Yield rows [R, 14] and what to say of the path's [T, 2], for machines of a family."""
    middle, bed = np.array(printer.bed_steps) // 2, np.array(printer.bed_steps)
    for _ in range(count):
        scene = draw_scene(rng, printer, family, "damaged", TICKS)
        path, twin = scene.layer.nominal_steps.astype(float), Twin(scene.mechanism)
        test = probing_controls(PROBE_TICKS, path, middle, bed)
        commanded = middle + np.concatenate([[[0, 0]], np.cumsum(test, axis=0)])
        noise = rng.normal(0, NOISE_MM, commanded.shape) / np.array(printer.mm_per_step)
        scan = np.concatenate([commanded, twin.run(test, middle) - commanded + noise], axis=1)
        plan = Optimal().plan(MechanismModel(scene.mechanism), path[1:], scene.layer.start_steps)
        rows, size = rows_of(path, scan, printer)
        yield rows, ((path[0] + np.cumsum(plan.controls, axis=0, dtype=float) - path[1:]) / size).astype(np.float32)


def taught(family: str, machines: int, epochs: int, printer: Printer, *, seed: int, batch: int = 64):
    """Teach the GRU; return its plan for `open_loop_agent`."""
    rng = np.random.default_rng(seed)
    rows, said = map(np.stack, zip(*lessons(family, machines, printer, rng), strict=True))
    reader = Reader()
    weights = reader.init(jax.random.key(seed), rows[:1])
    steps = epochs * (machines // batch)
    rule = optax.chain(optax.clip_by_global_norm(1.0), optax.adam(optax.cosine_decay_schedule(3e-3, steps)))

    def loss(weights, rows, said):
        return optax.huber_loss(reader.apply(weights, rows)[:, -TICKS:], said).mean()

    @jax.jit
    def learn(weights, state, rows, said):
        value, slope = jax.value_and_grad(loss)(weights, rows, said)
        change, state = rule.update(slope, state)
        return optax.apply_updates(weights, change), state, value

    state = rule.init(weights)
    for epoch in range(epochs):
        order, values = rng.permutation(machines), []
        for at in range(0, machines - batch + 1, batch):
            some = order[at : at + batch]
            weights, state, value = learn(weights, state, jnp.asarray(rows[some]), jnp.asarray(said[some]))
            values.append(float(value))
        print(f"GRU, epoch {epoch + 1} of {epochs}: loss {np.mean(values):.4f}", flush=True)
    say = jax.jit(lambda rows: reader.apply(weights, rows[None])[0, -TICKS:])

    def plan(path: np.ndarray, scan: np.ndarray) -> np.ndarray:
        rows, size = rows_of(path, scan, printer)
        return followed(path[1:] + size * np.asarray(say(rows), float), path[0])

    return plan


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--family", default="play")
    parser.add_argument("--steps", type=int, default=8000, help="of 64 prints side by side, for PPO")
    parser.add_argument("--machines", type=int, default=2048, help="that the GRU is taught on")
    parser.add_argument("--epochs", type=int, default=12, help="of teaching the GRU")
    parser.add_argument("--scenes", type=int, default=32, help="kept ones, that all are scored on")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    printer, family = read_printer("ender5"), options.family
    policy = train(AimEnv(family, 64, 512), options.steps, seed=options.seed)
    reads = taught(family, options.machines, options.epochs, printer, seed=options.seed + 1)
    agents = {
        "Naive": one_naive_agent,
        "PPO": open_loop_agent(ppo_plan(policy), printer),
        "GRU": open_loop_agent(reads, printer),
        "greybox": learning_agent("greybox", printer),
        "meta": learning_agent("meta", printer),
    }
    for name, agent in agents.items():
        found = score_agent(agent, family, scenes=options.scenes)
        print(f"{name:10} mean {found.mean():6.3f}  median {np.median(found):6.3f}  worst {found.min():7.3f}")
