"""The one-print environments: Gymnasium's checker, the twin's world, a score of 0 for Naive and 1 for the optimum."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from printmend.errors import ConfigError
from printmend.learn.mechanism_model import MechanismModel
from printmend.metrics import rmse
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend_lab.control.optimal import Optimal
from printmend_lab.env import (
    SCENES,
    OnePrintEnv,
    OnePrintVectorEnv,
    learning_agent,
    one_naive_agent,
    probing_controls,
    random_layer,
    score_agent,
)
from printmend_lab.env.fleet import LEAST_GAIN_STEPS, draw_scene

SMALL = {"ticks": 60, "probe_ticks": 40}


def test_every_family_is_registered_and_gymnasium_accepts_one() -> None:
    for severity, families in SCENES.items():
        for family in families:
            assert f"printmend/OnePrint-{family}-{severity}-v1" in gymnasium.registry
    env = gymnasium.make("printmend/OnePrint-play-damaged-v1", render_mode="rgb_array", **SMALL).unwrapped
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*render modes.*")
        check_env(env)


@pytest.mark.parametrize("reward", ["final", "dense"])
def test_naive_scores_nothing_and_the_optimum_one(reward: str) -> None:
    env = OnePrintVectorEnv(6, family="pulley-play", reward=reward, scenes=6, **SMALL)
    for chosen, wanted in (("naive", 0.0), ("optimum", 1.0)):
        observation, info = env.reset(seed=4)
        plans = [
            Optimal().plan(MechanismModel(s.mechanism), s.layer.nominal_steps[1:], s.layer.start_steps).controls
            for s in env.scenes
        ]
        assert (info["naive_steps"] - info["optimum_steps"] >= LEAST_GAIN_STEPS - 1e-9).all()
        score, done = np.zeros(6), np.zeros(6, bool)
        for tick in range(-40, 60):
            assert not done.any()
            action = one_naive_agent(observation)
            if chosen == "optimum" and tick >= 0:
                action = np.array([plan[tick] for plan in plans]) + 3
            observation, reward_, done, _, _ = env.step(action)
            score += reward_
        assert done.all()
        np.testing.assert_allclose(score, wanted, rtol=0, atol=1e-9)


def test_test_print_and_print_are_the_twins(rng: np.random.Generator) -> None:
    """What is scanned is what the twin prints of the agent's controls, what is scored is the twin's RMSE."""
    env = OnePrintEnv(family="everything", printer="corexy", noise_mm=0.0, **SMALL)
    observation, info = env.reset(seed=2)
    scene, middle = env.vector.scenes[0], np.array(env.vector.printer.bed_steps) // 2
    test, controls = rng.integers(-3, 4, (40, 2)), rng.integers(-3, 4, (60, 2))
    for control in test:
        assert observation["phase"] == 0
        assert not observation["scan"].any()
        observation, reward, done, _, _ = env.step(control + 3)
        assert (reward, done) == (0.0, False)
    assert observation["phase"] == 1
    twin, commanded = Twin(scene.mechanism), middle + np.concatenate([[[0, 0]], np.cumsum(test, axis=0)])
    np.testing.assert_array_equal(observation["scan"][:, :2], commanded)
    np.testing.assert_allclose(observation["scan"][:, 2:], twin.run(test, middle) - commanded, atol=1e-4)
    np.testing.assert_array_equal(observation["path"], scene.layer.nominal_steps)
    shown = observation["scan"].copy()
    for control in controls:
        observation, reward, done, _, _ = env.step(control + 3)
        np.testing.assert_array_equal(observation["scan"], shown)  # nothing is measured any more
    error = rmse(scene.layer.nominal_steps, twin.run(controls, scene.layer.start_steps))
    assert done
    assert reward == pytest.approx((info["naive_steps"] - error) / (info["naive_steps"] - info["optimum_steps"]))


def test_the_scan_has_the_noise_that_was_asked_for() -> None:
    scans = []
    for noise_mm in (0.0, 0.05):
        env = OnePrintVectorEnv(8, family="pulley", noise_mm=noise_mm, scenes=8, ticks=20, probe_ticks=200)
        observation, _ = env.reset(seed=9)
        for control in np.tile([[3, 1], [-3, -1]], (100, 1)):
            observation, *_ = env.step(np.tile(control + 3, (8, 1)))
        scans.append(observation["scan"][:, :, 2:])
    noise_steps = scans[1] - scans[0]
    assert noise_steps.std() == pytest.approx(0.05 / 0.2, rel=0.05)
    assert abs(noise_steps.mean()) < 0.02


def test_rows_are_the_single_environment_and_seeds_repeat(rng: np.random.Generator) -> None:
    actions = rng.integers(0, 7, (100, 2))
    one, many = OnePrintEnv(family="play", reward="dense", noise_mm=0.0, **SMALL), OnePrintVectorEnv(
        3, family="play", reward="dense", noise_mm=0.0, scenes=1, **SMALL
    )  # fmt: skip
    single, _ = one.reset(seed=5)
    batch, _ = many.reset(seed=5)
    assert many.observation_space.contains(batch)
    for action in actions:
        for name, value in single.items():
            np.testing.assert_array_equal(np.broadcast_to(value, batch[name].shape), batch[name])
        single, reward, done, _, _ = one.step(action)
        batch, rewards, dones, _, _ = many.step(np.tile(action, (3, 1)))
        np.testing.assert_array_equal(rewards, np.full(3, reward))
        assert (dones == done).all()
    assert done
    batch, rewards, dones, _, _ = many.step(np.tile(actions[0], (3, 1)))  # the next episode begins
    assert not dones.any()
    assert not rewards.any()
    assert not batch["phase"].any()
    assert not batch["scan"].any()


def test_an_agent_that_learns_from_the_scan_nears_the_optimum() -> None:
    printer = read_printer("ender5")
    scores = score_agent(learning_agent("greybox", printer), "pulley-play", scenes=3, seed=1)
    assert scores.min() > 0.9
    assert (scores <= 1 + 1e-9).all()
    np.testing.assert_allclose(score_agent(one_naive_agent, "pulley-play", scenes=3, seed=1), 0.0, atol=1e-9)


@pytest.mark.parametrize("ticks", [1, 80, 600])
def test_the_test_print_stays_on_the_bed_and_goes_both_ways_over_the_path(ticks: int, rng: np.random.Generator) -> None:
    printer = read_printer("ender5")
    start, bed = np.array(printer.bed_steps) // 2, np.array(printer.bed_steps)
    for _ in range(10):
        path = random_layer(rng, printer, 500).nominal_steps
        controls = probing_controls(ticks, path, start, bed)
        assert controls.shape == (ticks, 2)
        assert np.abs(controls).max() <= 3
        places = start + np.cumsum(controls, axis=0)
        assert (places >= 0).all()
        assert (places <= bed).all()
        if ticks == 600:
            assert (places.min(axis=0) <= path.min(axis=0) + 3).all()
            assert (places.max(axis=0) >= path.max(axis=0) - 3).all()
            assert (np.ptp(places, axis=0) >= 227).all()
            assert ((controls > 0).sum(axis=0) > 30).all()
            assert ((controls < 0).sum(axis=0) > 30).all()


def test_what_it_shows_of_a_print() -> None:
    env = OnePrintEnv(family="play", render_mode="rgb_array", **SMALL)
    assert env.render() is None
    env.reset(seed=1)
    pictures = []
    for _ in range(80):
        env.step(np.array([5, 4]))
        pictures.append(env.render())
    assert pictures[0].shape == (400, 400, 3)
    assert pictures[0].dtype == np.uint8
    assert (pictures[0] != pictures[-1]).any()
    assert OnePrintEnv(family="play", **SMALL).render() is None


@pytest.mark.parametrize("family", ["friction", "gain-table", "nobody"])
def test_where_nothing_can_be_gained_or_nobody_knows_the_family_it_says_so(family: str, ender5, monkeypatch) -> None:
    monkeypatch.setattr("printmend_lab.env.fleet._DRAWS", 30)
    with pytest.raises(ConfigError):
        draw_scene(np.random.default_rng(0), ender5, family, "damaged", 40)
