"""The hybrid: what nobody wrote down is learned, what is not there is not."""

from dataclasses import replace

import numpy as np
import pytest

from printmend.corruption import HEALTHY
from printmend.learn.learned import learn_model
from printmend.machine import Mechanism, Transmission, healthy_mechanism
from printmend.machine.kernels import run
from printmend.model import model_text, parse_model
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend_lab.greybox import Greybox
from printmend_lab.hybrid import Hybrid, HybridModel, learned_gains, with_residuals
from printmend_lab.hybrid.residual import (
    Kind,
    Points,
    chosen_kind,
    column_variances,
    continued,
    fit_residual,
    is_sure,
    points_in_contact,
    process,
    process_columns,
)
from printmend_lab.published import layer_trace
from printmend_lab.sampling import sample
from tests.naive_greybox import follow_tables_slowly
from tests.shapes import ring_layer

PRINTER = read_printer("ender5")


def two_faced(family: str | None) -> Mechanism:
    """A machine whose error forwards is another smooth function of the place than backwards."""
    base = Twin.of(HEALTHY if family is None else sample(family, np.random.default_rng(3)), PRINTER).mechanism
    assert isinstance(base, Mechanism)
    tables = []
    for table in base.transmissions:
        m = table.motor_mm
        lower = table.lower_mm + 0.25 * np.sin(m / 7.3) + 0.2 * np.sin(m / 11.0)
        upper = table.upper_mm + 0.2 * np.cos(m / 9.1) + 0.9
        low = np.maximum.accumulate(lower)
        tables.append(Transmission(table.first_mm, table.pitch_mm, low, np.maximum(np.maximum.accumulate(upper), low)))
    return replace(base, transmissions=(tables[0], tables[1]))


def zigzag(count: int = 700) -> np.ndarray:
    """Way-points over the whole bed: both motors pass every place many times, in either direction."""
    rng = np.random.default_rng(4)
    corners = np.stack([np.where(np.arange(14) % 2, 15.0, 205.0), np.where(np.arange(14) % 2, 205.0, 15.0)], axis=1)
    corners[1::2] += rng.uniform(0, 60, (7, 2)) * [1, -1]
    corners = np.concatenate([[PRINTER.home_mm], corners])
    along = np.linspace(0, len(corners) - 1, count)
    return np.stack([np.interp(along, np.arange(len(corners)), corners[:, axis]) for axis in range(2)], axis=1)


def traced(mechanism: Mechanism, noise_mm: float = 0.03) -> Trace:
    points_mm = zigzag()
    printed = Twin(mechanism).follow(points_mm)
    return Trace(points_mm, printed + np.random.default_rng(6).normal(0, noise_mm, printed.shape), homed=True)


def misfit_mm(model: Mechanism, truth: Mechanism) -> float:
    """RMS error of both branches of both motors where the trace went, but for an offset."""
    squares = []
    for mine, wanted in zip(model.transmissions, truth.homed().transmissions, strict=True):
        motor = np.linspace(75.0, 145.0, 300)
        off = np.stack(mine.branches_mm(motor)) - np.stack(wanted.branches_mm(motor))
        squares.append(np.mean((off - np.median(off)) ** 2))
    return float(np.sqrt(np.mean(squares)))


@pytest.fixture(scope="module")
def odd() -> tuple[Mechanism, Trace, HybridModel]:
    truth = two_faced(None)
    trace = traced(truth)
    return truth, trace, Hybrid().fit(trace, PRINTER, rng=np.random.default_rng(0))


def test_an_error_that_nobody_wrote_down_is_learned(odd: tuple[Mechanism, Trace, HybridModel]) -> None:
    truth, _, model = odd
    assert model.residuals != (None, None)
    assert misfit_mm(model.mechanism, truth) < 0.4 * misfit_mm(model.box.mechanism, truth)
    assert misfit_mm(model.mechanism, truth) < 0.03
    for table in model.mechanism.transmissions:
        assert (np.diff(table.lower_mm) >= 0).all()
        assert (np.diff(table.upper_mm) >= 0).all()
        assert (table.lower_mm <= table.upper_mm).all()


