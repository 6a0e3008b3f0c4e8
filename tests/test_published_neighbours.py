"""The published nearest neighbours and straight lines, against slow versions of the textbook."""

import numpy as np
import pytest

from printmend.learn import fit, learner
from printmend.printer import read_printer
from printmend.twin import Twin
from printmend_lab.control.registry import controller
from printmend_lab.path import Layer
from printmend_lab.published import layer_trace, network, transitions_of
from printmend_lab.published.neighbours import KNN, LINEAR
from printmend_lab.sampling import sample

PRINTER = read_printer("ender5")
START = np.array([500, 500])


def printed():
    rng = np.random.default_rng(3)
    layer = Layer(0, 0.2, START, rng.integers(-1, 2, (200, 2)), np.ones(200, bool))
    twin = Twin.of(sample("pulley", np.random.default_rng(5)), PRINTER)
    return layer_trace(layer, twin.run(layer.controls, START), PRINTER)


def test_nearest_neighbours_are_the_mean_of_the_five_nearest_rows() -> None:
    trace = printed()
    data = transitions_of(trace, PRINTER)
    rows = np.concatenate([data.nominal_steps, data.controls], axis=1)
    model = fit(f"{KNN.__class__.__module__}:KNN", trace, PRINTER, rng=np.random.default_rng(0))
    asked = np.array([500.3, 499.6, 1.0, -1.0])  # no two rows are equally near
    nearest = np.argsort(((rows - asked) ** 2).sum(axis=1), kind="stable")
    distance = np.sort(((rows - asked) ** 2).sum(axis=1))
    wanted = data.displacement_steps[nearest[:5]].mean(axis=0)
    found = model.predict(asked[None])[0]
    if distance[4] < distance[5]:
        np.testing.assert_allclose(found, wanted, atol=1e-12)
    moves = model.advance(model.start(START), np.array([[2, 0], [2, 0], [0, 3]])).position_steps
    np.testing.assert_array_equal(moves[0], moves[1])
    assert moves[0, 1] == moves[2, 0] == 500.0, "an axis at rest stays"


def test_a_line_is_that_of_least_squares_and_plans() -> None:
    trace = printed()
    data = transitions_of(trace, PRINTER)
    rows = np.concatenate([data.nominal_steps, data.controls], axis=1).astype(float)
    model = LINEAR.fit(trace, PRINTER, rng=np.random.default_rng(0))
    design = np.column_stack([np.ones(len(rows)), rows])
    weights = np.linalg.lstsq(design, data.displacement_steps, rcond=None)[0]
    np.testing.assert_allclose(model.predict(rows), design @ weights, atol=1e-9)
    targets = START + np.cumsum(np.ones((20, 2)), axis=0)
    plan = controller("greedy").plan(model, targets, START)
    assert np.abs(plan.imagined_steps[1:] - targets).max() < 3
    by_axis = learner("linear-axis").fit(trace, PRINTER, rng=np.random.default_rng(0))
    assert by_axis.tabulate(START) is not None


def test_a_network_fits_what_a_line_cannot_the_same_way_each_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network, "UPDATES", 300)
    trace = printed()
    data = transitions_of(trace, PRINTER)
    rows = np.concatenate([data.nominal_steps, data.controls], axis=1).astype(float)
    line, one, again = (
        fit(f"printmend_lab.published.{name}", trace, PRINTER, rng=np.random.default_rng(0))
        for name in ("neighbours:LINEAR", "network:NETWORK", "network:NETWORK")
    )
    misses = [np.sqrt(np.mean((model.predict(rows) - data.displacement_steps) ** 2)) for model in (line, one)]
    assert misses[1] < 0.7 * misses[0], misses
    np.testing.assert_array_equal(one.predict(rows), again.predict(rows))
    targets = START + np.cumsum(np.ones((20, 2)), axis=0)
    plan = controller("greedy").plan(one, targets, START)
    assert np.abs(plan.imagined_steps[1:] - targets).max() < 3
