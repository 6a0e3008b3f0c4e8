"""The peers keep the laws of their own papers and manuals, on machines made for them."""

import itertools

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive, Play
from printmend.corruption.frame import CrookedFrame
from printmend.learn import fit
from printmend.learn.mechanism_model import MechanismModel
from printmend.machine import Mechanism, Transmission, healthy_transmission
from printmend.path import Trace
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from printmend_lab.conformance.learners import OTHER, TRAINING
from printmend_lab.peers.hysteresis import (
    BoucWen,
    PrandtlIshlinskii,
    Shape,
    boucwen_element,
    fitted_operator,
    lags,
    moved,
    play,
    prandtl_element,
)
from printmend_lab.peers.memory import MemoryModel, followed_drive, transmission
from printmend_lab.peers.memory import followed as followed_element
from printmend_lab.peers.rows import MotorRows, block_errors_mm2, chosen, least_squares, motor_rows, ways
from printmend_lab.published import layer_trace

PRINTER = read_printer("ender5")


def printed(corruption: Corruption, printer: Printer = PRINTER) -> Trace:
    """The training layer's print on a broken machine."""
    twin = Twin.of(corruption, printer)
    return layer_trace(TRAINING, twin.run(TRAINING.controls, TRAINING.start_steps), printer)


def learned(name: str, trace: Trace, printer: Printer = PRINTER) -> MechanismModel | MemoryModel:
    model = fit(name, trace, printer, rng=np.random.default_rng(0))
    assert isinstance(model, (MechanismModel, MemoryModel))
    return model


def imagined(model: MechanismModel | MemoryModel, count: int | None = None) -> np.ndarray:
    """Where the model puts a layer that it has not seen, or the ``count`` controls that it begins with, full steps."""
    state, out = model.start(OTHER.start_steps), [OTHER.start_steps.astype(float)]
    for control in OTHER.controls[:count]:
        state = model.advance(state, control[None])
        out.append(state.position_steps[0])
    return np.array(out)


def rows_of(motor_mm: np.ndarray, carriage_mm: np.ndarray) -> MotorRows:
    return MotorRows(motor_mm, carriage_mm - motor_mm, np.zeros(len(motor_mm), int))


def zigzag(rng: np.random.Generator, turns: int = 40, pitch_mm: float = 0.5) -> np.ndarray:
    """A path [N] mm back and forth over ways of every length."""
    corners = 60 + np.cumsum(rng.choice([-1, 1], turns) * rng.uniform(0.3, 15, turns))
    parts = [
        np.linspace(a, b, max(2, int(abs(b - a) / pitch_mm)), endpoint=False) for a, b in itertools.pairwise(corners)
    ]
    return np.concatenate(parts)


def test_affine_recovers_skew_and_scale_to_the_last_digits() -> None:
    broken = Corruption(frame=CrookedFrame(1.7, 1.013, 0.991, 0.0, 0.0))
    model = learned("affine", printed(broken))
    twin = Twin.of(broken, PRINTER)
    np.testing.assert_allclose(imagined(model), twin.run(OTHER.controls, OTHER.start_steps), rtol=0, atol=1e-9)


def test_a_scans_origin_changes_nothing(rng: np.random.Generator) -> None:
    trace = printed(Corruption((Drive(belt=Play(0.5)), Drive(belt=Play(0.8)))))
    trace = Trace(trace.commanded_mm[::24], trace.measured_mm[::24])
    moved_trace = Trace(trace.commanded_mm, trace.measured_mm + np.array([13.0, -4.0]), placed=False)
    for name in ("affine", "backlash", "bilateral", "prandtl-ishlinskii", "bouc-wen"):
        there, here = (imagined(learned(name, each), 300) for each in (moved_trace, trace))
        np.testing.assert_allclose(there, here, atol=1e-6)


@pytest.mark.parametrize("width_mm", [0.1, 0.73, 2.0])
def test_backlash_recovers_the_play(width_mm: float, rng: np.random.Generator) -> None:
    trace = printed(Corruption((Drive(belt=Play(width_mm)), Drive(belt=Play(width_mm / 2)))))
    noisy = Trace(trace.commanded_mm, trace.measured_mm + rng.normal(0, 0.02, trace.measured_mm.shape))
    model = learned("backlash", noisy)
    assert isinstance(model.mechanism, Mechanism)
    for drive, wanted_mm in zip(model.mechanism.transmissions, (width_mm, width_mm / 2), strict=True):
        assert (drive.upper_mm - drive.lower_mm).mean() == pytest.approx(wanted_mm, abs=0.01)


