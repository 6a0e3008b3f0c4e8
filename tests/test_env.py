"""The reinforcement-learning environments: Gymnasium's checker, the twin's exact world, laws of the reward."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from printmend.corruption import HEALTHY
from printmend.errors import ConfigError
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from printmend_lab.env import (
    PrintEnv,
    PrintVectorEnv,
    algorithm1_agent,
    naive_agent,
    random_agent,
    random_layer,
)
from printmend_lab.path import Layer
from printmend_lab.sampling import sample


def played(env: PrintEnv, actions: np.ndarray, seed: int) -> tuple[float, dict]:
    env.reset(seed=seed)
    total, info, done = 0.0, {}, False
    for action in actions:
        assert not done
        _, reward, done, _, info = env.step(action)
        total += reward
    assert done
    return total, info


@pytest.mark.parametrize("reward", ["final", "dense"])
def test_gymnasium_accepts_it(reward: str) -> None:
    env = gymnasium.make("printmend/Print-v0", reward=reward, ticks=40).unwrapped
    check_env(env)


@pytest.mark.parametrize("family", ["pulley-loose", "everything", "frame", "set-screw"])
@pytest.mark.parametrize("name", ["ender5", "corexy"])
def test_return_is_minus_the_twins_rmse(family: str, name: str, rng: np.random.Generator) -> None:
    """The environment's world is the twin's, whatever is broken; both rewards have the same return."""
    printer = read_printer(name)
    corruption = sample(family, rng)
    layer = random_layer(rng, printer, 200)
    controls = rng.integers(-3, 4, (200, 2))
    printed = Twin.of(corruption, printer).run(controls, layer.start_steps)
    rmse = np.sqrt(((printed - layer.nominal_steps) ** 2).sum(axis=1).mean())
    for reward in ("final", "dense"):
        env = PrintEnv(printer=printer, corruption=lambda _: corruption, layers=[layer], reward=reward)
        total, info = played(env, controls + 3, seed=1)
        assert total == pytest.approx(-rmse, abs=1e-9)
        assert info["rmse_steps"] == pytest.approx(rmse, abs=1e-9)


def test_naive_is_perfect_on_a_healthy_machine(printer: Printer) -> None:
    env = PrintVectorEnv(8, printer=printer, corruption=lambda _: HEALTHY, ticks=120, machines=2, paths=8)
    observation, _ = env.reset(seed=3)
    for _ in range(120):
        observation, reward, done, _, _ = env.step(naive_agent(observation))
    assert done.all()
    assert np.array_equal(reward, np.zeros(8))


def test_vector_equals_single(rng: np.random.Generator) -> None:
    corruption = sample("pulley-loose", rng)
    layer = random_layer(rng, read_printer("ender5"), 60)
    single = PrintEnv(corruption=lambda _: corruption, layers=[layer], reward="dense")
    vector = PrintVectorEnv(3, corruption=lambda _: corruption, layers=[layer], reward="dense", machines=1)
    one, _ = single.reset(seed=0)
    many, _ = vector.reset(seed=0)
    actions = rng.integers(0, 7, (60, 2))
    for action in actions:
        assert np.array_equal(np.broadcast_to(one, many.shape), many)
        one, reward, done, _, _ = single.step(action)
        many, rewards, dones, _, _ = vector.step(np.tile(action, (3, 1)))
        assert np.array_equal(rewards, np.full(3, reward))
        assert dones.all() == done


def test_vector_restarts_at_the_next_step() -> None:
    env = PrintVectorEnv(4, ticks=10, machines=3, paths=3, reward="dense")
    observation, _ = env.reset(seed=5)
    assert env.observation_space.contains(observation)
    for _ in range(10):
        observation, _, done, _, _ = env.step(np.full((4, 2), 6))
    assert done.all()
    observation, reward, done, _, _ = env.step(np.full((4, 2), 6))
    assert not done.any()
    assert np.array_equal(reward, np.zeros(4))
    assert np.array_equal(observation[:, 2:8], np.zeros((4, 6)))
    assert np.array_equal(env.fleet.tick, np.zeros(4))


def test_seeds_repeat() -> None:
    def run(seed: int) -> np.ndarray:
        env = PrintVectorEnv(5, ticks=20, machines=4, paths=4, reward="dense")
        observation, _ = env.reset(seed=seed)
        agent = random_agent(np.random.default_rng(1))
        return np.array([env.step(agent(observation))[1] for _ in range(50)])

    assert np.array_equal(run(7), run(7))
    assert not np.array_equal(run(7), run(8))


def test_commands_beyond_the_tables_stop_there() -> None:
    env = PrintEnv(ticks=2000)
    env.reset(seed=0)
    for _ in range(1500):
        observation, *_ = env.step(np.array([6, 0]))
    assert env.observation_space.contains(observation)
    assert env.fleet.nominal.tolist() == [[2200, -1100]]


def test_algorithm_1_beats_naive_beats_random() -> None:
    returns = {}
    for name in ("random", "naive", "algorithm 1"):
        env = PrintVectorEnv(32, ticks=300, machines=6, paths=8, corruption=lambda rng: sample("pulley", rng))
        observation, _ = env.reset(seed=11)
        agents = {"random": random_agent(np.random.default_rng(0)), "naive": naive_agent}
        agent = agents.get(name) or algorithm1_agent(env)
        for _ in range(300):
            observation, reward, _, _, _ = env.step(agent(observation))
        returns[name] = reward.mean()
    assert returns["algorithm 1"] > -2.0
    assert returns["algorithm 1"] > returns["naive"] > returns["random"]


def test_algorithm_1_is_the_slow_search(rng: np.random.Generator) -> None:
    """Each chosen control is the first of the 49 that prints nearest to its target, tried on the twin."""
    printer = read_printer("corexy")
    corruption = sample("everything", rng)
    layer = random_layer(rng, printer, 25)
    env = PrintEnv(printer=printer, corruption=lambda _: corruption, layers=[layer])
    observation, _ = env.reset(seed=0)
    agent, twin, chosen = algorithm1_agent(env), Twin.of(corruption, printer), np.zeros((0, 2), int)
    candidates = [np.array([cx, cy]) for cx in range(-3, 4) for cy in range(-3, 4)]
    for target in layer.nominal_steps[1:]:
        ends = np.array([twin.run(np.vstack([chosen, c]), layer.start_steps)[-1] for c in candidates])
        errors = ((ends - target) ** 2).sum(axis=1)
        action = agent(observation[None])[0]
        mine = errors[int(np.flatnonzero([(c + 3 == action).all() for c in candidates])[0])]
        assert mine == pytest.approx(errors.min(), abs=1e-9)
        observation, *_ = env.step(action)
        chosen = np.vstack([chosen, action - 3])


@pytest.mark.parametrize("ticks", [1, 77, 3000])
def test_random_layers_are_lattice_paths_on_the_bed(ticks: int, rng: np.random.Generator) -> None:
    printer = read_printer("ender3")
    for _ in range(5):
        layer = random_layer(rng, printer, ticks)
        assert layer.transitions == ticks
        assert np.abs(layer.controls).max(axis=1).min() == 1
        assert np.abs(layer.controls).max() == 1
        assert layer.nominal_steps.min() >= 0
        assert (layer.nominal_steps <= printer.bed_steps).all()


def test_short_layers_end_early() -> None:
    layers = [Layer(0, 0.2, [500, 500], np.ones((n, 2)), np.ones(n, bool)) for n in (3, 9)]
    env = PrintVectorEnv(16, layers=layers, machines=1)
    observation, _ = env.reset(seed=2)
    for _ in range(3):
        observation, _, done, _, _ = env.step(naive_agent(observation))
    assert np.array_equal(done, env.tasks.lengths[env.fleet.task] == 3)
    assert 0 < done.sum() < 16


def test_gain_tables_are_refused() -> None:
    with pytest.raises(ConfigError, match="gain table"):
        PrintEnv(corruption=lambda rng: sample("gain-table", rng)).reset(seed=0)
