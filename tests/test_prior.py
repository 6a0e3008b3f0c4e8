"""The learned prior over pulleys: laws of shapes and mixtures, and what half a turn teaches."""

from functools import cache

import numpy as np
import pytest

from printmend.corruption import Corruption, Drive, EccentricBore, Ellipse, Polygon
from printmend.learn.learned import learn_model
from printmend.path import Trace
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend_lab.bench.case import drawn_body
from printmend_lab.greybox import Greybox, GreyboxModel
from printmend_lab.greybox.pulley.outline import ANGLES, HARMONICS, draw, kinds, series, turned
from printmend_lab.prior import PriorLearner
from printmend_lab.prior.mixture import ENTRIES, Component, Mixture, parse_weights, shape_posterior, shipped
from printmend_lab.prior.training import COMPONENTS, train
from printmend_lab.published import layer_trace

PRINTER = read_printer("ender5")
PHI = np.linspace(0, 2 * np.pi, ANGLES, endpoint=False)


@pytest.mark.parametrize("kind", kinds())
def test_shapes_are_convex_and_hold_the_shaft(kind: str, rng: np.random.Generator) -> None:
    shape = draw(kind, 3, rng)
    k = np.arange(1, HARMONICS + 1)
    cos, sin = np.cos(np.outer(PHI, k)), np.sin(np.outer(PHI, k))
    assert np.isfinite(shape).all()
    for row in shape:
        height = 1 + row[0] + cos @ (k * row[1 : HARMONICS + 1]) + sin @ (k * row[HARMONICS + 1 :])
        assert height.min() > 0
        # A smoothed curvature cannot be negative; the cut of the series at harmonic 32 rings at the corners.
        wave = np.maximum(1 - k / HARMONICS, 0)
        bent = 1 + row[0] + cos @ (wave * (1 - k**2) * k * row[1 : HARMONICS + 1])
        bent += sin @ (wave * (1 - k**2) * k * row[HARMONICS + 1 :])
        assert bent.min() > -0.02


def test_turning_a_shape_turns_its_outline(rng: np.random.Generator) -> None:
    height = 1 + 0.1 * np.cos(2 * PHI) + 0.05 * np.sin(3 * PHI + 1)
    by = 90
    moved = turned(series(height), np.array(by * 2 * np.pi / ANGLES))
    np.testing.assert_allclose(moved, series(np.roll(height, by)), atol=1e-12)