def test_a_homed_trace_starts_on_the_engaged_side(ender5: Printer) -> None:
    """From home only one way is seen before the first turn: the play shows on it."""
    home = np.array(ender5.home_mm)
    points = home + np.array([[0, 0], [-40, -40], [-20, -20], [-60, -70], [-10, -15], [-50, -40]])
    twin = Twin.of(Corruption((Drive(belt=Play(0.6)), Drive(belt=Play(0.6)))), ender5)
    fine = np.concatenate([np.linspace(a, b, 60, endpoint=False) for a, b in itertools.pairwise(points)])
    model = learned("backlash", Trace(fine, twin.follow(fine), homed=True), ender5)
    assert isinstance(model.mechanism, Mechanism)
    for drive in model.mechanism.transmissions:
        assert (drive.upper_mm - drive.lower_mm).mean() == pytest.approx(0.6, abs=0.03)


def test_a_lead_screw_table_is_reproduced(rng: np.random.Generator) -> None:
    """A machine that is a table of forward and reverse errors, 5 mm apart, as LinuxCNC's manual defines one."""
    motor = zigzag(rng)
    places = np.arange(motor.min() - 1, motor.max() + 6, 5.0)
    forward, reverse = rng.normal(0, 0.1, len(places)), rng.normal(0.4, 0.1, len(places))

    def drive(motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.interp(motor_mm, places, forward), np.interp(motor_mm, places, reverse)

    broken = transmission(PRINTER, 0, drive)
    truth = Mechanism(PRINTER, (broken, healthy_transmission(PRINTER, 1)))
    twin = Twin(truth)
    trace = layer_trace(TRAINING, twin.run(TRAINING.controls, TRAINING.start_steps), PRINTER)
    model = learned("bilateral", trace)
    error = imagined(model) - twin.run(OTHER.controls, OTHER.start_steps)
    assert np.sqrt((error**2).mean()) * 0.2 < 0.02
    assert isinstance(model.mechanism, Mechanism)
    found: Transmission = model.mechanism.transmissions[0]
    seen = (found.motor_mm > 90) & (found.motor_mm < 120)
    play_mm = np.interp(found.motor_mm, broken.motor_mm, broken.upper_mm - broken.lower_mm)
    np.testing.assert_allclose((found.upper_mm - found.lower_mm)[seen], play_mm[seen], atol=0.1)


def test_ways_count_from_the_last_turn() -> None:
    way, since = ways(rows_of(np.array([0.0, 1, 3, 2, 2, 0, 5]), np.zeros(7)))
    np.testing.assert_array_equal(way, [0, 1, 1, -1, -1, -1, 1])
    np.testing.assert_array_equal(since, [0, 1, 3, 1, 1, 3, 5])


def test_play_operators_are_clips(rng: np.random.Generator) -> None:
    motor, radii = zigzag(rng), np.array([0.1, 0.5, 3.0])
    for k, radius in enumerate(radii):
        at, slow = motor[0], []
        for m in motor:
            at = m - radius if at < m - radius else m + radius if at > m + radius else at
            slow.append(at)
        np.testing.assert_array_equal(play(motor, radii)[:, k], slow)
    finer = np.interp(np.arange(0, len(motor) - 0.9, 0.25), np.arange(len(motor)), motor)
    np.testing.assert_allclose(play(finer, radii)[::4], play(motor, radii), atol=1e-12)  # the rate does not matter
    engaged = play(motor, radii, engaged=1)
    np.testing.assert_array_equal(engaged[0], motor[0] - radii)


def test_branches_are_followed_as_operators_are(rng: np.random.Generator) -> None:
    motor = zigzag(rng)
    rows = rows_of(motor, motor)
    error = followed_drive(lambda m: (np.full(len(m), -0.4), np.full(len(m), 0.4)), rows)
    np.testing.assert_allclose(error, lags(rows, np.array([0.4]))[:, 0], atol=1e-12)


def random_operator(rng: np.random.Generator) -> PrandtlIshlinskii:
    return PrandtlIshlinskii(rng.uniform(0.2, 1.5), np.sort(rng.uniform(0.05, 2, 6)), rng.uniform(0, 0.5, 6))


def test_the_inverse_prandtl_ishlinskii_operator_is_exact(rng: np.random.Generator) -> None:
    for _ in range(5):
        operator, path = random_operator(rng), zigzag(rng)
        path = path - path[0]  # at rest every play is at its place: an operator's origin
        np.testing.assert_allclose(operator.inverse().run(operator.run(path)), path, atol=1e-10)
        np.testing.assert_allclose(operator.run(operator.inverse().run(path)), path, atol=1e-10)


def test_a_prandtl_ishlinskii_operator_forgets_a_loop_that_closed(rng: np.random.Generator) -> None:
    """Return-point memory: an excursion and back leaves no trace."""
    operator = random_operator(rng)
    straight, detour = np.array([0.0, 5.0, -3.0]), np.array([0.0, 5.0, 1.0, 2.5, 1.0, -3.0])
    assert operator.run(detour)[-1] == pytest.approx(operator.run(straight)[-1], abs=1e-12)


def test_prandtl_ishlinskii_weights_are_found(rng: np.random.Generator) -> None:
    motor = zigzag(rng, pitch_mm=0.05)
    weights = np.array([0, 0.2, 0, 0.1, 0, 0, 0.15, 0, 0, 0.05])
    truth = PrandtlIshlinskii(0.6, 0.8 * np.arange(1, 11) / 10, weights)
    rows = rows_of(motor, truth.run(motor))
    found = fitted_operator(rows, truth.radii_mm, lags(rows, truth.radii_mm))
    assert found.gain == pytest.approx(0.6, abs=1e-9)
    np.testing.assert_allclose(found.weights, weights, atol=1e-9)
    element = prandtl_element(rows)
    left = followed_element(element, rows) - rows.error_mm
    assert np.std(left) < 0.01


@pytest.mark.parametrize(("b", "gamma"), [(3.0, 1.0), (2.0, 2.0), (4.0, -1.5), (1.5, 0.0)])
def test_bouc_wen_is_what_its_equation_integrates_to(b: float, gamma: float) -> None:
    """Along m = sin t, against scipy's integration of the differential equation."""
    from scipy.integrate import solve_ivp  # each worker reads this file, and one runs it

    t = np.linspace(0, 12, 200)

    def rate(t: float, z: np.ndarray) -> np.ndarray:
        dm = 2 * np.cos(t)
        return np.asarray(dm - b * abs(dm) * z - gamma * dm * np.abs(z))

    wanted = solve_ivp(rate, (0, 12), [0.0], t_eval=t, rtol=1e-9, atol=1e-11, max_step=0.02).y[0]
    motor, z, got = 2 * np.sin(t), np.zeros(1), [0.0]
    corners = np.array([np.pi / 2, 3 * np.pi / 2, 5 * np.pi / 2, 7 * np.pi / 2])
    for a, c in itertools.pairwise(t):  # a straight move ends where the motor turns
        stops = [*corners[(corners > a) & (corners < c)], c]
        for stop, before in zip(stops, [a, *stops], strict=False):
            z = moved(z, 2 * np.sin(stop) - 2 * np.sin(before), Shape(b, gamma))
        got.append(float(z[0]))
    np.testing.assert_allclose(got, wanted, atol=1e-6)
    assert np.abs(got).max() <= 1 / (b + gamma) + 1e-9
    assert motor[0] == 0


def test_bouc_wen_moves_add_up() -> None:
    shape, z = Shape(3.0, 1.0), np.linspace(-0.25, 0.25, 11)
    for by in (-0.7, 0.01, 0.4):
        np.testing.assert_allclose(moved(moved(z, by / 3, shape), by * 2 / 3, shape), moved(z, by, shape), atol=1e-14)
    np.testing.assert_array_equal(moved(z, 0.0, shape), z)


def test_bouc_wen_is_found_and_inverted(rng: np.random.Generator) -> None:
    motor = zigzag(rng)
    truth = BoucWen(1.02, 0.8, Shape(2.0, 2.0))
    rows = rows_of(motor, motor)
    rows = rows_of(motor, motor + followed_element(truth, rows))
    found = boucwen_element(rows)
    assert np.std(followed_element(found, rows) - rows.error_mm) < 0.01
    wanted = 60 + np.array([0.0, 3.0, 1.0, 4.0, 2.0, 2.5])
    inverse = truth.inverse(wanted)
    rows = rows_of(inverse, inverse)
    np.testing.assert_allclose(inverse + followed_element(truth, rows), wanted, atol=1e-3)


def test_noise_alone_buys_nothing(rng: np.random.Generator) -> None:
    motor = zigzag(rng)
    rows = rows_of(motor, motor + rng.normal(0, 0.05, len(motor)))

    def power(some: MotorRows, count: int) -> np.ndarray:
        columns = np.stack([(motor / 60 - 1) ** k for k in range(1, count + 1)], axis=1)
        return np.asarray(columns @ least_squares(some, columns))

    assert chosen(rows, (1, 2, 3, 4), power) == 1
    curved = rows_of(motor, motor + (motor / 60 - 1) ** 2 + rng.normal(0, 0.05, len(motor)))
    assert chosen(curved, (1, 2, 3, 4), power) == 2
    assert np.sqrt(block_errors_mm2(curved, power, 2).mean()) == pytest.approx(0.05, rel=0.15)


def test_layers_are_not_joined(rng: np.random.Generator) -> None:
    """Each layer has an origin of its own."""
    motor = np.concatenate([zigzag(rng, 10), zigzag(rng, 10)])
    half = len(motor) // 2
    layer = (np.arange(len(motor)) >= half).astype(int) * 7
    error = 0.01 * motor + np.where(layer > 0, 5.0, 0.0)
    points = np.stack([motor, np.full(len(motor), 50.0)], axis=1)
    trace = Trace(points, points + np.stack([error, 0 * error], axis=1), layer=layer)
    a, b = motor_rows(trace, PRINTER)
    assert [(path.start, path.stop) for path in a.paths()] == [(0, half), (half, len(motor))]
    assert b.is_sparse
    np.testing.assert_allclose(least_squares(a, motor[:, None]), [0.01], atol=1e-12)
