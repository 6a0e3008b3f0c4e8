"""The learner that was taught to learn: its contacts, its evidence, its closed form, what it makes of few points."""

from importlib import resources

import numpy as np
import pytest

from printmend.corruption import Corruption
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend_lab.bench.prints import SHAPES, path_print
from printmend_lab.meta import MetaLearner, kernels
from printmend_lab.meta.bayes import FEATURES, OUTPUTS, forward, posterior
from printmend_lab.meta.columns import GROUPS, columns, groups
from printmend_lab.meta.meta import shipped
from printmend_lab.meta.tasks import draw_drive, draw_lesson, evidence
from printmend_lab.sampling import sample
from tests import naive_law, naive_meta

PRINTER = read_printer("ender5")
REACH = (-110.0, 110.0)


def test_contacts_equal_the_slow_version() -> None:
    rng = np.random.default_rng(1)
    motor = rng.uniform(5, 15, 300)
    grid = np.arange(0, 20, 0.5)
    lower, upper = grid + 0.1 * np.sin(grid) - 0.4, grid + 0.1 * np.sin(grid) + 0.3
    at, side = np.empty(300, np.int64), np.empty(300, np.int8)
    kernels.touches(motor, 0.0, 2.0, lower, upper, motor[0], at, side)
    belt, row, branch = motor[0], -1, 0
    for i, m in enumerate(motor):
        low, high = np.interp(m, grid, lower), np.interp(m, grid, upper)
        after = naive_law.clip(belt, low, high)
        if after != belt:
            row, branch = i, -1 if after > belt else 1
        belt = after
        assert (at[i], side[i]) == (row, branch)
    assert set(side[1:]) == {-1, 1}


def test_columns_equal_the_slow_version() -> None:
    rng = np.random.default_rng(4)
    at, side, other = rng.uniform(-130, 130, 40), rng.choice([-1.0, 0.0, 1.0], 40), rng.uniform(-60, 60, 40)
    for turn, reach in ((40.0, REACH), (36.5, (-152.0, 147.5))):
        slow = [naive_meta.columns(*row, turn, reach) for row in zip(at, side, other, strict=True)]
        np.testing.assert_allclose(columns(at, side, other, turn, reach), slow, atol=1e-12)


def test_evidence_knows_no_order_and_the_posterior_is_that_of_eq_19() -> None:
    rng = np.random.default_rng(2)
    at, side, other = rng.uniform(-60, 60, 80), rng.choice([-1.0, 1.0], 80), rng.uniform(-60, 60, 80)
    phi, measured = columns(at, side, other, 40.0, REACH), rng.normal(0, 0.3, 80)
    assert phi.shape[1] == len(groups(REACH))
    assert set(groups(REACH)) == set(range(len(GROUPS)))
    weight = rng.uniform(0.1, 1.0, 80)
    order = rng.permutation(80)
    one = evidence(phi, measured, weight, at, 40.0)
    two = evidence(phi[order], measured[order], weight[order], at[order], 40.0)
    np.testing.assert_allclose(one.gram, two.gram, atol=1e-9)
    np.testing.assert_allclose(one.slope, two.slope, atol=1e-9)
    deviation = rng.uniform(0.01, 1.0, phi.shape[1])
    mean, covariance = posterior(np, one.gram, one.slope, deviation, 0.2)
    direct = np.linalg.inv((phi.T * weight) @ phi / 0.2**2 + np.diag(deviation**-2.0))
    np.testing.assert_allclose(covariance, direct, atol=1e-9)
    np.testing.assert_allclose(mean, direct @ (phi.T @ (weight * measured)) / 0.2**2, atol=1e-9)


def test_the_weights_are_small_and_fit_the_network() -> None:
    path = resources.files("printmend_lab.meta") / "meta.safetensors"
    assert len(path.read_bytes()) < 1_000_000
    said = forward(np, shipped(), np.zeros(FEATURES))
    assert said.shape == (OUTPUTS,)
    assert np.isfinite(said).all()


def test_a_seed_gives_the_same_lesson_whose_answer_is_the_drives() -> None:
    one, two = (draw_lesson(np.random.default_rng(4), draw_drive(np.random.default_rng(3), PRINTER), PRINTER)
                for _ in range(2))  # fmt: skip
    assert np.array_equal(one.evidence.gram, two.evidence.gram)
    assert np.array_equal(one.true_mm, two.true_mm)
    assert one.asked.shape == (len(one.true_mm), len(groups(REACH)))


@pytest.mark.parametrize(("kind", "points", "most_mm"), [("pulley-play", 250, 0.06), ("smooth", 250, 0.12)])
def test_few_points_of_a_fault_are_enough(kind: str, points: int, most_mm: float) -> None:
    """`smooth` is a kind of fault that no lesson was about. The bands hold what they say, roughly."""
    errors, inside = [], []
    for number in range(4):
        rng = np.random.default_rng([5, number])
        broken = sample(kind, rng)
        assert isinstance(broken, Corruption)
        twin = Twin.of(broken, PRINTER)
        way = path_print(PRINTER, SHAPES["zigzag"](PRINTER, rng), points)
        printed = twin.follow(way.waypoints_mm)
        measured = np.full(printed.shape, np.nan)
        measured[way.rows] = printed[way.rows] + rng.normal(0, 0.05, (points, 2))
        model = MetaLearner().fit(Trace(way.waypoints_mm, measured, homed=True), PRINTER, rng=rng)
        for motor in range(2):
            at = np.linspace(65, 155, 200)
            true = twin.homed().transmissions[motor].branches_mm(at)
            for said, right, sd in zip(
                model.mechanism.transmissions[motor].branches_mm(at), true, model.drives[motor].sd_mm(at), strict=True
            ):
                errors.append(np.sqrt(np.mean((said - right) ** 2)))
                inside.append(np.mean(np.abs(said - right) < 2 * sd + 0.003))
    assert np.median(errors) < most_mm
    assert np.mean(inside) > 0.75
