"""The peers that are fitted by search or by gradient, iterative learning, and the planner that inverts them all."""

import numpy as np
import pytest

from printmend.learn.mechanism_model import MechanismModel
from printmend.machine import healthy_mechanism
from printmend.metrics import rmse
from printmend.path import Trace
from printmend.printer import read_printer
from printmend_lab.conformance.learners import OTHER, LearnerCandidate, naive_error, plan_error, printed
from printmend_lab.control.registry import controller
from printmend_lab.peers.ilc import GAIN, followed, iterate, smoothed
from printmend_lab.peers.memory import MemoryModel
from printmend_lab.peers.memory import followed as followed_element
from printmend_lab.peers.mpc import cost_steps2
from printmend_lab.peers.narx import Narx, Option, fitted_narx, free_run, increments, picked, stays_bounded
from printmend_lab.peers.network import TAPS_MM, NetworkLearner, inputs, remembered
from printmend_lab.peers.process import process_drive
from printmend_lab.peers.rows import MotorRows
from tests.test_peers import rows_of, zigzag

PRINTER = read_printer("ender5")
INVERSE, MPC = "printmend_lab.peers.inverse:INVERSE", "printmend_lab.peers.mpc:MPC"
FEATURES = 2 * (3 + 2 * 4) + 4


def test_forward_least_squares_picks_the_terms_that_are_there(rng: np.random.Generator) -> None:
    """Of correlated columns, those of which the value is made; their weights are exact (Billings 2013, 3.2)."""
    design = rng.normal(size=(200, 12)) @ rng.normal(size=(12, 12))
    weights = np.zeros(12)
    weights[[3, 7, 8]] = 1.5, -0.7, 0.2
    np.testing.assert_allclose(picked(design, design @ weights, 3 + 9), weights, atol=1e-8)
    assert np.count_nonzero(picked(design, design @ weights, 1)) == 1


def test_narx_finds_the_equation_that_made_the_data(rng: np.random.Generator) -> None:
    """de = dm·(−0.6 − 1.5·way·e): a play of 0.8 mm without its corner, to 6 %: free runs take longer steps."""
    weights = np.zeros(FEATURES)
    weights[0], weights[-3] = -0.6, -1.5
    truth, motor = Narx(weights, 40.0), zigzag(rng, 60, pitch_mm=0.2)
    error = followed_element(truth, rows_of(motor, motor))
    rows = MotorRows(motor, error, np.zeros(len(motor), int))
    np.testing.assert_allclose(free_run(truth, rows), error, atol=0.03)  # larger steps of the same equation
    design, value = increments(rows, 1.0)
    assert design.shape == (len(value), FEATURES)
    for option, noise_mm, off in ((Option(2), 0.0, 0.06), (Option(0, True), 0.02, 0.06)):
        noisy = MotorRows(motor, error + rng.normal(0, noise_mm, len(motor)), rows.layer)
        found = fitted_narx(noisy, option)
        assert np.flatnonzero(found.weights).tolist() == [0, FEATURES - 3]
        assert found.weights[[0, -3]] == pytest.approx([-0.6, -1.5], rel=off)
        assert np.std(free_run(found, rows) - error) < 0.05 * np.std(error)


def test_a_narx_model_that_drifts_is_none(rng: np.random.Generator) -> None:
    """A term that adds up whichever way the motor goes has no end."""
    motor = zigzag(rng)
    weights = np.zeros(FEATURES)
    weights[FEATURES // 2 - 2] = 0.3  # the way itself
    drifting = Narx(weights, 40.0)
    assert not stays_bounded(drifting, rows_of(motor, motor + 0.1 * np.sin(motor)))
    assert stays_bounded(Narx(0 * weights, 40.0), rows_of(motor, motor + 0.1 * np.sin(motor)))


def test_a_gaussian_process_knows_a_turn_and_both_sides(rng: np.random.Generator) -> None:
    """Learned from noisy rows over two turns with play, it is right over another turn: periodic inputs."""
    motor = np.concatenate([np.arange(20, 100, 0.5), np.arange(100, 20, -0.5), np.arange(20, 100, 2.0)])

    def wave(m: np.ndarray) -> np.ndarray:
        return np.asarray(0.5 * np.cos(2 * np.pi * m / 40) + 0.1 * np.sin(2 * np.pi * 3 * m / 40))

    side = np.where(np.diff(motor, prepend=0) > 0, -0.2, 0.2)
    drive = process_drive(rows_of(motor, motor + wave(motor) + side + rng.normal(0, 0.02, len(motor))))
    places = np.arange(10.0, 130.0)
    forwards, back = drive(places)
    assert np.std((forwards + back) / 2 - wave(places)) < 0.06
    assert np.median(back - forwards) == pytest.approx(0.4, abs=0.08)


def test_networks_remember_where_the_motor_was(rng: np.random.Generator) -> None:
    """The taps are the places that far of travel ago, however the way was cut."""
    motor = np.cumsum(rng.choice([-1, 1], 60).repeat(12) * 0.05) + 50
    memory = remembered(rows_of(motor, motor))
    gone = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(motor)))])
    for n in (300, 500, 719):
        places = np.interp(gone[n] - TAPS_MM, gone, motor)
        taps = inputs(memory[n : n + 1], motor[n : n + 1], 40.0)[0, -len(TAPS_MM) :]
        np.testing.assert_allclose(motor[n] - taps * TAPS_MM, places, atol=0.03)  # a corner is at most a cell off
    straight = np.array([0.0, 0.1, 7.0])
    np.testing.assert_allclose(inputs(remembered(rows_of(straight, straight))[2:], straight[2:], 40.0)[0, -6:], 1.0)