def test_training_repeats_and_knows_every_kind() -> None:
    assert set(COMPONENTS) == set(kinds())
    first, again = (train("ellipse", 60, 2, np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(first.mean, again.mean)
    assert first.weight.sum() == pytest.approx(1.0)
    # an ellipse has even harmonics alone
    assert np.abs(first.mean[:, 1 : HARMONICS + 1 : 2]).max() < 1e-6


def test_shipped_weights_hold_every_kind_but_the_authors() -> None:
    found = {each.kind for each in shipped().components}
    assert found == set(kinds())
    assert "published" not in found
    total = sum(each.weight for each in (*shipped().components, *shipped().plain))
    assert total == pytest.approx(1.0, abs=1e-5)


def test_broken_weights_are_refused() -> None:
    with pytest.raises(Exception, match=r"[Hh]eader|deserializ"):
        parse_weights(b"not weights")


def test_one_component_gives_the_linear_posterior(rng: np.random.Generator) -> None:
    usual = np.append(0.2, 0.1 * np.tile(np.arange(1, HARMONICS + 1), 2) ** -2.5)
    only = Component("plain", 1.0, np.zeros(ENTRIES), np.zeros((ENTRIES, 0)), usual**2, False)
    columns = rng.normal(size=(30, ENTRIES)) / usual
    matrix, slope = columns.T @ columns * 30, columns.T @ rng.normal(size=30)
    found = shape_posterior(Mixture((), (only,)), matrix, slope)
    covariance = np.linalg.inv(matrix + np.diag(usual**-2))
    scale = np.outer(usual, usual)
    np.testing.assert_allclose(found.covariance / scale, covariance / scale, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.mean / usual, covariance @ slope / usual, rtol=0, atol=1e-6)


@cache
def half_turn(kind: str, noise_mm: float, turns: float = 0.5) -> tuple[Twin, Trace]:
    pulleys = {
        "ellipse": (Ellipse(7.3, 5.4, 0.4), Ellipse(5.9, 6.8, 1.0)),
        "eccentric": (EccentricBore(0.8, 0.3), EccentricBore(0.5, 2.0)),
        "hexagon": (Polygon((7.0,) * 6, 0.2), Polygon((7.0,) * 6, 0.5)),
        "healthy": (None, None),
    }[kind]
    twin = Twin.of(Corruption((Drive(pulley=pulleys[0]), Drive(pulley=pulleys[1]))), PRINTER)
    rng = np.random.default_rng(8)
    layer = drawn_body(rng, PRINTER, size_mm=40 * turns).layers[0]
    trace = layer_trace(layer, twin.run(layer.controls, layer.start_steps), PRINTER)
    every = slice(None, None, 3)  # without play a row less is only a point less
    noisy = trace.measured_mm + rng.normal(0, noise_mm, trace.measured_mm.shape)
    return twin, Trace(trace.commanded_mm[every], noisy[every])


def turn_errors_mm(model: GreyboxModel, twin: Twin, trace: Trace) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of the branches over a turn [2, N] and their standard deviations, the offset taken off."""
    middle = (trace.commanded_mm.min(axis=0) + trace.commanded_mm.max(axis=0)) / 2
    errors, sds = [], []
    for motor, drive in enumerate(model.drives):
        at = middle[motor] + np.linspace(-20, 20, 201)
        away = [m.transmissions[motor].branches_mm(at)[0] for m in (model.mechanism, twin.mechanism)]  # type: ignore[union-attr]
        error = away[0] - away[1]
        errors.append(error - error[100])
        sds.append(drive.sd_mm(at)[0])
    return np.array(errors), np.array(sds)


def test_machines_differ_where_nobody_looked() -> None:
    """Half of an eccentric pulley may be half of one with a flat, or of an egg: few of these are far off."""
    _, trace = half_turn("eccentric", 0.05)
    model = PriorLearner().fit(trace, PRINTER, rng=np.random.default_rng(0))
    middle = (trace.commanded_mm.min(axis=0) + trace.commanded_mm.max(axis=0)) / 2
    for motor, drive in enumerate(model.drives):
        at = middle[motor] + np.linspace(-20, 20, 201)
        machines = drive.choice.machines
        assert machines is not None
        columns, _ = drive.choice.design.columns(at, drive.branches.period_mm, drive.branches.middle_mm)
        away = columns @ machines
        away -= away[75:126].mean(axis=0)
        seen, unseen = (np.sqrt((away[rows] ** 2).mean(axis=0)) for rows in (slice(75, 126), slice(0, 50)))
        assert np.median(unseen) > 2 * np.median(seen)
        assert unseen.max() > 3 * np.median(unseen)


def test_half_a_turn_tells_a_regular_pulley() -> None:
    """An ellipse is told below, through `learn`."""
    twin, trace = half_turn("hexagon", 0.05)
    error, sd = turn_errors_mm(PriorLearner().fit(trace, PRINTER, rng=np.random.default_rng(0)), twin, trace)
    assert np.sqrt((error**2).mean()) < 0.1
    # what is claimed is held: errors within five standard deviations and the roughness of pulleys
    assert (np.abs(error) < 5 * np.hypot(sd, 0.02)).all()
    for each in sd:  # what was not seen is less sure
        assert max(each[:20].mean(), each[-20:].mean()) > 1.5 * each[90:110].mean()


def test_more_than_a_turn_is_the_grey_box() -> None:
    _, trace = half_turn("ellipse", 0.05, 1.3)
    models = [each.fit(trace, PRINTER, rng=np.random.default_rng(0)) for each in (PriorLearner(), Greybox())]
    for one, other in zip(*(model.mechanism.transmissions for model in models), strict=True):
        np.testing.assert_array_equal(one.lower_mm, other.lower_mm)


def test_half_a_healthy_turn_is_healthy() -> None:
    _, trace = half_turn("healthy", 0.05)
    assert PriorLearner().fit(trace, PRINTER, rng=np.random.default_rng(0)).is_healthy


def test_auto_asks_the_prior_and_says_what_was_not_seen() -> None:
    twin, trace = half_turn("ellipse", 0.05)
    found = learn_model(trace, PRINTER, rng=np.random.default_rng(0))
    assert any("the rest is a guess" in line for line in found.findings)
    turn = trace.commanded_mm.mean(axis=0)[0] + np.linspace(-20, 20, 101)
    away = [m.transmissions[0].branches_mm(turn)[0] for m in (found.mechanism, twin.mechanism)]  # type: ignore[union-attr]
    assert np.std(away[0] - away[1]) < 0.1
