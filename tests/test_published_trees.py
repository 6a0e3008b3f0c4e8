"""Trees as arrays against the libraries that grew them; the published features against their description."""

import warnings
from typing import TYPE_CHECKING

import numpy as np
import pytest

from printmend.errors import ModelError, TraceError
from printmend.learn import fit
from printmend.machine import lattice_tables
from printmend.path import Trace
from printmend.printer import Printer
from printmend.twin import Twin
from printmend_lab.published import AxisModel, Ensemble, from_forest, from_lightgbm, layer_trace
from printmend_lab.published.trees import JointTreeModel
from printmend_lab.sampling import sample
from tests.shapes import layer_along, ring_layer

if TYPE_CHECKING:
    from lightgbm import LGBMRegressor

LAYER = ring_layer((530.0, 530.0), 60.0)
SILENT = {"verbosity": -1, "n_jobs": 1, "deterministic": True, "force_col_wise": True}


@pytest.fixture
def twin(ender5: Printer, rng: np.random.Generator) -> Twin:
    return Twin.of(sample("gain-table", rng), ender5)


@pytest.fixture
def trace(twin: Twin) -> Trace:
    return layer_trace(LAYER, twin.run(LAYER.controls, LAYER.start_steps), twin.printer)


def boosted(**options: object) -> "LGBMRegressor":
    """Return LightGBM's learner. The library is imported here: each worker reads this file, and one runs it."""
    from lightgbm import LGBMRegressor

    return LGBMRegressor(**options)


def sklearn_predict(model: object, rows: np.ndarray) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # scikit-learn misses the column names that LightGBM invents
        return model.predict(rows)  # type: ignore[attr-defined]


@pytest.mark.parametrize("rows", [60, 5000])
def test_lightgbm_text_predicts_as_lightgbm(rows: int, rng: np.random.Generator) -> None:
    x = rng.normal(size=(rows, 4)).round(1)
    y = np.sin(3 * x[:, 0]) * x[:, 1] + (x[:, 2] > 0.3)
    model = boosted(**SILENT).fit(x, y)
    ours = from_lightgbm(model.booster_.model_to_string())
    probe = rng.normal(size=(3000, 4)).round(1)
    np.testing.assert_array_equal(ours.predict(probe)[:, 0], sklearn_predict(model, probe))


@pytest.mark.parametrize("outputs", [1, 2])
def test_forest_predicts_as_scikit_learn(outputs: int, rng: np.random.Generator) -> None:
    from sklearn.ensemble import RandomForestRegressor

    x = rng.integers(0, 200, (800, 3)).astype(float)
    y = np.stack([np.sin(x[:, 0] / 20), x[:, 1] * x[:, 2]], axis=1)[:, :outputs]
    model = RandomForestRegressor(random_state=1).fit(x, y if outputs == 2 else y[:, 0])
    probe = rng.integers(0, 200, (1000, 3)).astype(float)
    ours = from_forest(model).predict(probe)
    np.testing.assert_array_equal(ours, model.predict(probe).reshape(len(probe), -1))


@pytest.mark.parametrize("name", ["lightgbm", "forest"])
def test_painted_cells_equal_predictions(name: str, trace: Trace, ender5: Printer, rng: np.random.Generator) -> None:
    model = fit(name, trace, ender5, rng=rng)
    assert isinstance(model, JointTreeModel)
    tables = model.tabulate(LAYER.start_steps)
    nominal, signs = rng.integers(0, 1101, (4000, 2)), rng.integers(-1, 2, (4000, 2))
    cells = tables.unit_steps[
        tables.cells[0][nominal[:, 0]], tables.cells[1][nominal[:, 1]], signs[:, 0] + 1, signs[:, 1] + 1
    ]
    np.testing.assert_array_equal(cells, model.unit_displacement(nominal, signs))


def test_joint_row_is_the_published_one(twin: Twin, trace: Trace, ender5: Printer, rng: np.random.Generator) -> None:
    """Default regressors from (x, y, cx, cy) to each displacement, predicted for signs, times |c| (physics.md §8.1)."""
    model = fit("lightgbm", trace, ender5, rng=rng)
    printed, nominal = twin.run(LAYER.controls, LAYER.start_steps), LAYER.nominal_steps
    rows = np.concatenate([nominal[:-1], LAYER.controls], axis=1).astype(float)
    by_hand = [boosted(**SILENT).fit(rows, np.diff(printed[:, axis])) for axis in range(2)]
    state = model.advance(model.start(np.array([530, 540])), np.array([[2, -3], [0, 1]]))
    probe = np.array([[530, 540, 1, -1], [530, 540, 0, 1]], float)
    expected = np.stack([sklearn_predict(regressor, probe) for regressor in by_hand], axis=1)
    expected = [530, 540] + expected * [[2, 3], [0, 1]]
    np.testing.assert_allclose(state.position_steps, expected, rtol=0, atol=1e-6)


def test_axis_row_is_the_published_one(twin: Twin, trace: Trace, ender5: Printer, rng: np.random.Generator) -> None:
    """Rows in which the axis moved; nominal position → displacement × c; prediction × c (physics.md §8.1)."""
    model = fit("lightgbm-axis", trace, ender5, rng=rng)
    printed, nominal = twin.run(LAYER.controls, LAYER.start_steps), LAYER.nominal_steps
    for axis in range(2):
        moves = LAYER.controls[:, axis] != 0
        values = np.diff(printed[:, axis])[moves] * LAYER.controls[moves, axis]
        regressor = boosted(**SILENT).fit(nominal[:-1][moves, axis, None].astype(float), values)
        controls = np.zeros((7, 2), int)
        controls[:, axis] = np.arange(-3, 4)
        state = model.advance(model.start(np.array([541, 541])), controls)
        expected = 541 + sklearn_predict(regressor, np.array([[541.0]])) * np.arange(-3, 4)
        np.testing.assert_allclose(state.position_steps[:, axis], expected, rtol=0, atol=1e-6)


