"""The grey box's compiled loops and moments against slow versions."""

from dataclasses import replace

import numpy as np
import pytest

from printmend_lab.greybox.drive import CROSS, Contacts, Design, Rows, Structure, contacts, normal_equations
from printmend_lab.greybox.drive.fit import lower_inverse
from printmend_lab.greybox.drive.kernels import lengths_left, settle, turning_rows
from tests.naive_greybox import column_matrix, follow_play, length_left, settled_prior

DESIGN = Design(3, 2, CROSS, (20, 40), (1, 2, 3, 6), (1, 3), (1, 2), 4, (20.0, 190.0))
SECOND = replace(DESIGN, warp_span_mm=(-20.0, 220.0), second_harmonics=(1, 2), second_mm=24.5)
DESIGNS = [(DESIGN, 0), (DESIGN, 1), (SECOND, 2), (SECOND, 3)]


def rows(rng: np.random.Generator, count: int = 400) -> Rows:
    motor = np.abs(np.cumsum(rng.normal(0, 4, count))) % 200
    measured = motor + rng.normal(0, 0.2, count)
    measured[rng.random(count) < 0.2] = np.nan
    weight = np.where(np.isnan(measured), 0.0, rng.uniform(0.5, 1.0, count))
    other = rng.uniform(-100, 100, count)
    return Rows(motor, measured, weight, motor - 100, other, 40.0, 7.0, float(motor[0]), (100.0, 100.0))


def values(design: Design, rng: np.random.Generator) -> np.ndarray:
    parameters = rng.normal(0, 0.05, design.size)
    parameters[design.parts["play_powers"]] = 2.0, 0.3
    return parameters


@pytest.mark.parametrize(("design", "seed"), DESIGNS)
def test_contacts_agree_with_the_slow_loop(design: Design, seed: int) -> None:
    rng = np.random.default_rng(seed)
    row, parameters = rows(rng), values(design, rng)
    touch = contacts(design, parameters, row)
    branches = design.branches(parameters, period_mm=40.0, origin_mm=7.0, reach_mm=(-1e3, 1e3))
    at, side, belt = follow_play(row, branches, row.start_mm + parameters[0])
    np.testing.assert_array_equal(touch.at, at)
    np.testing.assert_array_equal(touch.side, side)
    np.testing.assert_allclose(touch.belt_mm, belt, atol=1e-4)  # the kernel interpolates a table of the turn
    matrix = column_matrix(design, row, touch.at, touch.side)
    frame = matrix[:, design.parts["cross"]] @ parameters[design.parts["cross"]]
    np.testing.assert_allclose(touch.residual_mm, row.measured_mm - belt - frame, atol=1e-4)


@pytest.mark.parametrize(("design", "seed"), DESIGNS)
def test_moments_give_the_normal_equations(design: Design, seed: int) -> None:
    """Every product of two columns follows from the moments; the binning of the phase costs little."""
    rng = np.random.default_rng(seed)
    row, parameters = rows(rng), values(design, rng)
    touch = contacts(design, parameters, row)
    weight = row.weight * rng.uniform(0, 1, len(row))
    normal = normal_equations(design, parameters, row, touch, weight)
    matrix = column_matrix(design, row, touch.at, touch.side)
    residual = np.nan_to_num(touch.residual_mm)
    np.testing.assert_allclose(normal.matrix, (matrix * weight[:, None]).T @ matrix, atol=2e-2 * weight.sum())
    low = design.harmonic < 4
    exact = (matrix[:, low] * weight[:, None]).T @ matrix[:, low]
    np.testing.assert_allclose(normal.matrix[np.ix_(low, low)], exact, atol=2e-4 * weight.sum())
    np.testing.assert_allclose(normal.slope[low], matrix[:, low].T @ (weight * residual), atol=2e-4 * weight.sum())
    assert normal.square == pytest.approx(float(weight @ residual**2))