def test_a_network_learns_a_wave_with_play(rng: np.random.Generator) -> None:
    motor = zigzag(rng, 60)
    points = np.stack([motor, np.full(len(motor), 50.0)], axis=1)
    truth = 0.4 * np.sin(2 * np.pi * motor / 40) + np.convolve(np.sign(np.diff(motor, prepend=0)), np.ones(3) / 30)[:-2]
    measured = points + np.stack([truth + rng.normal(0, 0.02, len(motor)), 0 * motor], axis=1)
    model = NetworkLearner("two", 2).fit(Trace(points, measured), PRINTER, rng=rng)
    assert isinstance(model, MemoryModel)
    left = followed_element(model.elements[0], rows_of(motor, motor)) - truth
    assert left.std() < 0.3 * truth.std()


@pytest.mark.parametrize("world", ["pulley-play", "pulley"])
def test_an_inverse_crosses_the_play(world: str) -> None:
    """Algorithm 1 stands still on the true machine where play swallows a step; its inverse does not."""
    model = LearnerCandidate("oracle").fitted(world)
    assert plan_error(printed(world, "ender5"), model, INVERSE) < 0.1 * naive_error(world, "ender5")
    if world == "pulley-play":
        assert plan_error(printed(world, "ender5"), model, "greedy") > 50


def test_an_inverse_leaves_a_healthy_printer_alone() -> None:
    model, targets = MechanismModel(healthy_mechanism(PRINTER)), OTHER.nominal_steps
    plan = controller(INVERSE).plan(model, targets[1:], targets[0])
    np.testing.assert_array_equal(plan.controls, np.diff(targets, axis=0))


def test_iterative_learning_contracts_as_its_theory_says() -> None:
    """On a machine of gain g that prints off the lattice, the error falls by 1 − γg with each print (Bristow 2006)."""
    gain, targets = 0.8, 1000.0 * np.stack([np.sin(np.linspace(0, 3, 900)), np.cos(np.linspace(0, 3, 900))], axis=1)

    def print_layer(controls: np.ndarray) -> np.ndarray:
        nominal = np.concatenate([targets[:1], targets[0] + np.cumsum(controls, axis=0)])
        return np.asarray(targets[0] + gain * (nominal - targets[0]))

    errors = [attempt.rmse_steps for attempt in iterate(print_layer, targets, prints=6, c_max=60)]
    ratios = np.array(errors[1:]) / np.array(errors[:-1])
    np.testing.assert_allclose(ratios[:3], 1 - GAIN * gain, rtol=0.05)  # until the lattice shows
    assert errors[-1] < 5


def test_iterative_learning_mends_its_own_layer_on_a_broken_printer(rng: np.random.Generator) -> None:
    twin, targets = printed("pulley-play", "ender5"), OTHER.nominal_steps

    def print_layer(controls: np.ndarray) -> np.ndarray:
        out = twin.run(controls, targets[0]) + rng.normal(0, 0.1, targets.shape)
        out[rng.random(len(out)) < 0.3] = np.nan
        return out

    attempts = iterate(print_layer, targets, prints=6, smoothing_ticks=3)
    np.testing.assert_array_equal(attempts[0].controls, OTHER.controls)
    assert attempts[-1].rmse_steps < 0.35 * attempts[0].rmse_steps


def test_commands_go_as_fast_as_they_may() -> None:
    np.testing.assert_array_equal(followed(np.array([[0.0, 0], [7, 0.4], [7, 1.6], [7, 1.6]]), 3)[:, 0], [3, 3, 1])
    np.testing.assert_allclose(smoothed(np.array([[0.0, 1], [3, 1], [0, 1]]), 3), [[1, 1], [1, 1], [1, 1]])


def test_predictive_control_crosses_the_play_and_leaves_the_healthy_alone() -> None:
    targets = OTHER.nominal_steps[:80]
    healthy = controller(MPC).plan(MechanismModel(healthy_mechanism(PRINTER)), targets[1:], targets[0])
    assert np.abs(healthy.imagined_steps - targets).max() < 1e-9
    twin, model = printed("pulley-play", "ender5"), LearnerCandidate("oracle").fitted("pulley-play")
    errors = []
    for planner in (MPC, "greedy", "optimal"):
        plan = controller(planner).plan(model, targets[1:], targets[0])
        errors.append(rmse(targets, twin.run(plan.controls, targets[0])))
    assert errors[2] <= errors[0] < 2.5 * errors[2]
    assert errors[0] < 0.2 * errors[1]


def test_predictive_control_costs_what_its_sequence_misses() -> None:
    model = MechanismModel(healthy_mechanism(PRINTER))
    sequences = np.array([[[1, 0], [1, 0]], [[0, 0], [0, 3]]])
    targets = np.array([[101.0, 100], [102, 100]])
    cost = cost_steps2(model, model.start(np.array([100, 100])), sequences, targets)
    np.testing.assert_allclose(cost, [0, 1 + 4 + 9], atol=1e-9)