def test_periodic_row_repeats_every_turn(trace: Trace, ender5: Printer, rng: np.random.Generator) -> None:
    model = fit("lightgbm-axis-periodic", trace, ender5, rng=rng)
    assert isinstance(model, AxisModel)
    for gains in model.gains:
        np.testing.assert_array_equal(gains[:900], gains[200:1100])


def test_texts_that_are_no_trees_are_refused(rng: np.random.Generator) -> None:
    regressor = boosted(n_estimators=2, verbosity=-1).fit(rng.uniform(size=(2000, 2)), rng.uniform(size=2000))
    text = regressor.booster_.model_to_string()
    for broken in (
        "",
        text.replace("left_child=", "left_child=x", 1),
        text.replace("num_leaves=31", "num_leaves=9", 1),
    ):
        with pytest.raises(ModelError):
            from_lightgbm(broken)
    loop = np.zeros(1, int)
    with pytest.raises(ModelError, match="children after"):
        Ensemble(loop, np.zeros(1), loop, loop, np.zeros((1, 1)), loop)


def test_an_axis_that_never_moved_is_healthy(ender5: Printer, rng: np.random.Generator) -> None:
    line = layer_along(np.array([[300, 500], [700, 500]]))
    trace = layer_trace(line, line.nominal_steps * [0.9, 1.0] + [30, 0], ender5)
    model = fit("lightgbm-axis", trace, ender5, rng=rng)
    assert isinstance(model, AxisModel)
    np.testing.assert_allclose(model.gains[0], 0.9, atol=1e-6)
    np.testing.assert_array_equal(model.gains[1], 1.0)


def test_learns_from_a_few_long_moves(ender5: Printer, rng: np.random.Generator) -> None:
    """A way-point trace with long segments, 60 points, gaps: a scale error is found all the same."""
    corners = rng.uniform(80, 130, (60, 2))
    measured = corners * [1.1, 0.95]
    measured[rng.integers(0, 60, 12)] = np.nan
    for name in ("lightgbm", "lightgbm-axis", "forest", "forest-axis"):
        model = fit(name, Trace(corners, measured), ender5, rng=rng)
        state = model.advance(model.start(np.array([500, 500])), np.array([[1, 1], [-1, -1]]))
        np.testing.assert_allclose(state.position_steps - 500, [[1.1, 0.95], [-1.1, -0.95]], atol=0.1)


def test_a_trace_without_moves_is_refused(ender5: Printer, rng: np.random.Generator) -> None:
    rest = np.full((5, 2), 100.0)
    for trace in (Trace(rest, rest), Trace(np.arange(10.0).reshape(5, 2), np.full((5, 2), np.nan))):
        with pytest.raises(TraceError, match="expected at least one commanded move"):
            fit("lightgbm-axis", trace, ender5, rng=rng)


def test_mechanism_of_axis_gains_returns_to_where_it_was(ender5: Printer, rng: np.random.Generator) -> None:
    """Forward and back: the mechanism moves by the mean gain of the step's two ends, and has no play."""
    gains = (rng.uniform(0.8, 1.2, 1101), np.ones(1101))
    mechanism = AxisModel(ender5, gains).mechanism
    assert mechanism is not None
    assert all(transmission.is_taut for transmission in mechanism.transmissions)
    tables = lattice_tables(mechanism, np.array([500, 500]))
    motor = tables.motors[0]
    step = motor.lower_steps[motor.start + 1] - motor.lower_steps[motor.start]
    assert step == pytest.approx((gains[0][500] + gains[0][501]) / 2)
    beyond = motor.lower_steps[-1] - motor.lower_steps[-2]
    assert beyond == pytest.approx(1.0)


def test_published_order_of_the_rows(ender5: Printer) -> None:
    """Table I's order on layers that were not trained on: Naive > LightGBM > per-axis LightGBM ≥ Oracle."""
    from printmend_lab.control.greedy import Greedy

    errors: dict[str, list[float]] = {}
    for seed in range(2):
        rng = np.random.default_rng(seed)
        twin = Twin.of(sample("gain-table", rng), ender5)
        layers = [ring_layer((540.0, 560.0), 120 - 15 * k, turn=0.3 * k, index=k) for k in range(3)]
        trace = layer_trace(layers[0], twin.run(layers[0].controls, layers[0].start_steps), ender5)
        for name in ("naive", "lightgbm", "lightgbm-axis", "oracle"):
            model = fit(name, trace, ender5, rng=rng, truth=twin.mechanism)
            for layer in layers[1:]:
                plan = Greedy().plan(model, layer.nominal_steps[1:], layer.start_steps)
                missed = twin.run(plan.controls, layer.start_steps) - layer.nominal_steps
                errors.setdefault(name, []).append(float(np.sqrt((missed**2).sum(axis=1).mean())))
    naive, joint, axis, oracle = (float(np.mean(row)) for row in errors.values())
    assert naive > 2 * joint
    assert joint > axis
    assert axis >= oracle - 0.01
    assert oracle < 0.45