def test_long_traces_are_added_in_chunks(monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> None:
    from printmend_lab.greybox.drive import design as greybox_design

    row, parameters = rows(rng), values(DESIGN, rng)
    touch = contacts(DESIGN, parameters, row)
    whole = normal_equations(DESIGN, parameters, row, touch, row.weight)
    monkeypatch.setattr(greybox_design, "CHUNK_ROWS", 37)
    again: Contacts = contacts(DESIGN, parameters, row)
    np.testing.assert_allclose(again.residual_mm, touch.residual_mm, atol=1e-12)
    parts = normal_equations(DESIGN, parameters, row, again, row.weight)
    np.testing.assert_allclose(parts.matrix, whole.matrix, atol=1e-9)
    np.testing.assert_allclose(parts.slope, whole.slope, atol=1e-9)


def test_turning_rows_keep_every_reversal(rng: np.random.Generator) -> None:
    """The play ends at the same place when only turning points are followed: moves between them are monotone."""
    motor = np.round(np.cumsum(rng.normal(0, 1, 300)), 1)
    wanted = rng.random(300) < 0.1
    keep = np.zeros(300, bool)
    turning_rows(motor, wanted, keep)
    assert keep[wanted].all()
    assert keep[0]
    assert keep[-1]
    place, thin, kept = 0.0, 0.0, []
    for t, m in enumerate(motor):
        place = min(max(place, m - 0.7), m + 0.7)
        if keep[t]:
            thin = min(max(thin, m - 0.7), m + 0.7)
            kept.append(abs(thin - place))
    assert max(kept) == 0.0


def test_designs_hand_parameters_over(rng: np.random.Generator) -> None:
    small, large = Structure(play="constant").design(8, ()), Structure(play="free", drift=True).design(16, (50,))
    parameters = rng.normal(size=small.size)
    there = large.moved(parameters, small)
    np.testing.assert_array_equal(small.moved(there, large), parameters)
    assert np.count_nonzero(there) == small.size


@pytest.mark.parametrize("size", [0, 1, 2, 33])
def test_a_triangular_inverse_is_the_inverse(size: int, rng: np.random.Generator) -> None:
    matrix = rng.normal(size=(size, 2 * size))
    factor = np.linalg.cholesky(matrix @ matrix.T + np.eye(size))
    np.testing.assert_allclose(lower_inverse(factor), np.linalg.inv(factor), atol=1e-13)


def test_the_prior_settles_as_the_formulas_say(rng: np.random.Generator) -> None:
    columns, truth = rng.normal(size=(80, 9)), np.array([3.0, -2.0, 1.0, 0.3, 0.1, -0.2, 0.0, 0.0, 0.0])
    seen = columns @ truth + rng.normal(0, 0.1, 80)
    matrix, slope, square = columns.T @ columns, columns.T @ seen, float(seen @ seen)
    group, most = np.array([3, 3, 0, 0, 0, 1, 1, 1, 1]), np.array([10.0, 0.15, 10.0])
    usual, scales = rng.uniform(0.5, 2.0, 9), np.array([1.0, 0.1, 0.3, 1.0])
    values, covariance, learned, sigma2 = settled_prior(
        matrix, slope, square, 80.0, usual, group, most, scales, 0.5, 1e-6, 0.95, 4
    )
    about = rng.normal(size=9)
    pull, left = slope - matrix @ about, float(np.square(seen - columns @ about).sum())
    ours, root, whitened = np.empty(9), np.empty(9), np.empty((9, 9))
    found, misfit, log_det = settle(
        matrix, slope, pull, about, left, 80.0, usual, group, most, scales, 0.5, 1e-6, 0.95, 4, ours, root, whitened
    )
    np.testing.assert_allclose(ours, values, atol=1e-10)
    np.testing.assert_allclose((whitened.T @ whitened) * np.outer(root, root), covariance, atol=1e-12)
    np.testing.assert_allclose(scales, learned, rtol=1e-10)
    assert found == pytest.approx(sigma2)
    assert misfit == pytest.approx(float(np.square(seen - columns @ values).sum()))
    assert log_det == pytest.approx(-np.linalg.slogdet(covariance / np.outer(root, root))[1])


@pytest.mark.parametrize("fading", [False, True])
def test_what_the_waves_of_a_length_leave_is_that_of_least_squares(fading: bool) -> None:
    rng = np.random.default_rng(5)
    motor, side = rng.uniform(0, 200, 150), rng.choice([-1.0, 1.0], 150)
    along, weight = (motor - 100) / 100, rng.uniform(0, 1, 150)
    fixed = np.stack([np.ones(150), along, side], axis=1)
    error = 0.3 * np.sin(motor / 5.0) + rng.normal(0, 0.05, 150)
    lengths, left = np.array([10 * np.pi, 40.0, 17.3]), np.empty(3)
    lengths_left(lengths, motor, side, along, fixed, error, weight, 5, 2, fading, left)
    for length, one in zip(lengths, left, strict=True):
        wanted = length_left(length, motor, side, along, fixed, error, weight, 5, 2, fading)
        assert one == pytest.approx(wanted, rel=1e-6)
    assert left[0] < 0.1 * left[1]