def test_what_was_added_is_saved_and_read_back(
    odd: tuple[Mechanism, Trace, HybridModel], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, trace, model = odd
    monkeypatch.setattr(Hybrid, "fit", lambda *_, **__: model)  # it would learn the same again
    saved = learn_model(trace, PRINTER, model="hybrid", rng=np.random.default_rng(0))
    assert saved.learner == "hybrid"
    assert model.residual_after_mm < 0.8 * model.box.residual_after_mm
    again = parse_model(model_text(saved), subject="the text")
    for mine, wanted in zip(again.mechanism.transmissions, model.mechanism.transmissions, strict=True):
        np.testing.assert_allclose(mine.lower_mm, wanted.lower_mm, atol=2e-9)
        np.testing.assert_allclose(mine.upper_mm, wanted.upper_mm, atol=2e-9)


@pytest.mark.parametrize("family", ["healthy", "pulley", "pulley-loose"])
def test_known_faults_need_nothing_more(family: str) -> None:
    truth = Twin.of(HEALTHY if family == "healthy" else sample(family, np.random.default_rng(3)), PRINTER).mechanism
    assert isinstance(truth, Mechanism)
    trace = traced(truth)
    model = Hybrid().fit(trace, PRINTER, rng=np.random.default_rng(0))
    assert misfit_mm(model.mechanism, truth) <= misfit_mm(model.box.mechanism, truth) * 1.02 + 0.002


@pytest.mark.parametrize("noise_steps", [0.0, 0.25])
def test_the_published_world_is_recognised(noise_steps: float) -> None:
    twin = Twin.of(sample("gain-table", np.random.default_rng(5)), PRINTER)
    layer = ring_layer((520.0, 540.0), 110.0)
    printed = twin.run(layer.controls, layer.start_steps)
    printed = printed + np.random.default_rng(2).normal(0, noise_steps, printed.shape)
    model = Hybrid().fit(layer_trace(layer, printed, PRINTER), PRINTER, rng=np.random.default_rng(0))
    assert model.world is not None
    seen = slice(layer.nominal_steps.min(), layer.nominal_steps.max() - 1)
    for mine, wanted in zip(model.world.gains, twin.mechanism.gains, strict=True):
        np.testing.assert_allclose(mine[seen], wanted[seen], atol=1e-3 + 0.08 * noise_steps)


def test_a_spliced_belt_is_a_machine_and_not_the_published_world() -> None:
    healthy = healthy_mechanism(PRINTER)
    bent, straight = healthy.transmissions
    splices = 0.3 * np.tanh((bent.motor_mm - 97.0) / 0.3) + 0.2 * np.tanh((bent.motor_mm - 104.0) / 0.3)
    table = np.maximum.accumulate(bent.lower_mm + splices)
    twin = Twin(replace(healthy, transmissions=(replace(bent, lower_mm=table, upper_mm=table), straight)))
    layer = ring_layer((520.0, 540.0), 110.0)
    trace = layer_trace(layer, twin.run(layer.controls, layer.start_steps), PRINTER)
    box = Greybox().fit(trace, PRINTER, rng=np.random.default_rng(0))
    gains = learned_gains(trace, PRINTER)
    assert gains is not None
    assert gains.residual_mm < box.residual_after_mm  # but they leave a pattern, as the machine does
    assert with_residuals(box, trace, seed=0).world is None


@pytest.mark.parametrize("seed", range(4))
def test_beyond_what_was_seen_what_repeats_goes_on(seed: int) -> None:
    """A pulley of another size, out of round, under a belt with splices and play: only splices beyond stay unknown."""
    rng = np.random.default_rng(seed)
    healthy = healthy_mechanism(PRINTER).transmissions[0]
    motor, reach, turn = healthy.motor_mm, (60.0, 150.0), PRINTER.axes[0].mm_per_turn
    k, phase = np.arange(1, 4), rng.uniform(0, 2 * np.pi, 3)
    pulley = -0.25 * motor + (np.cos(np.outer(motor, k) * 2 * np.pi / turn + phase) * [1.0, 0.4, 0.1]).sum(axis=1)
    splices = np.tanh(np.subtract.outer(motor, rng.uniform(60, 150, 4)) / 0.3) @ rng.uniform(0.1, 0.4, 4)
    wanted = np.maximum.accumulate(motor + pulley + splices)
    learned_mm = np.where((motor > reach[0] - 0.1) & (motor < reach[1] + 0.1), wanted, motor)
    table = continued(replace(healthy, lower_mm=learned_mm - 0.2, upper_mm=learned_mm + 0.2), reach, turn)
    near = (motor > reach[0] - 30.0) & (motor < reach[1] + 30.0)
    inside = (motor > reach[0]) & (motor < reach[1])
    for branch, play_mm in ((table.lower_mm, -0.2), (table.upper_mm, 0.2)):
        np.testing.assert_allclose(branch[inside], wanted[inside] + play_mm, atol=1e-12)
        np.testing.assert_allclose(branch[near], wanted[near] + play_mm, atol=0.1)
    short = continued(replace(healthy, lower_mm=learned_mm, upper_mm=learned_mm), (60.0, 100.0), turn)
    np.testing.assert_array_equal(short.lower_mm, learned_mm)


def test_the_noise_of_a_small_print_is_no_residual() -> None:
    """Two laps round a square are a few blocks: the best of ten kinds gains on all of them by chance."""
    found = []
    lap = np.concatenate([np.full(10, 67.0), np.linspace(70, 115, 10), np.full(10, 120.0), np.linspace(115, 70, 10)])
    for seed in range(30):
        rng = np.random.default_rng(seed)
        motor, side, block = np.tile(lap, 2), np.tile(np.repeat([-1.0, 1.0], [10, 30]), 2), np.arange(80) // 13
        data = Points(motor, side, rng.normal(0, 0.05, 80), np.ones(80), block, 40.0, 0.05, np.linspace(0, 1, 80))
        found.append(chosen_kind(data, (50.0, 140.0), patterned=False, seed=0))
    assert found == [None] * 30


def test_single_points_of_noise_are_no_residual() -> None:
    rng = np.random.default_rng(1)
    for _ in range(5):
        motor = np.concatenate([np.linspace(0, 160, 300), np.linspace(160, 0, 300)])
        noise = rng.normal(0, 0.05, 600)
        side = np.where(np.arange(600) < 300, -1.0, 1.0)
        data = Points(motor, side, noise, np.ones(600), (np.arange(600) * 160 / 300 / 40).astype(int), 40.0, 0.05,
                      np.linspace(0, 1, 600))  # fmt: skip
        assert chosen_kind(data, (-20.0, 180.0), patterned=False, seed=0) is None


@pytest.mark.parametrize(
    ("share", "standard_errors", "sure"), [(0.035, 2.8, False), (0.035, 3.8, True), (0.2, 2.8, True), (0.01, 9, False)]
)
def test_a_small_gain_has_to_be_surer(share: float, standard_errors: float, sure: bool) -> None:
    """Of 400 healthy printers' motors the best of ten kinds gains up to 3.6 % of the noise, 2.8 standard errors."""
    gain = np.random.default_rng(1).normal(0, 1, 160)
    gain += standard_errors * np.std(gain, ddof=1) / np.sqrt(160) - gain.mean()
    assert is_sure(gain, np.full(160, gain.mean() / share)) is sure


def test_a_process_is_the_ridge_solution_of_its_columns() -> None:
    rng = np.random.default_rng(2)
    motor, side = rng.uniform(0, 100, 400), rng.choice([-1.0, 1.0], 400)
    truth = 0.1 * np.sin(motor / 6.0) + side * 0.05 * np.cos(motor / 9.0)
    data = Points(motor, side, truth + rng.normal(0, 0.02, 400), np.ones(400), np.zeros(400, int), 40.0, 0.1,
                  np.linspace(0, 1, 400))  # fmt: skip
    kind, reach = Kind("smooth", 5.0, sides=True), (-20.0, 120.0)
    design, root = process_columns(kind, motor, side, 40.0, reach), np.sqrt(column_variances(kind, reach))
    weights = process(design, root, data)
    slope, scaled = root * (design.T @ (data.residual_mm - design @ weights)), weights / root
    share = slope @ scaled / (scaled @ scaled)
    np.testing.assert_allclose(slope, share * scaled, atol=1e-9)
    found = fit_residual(kind, data, reach, np.arange(0.0, 100.1, 0.2), seed=0)
    np.testing.assert_allclose(design @ weights, found.at_mm(motor, side), atol=2e-4)
    assert np.sqrt(np.mean((found.at_mm(motor, side) - truth) ** 2)) < 0.012


@pytest.mark.parametrize("seed", range(3))
def test_contacts_agree_with_the_slow_loop(seed: int) -> None:
    rng = np.random.default_rng(seed)
    motor = np.cumsum(rng.normal(0, 1.0, 300))
    lower, upper = motor - rng.uniform(0, 1, 300), motor + rng.uniform(0, 1, 300)
    at, side, belt = np.empty(300, np.int64), np.empty(300), np.empty(300)
    run.contacts(0.3, lower, upper, at, side, belt)
    slow = follow_tables_slowly(lower, upper, 0.3)
    np.testing.assert_array_equal(np.stack([at, side, belt]), np.array(slow))


def test_points_are_the_rows_in_contact() -> None:
    table = two_faced(None).transmissions[0]
    motor = np.array([100.0, 100.1, 140.0, 139.9, 100.0])
    lower, _ = table.branches_mm(motor)
    start = float(lower[0]) + 0.01
    found = points_in_contact(table, motor, np.zeros(5), np.array([1.0, 1.0, 1.0, 1.0, 0.0]), start, 40.0)
    assert found.motor_mm[-1] in (139.9, 140.0)
    assert set(found.side) <= {-1.0, 1.0}


def test_noise_at_few_places_is_no_error_of_the_machine() -> None:
    found = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        motor_mm, noise_mm = rng.uniform(0, 500, 52), rng.normal(0, 0.1, 52)
        points = Points(motor_mm, rng.choice([-1.0, 1.0], 52), noise_mm, np.ones(52), np.arange(52) // 2, 40.0, 0.1,
                        np.linspace(0, 1, 52))  # fmt: skip
        found.append(chosen_kind(points, (-20.0, 520.0), patterned=False, seed=seed))
    assert sum(kind is not None for kind in found) <= 1


@pytest.mark.parametrize("wave_mm", [0.0, 0.03])
def test_a_drift_of_the_print_is_no_pattern_of_its_places(wave_mm: float) -> None:
    """The print goes along the motor as time goes on: what drifts looks like a bend, and a wave beside it is one."""
    rng = np.random.default_rng(5)
    done = np.linspace(0, 1, 600)
    motor = 250 * np.where(done < 0.4, np.mod(done, 0.1) / 0.1, (done - 0.4) / 0.6)
    side, block = rng.choice([-1.0, 1.0], 600), (done * 40).astype(int)
    truth = wave_mm * np.sin(motor / 8.0)
    residual = truth + 0.12 * done * (motor / 250) + rng.normal(0, 0.03, 600)
    data = Points(motor, side, residual - residual.mean(), np.ones(600), block, 40.0, 0.04, done)
    kind, reach = chosen_kind(data, (-20.0, 270.0), patterned=False, seed=0), (-20.0, 270.0)
    if not wave_mm:
        assert kind is None
        return
    assert kind is not None
    assert kind.timed
    found = fit_residual(kind, data, reach, np.arange(0.0, 250.1, 0.5), seed=0)
    assert np.std(found.at_mm(motor, side) - truth) < 0.012
