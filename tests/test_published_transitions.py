"""From traces to rows."""

import numpy as np
import pytest

from printmend.errors import TraceError
from printmend.path import Trace
from printmend.printer import Printer
from printmend_lab.published import layer_trace, transitions_of
from tests.shapes import ring_layer

LAYER = ring_layer((530.0, 530.0), 40.0)


def test_a_layer_comes_back_exactly(printer: Printer, rng: np.random.Generator) -> None:
    printed = LAYER.nominal_steps + rng.normal(size=(LAYER.transitions + 1, 2))
    data = transitions_of(layer_trace(LAYER, printed, printer), printer)
    np.testing.assert_array_equal(data.nominal_steps, LAYER.nominal_steps[:-1])
    np.testing.assert_array_equal(data.controls, LAYER.controls)
    np.testing.assert_allclose(data.displacement_steps, np.diff(printed, axis=0), rtol=0, atol=1e-9)


def test_long_moves_are_walked_tick_by_tick(ender5: Printer) -> None:
    """Each tick moves each axis by at most one step; the measured displacement is shared out among an axis's steps."""
    commanded = np.array([[2.0, 4.0], [3.0, 3.6]])  # +5 and −2 steps from (10, 20)
    data = transitions_of(Trace(commanded, commanded * [1.1, 0.5]), ender5)
    assert data.nominal_steps[:, 0].tolist() == [10, 11, 12, 13, 14]
    assert data.controls[:, 0].tolist() == [1] * 5
    assert data.controls[:, 1].sum() == -2
    np.testing.assert_allclose(data.displacement_steps, data.controls * [1.1, 0.5], rtol=0, atol=1e-12)


def test_moves_off_the_lattice_keep_their_gain(ender5: Printer, rng: np.random.Generator) -> None:
    commanded = 100 + rng.uniform(-1, 1, (400, 2)).cumsum(axis=0)
    data = transitions_of(Trace(commanded, commanded * [1.1, 0.5]), ender5)
    assert set(data.controls.ravel()) <= {-1, 0, 1}
    np.testing.assert_allclose(data.displacement_steps, data.controls * [1.1, 0.5], rtol=0, atol=1e-9)


def test_unmeasured_rows_resting_rows_and_layer_changes_are_left_out(ender5: Printer) -> None:
    commanded = np.array([[10.0, 10], [11, 10], [12, 10], [12, 10], [13, 10], [14, 10], [15, 10]])
    measured = commanded.copy()
    measured[1, 0] = np.nan
    layer = np.array([0, 0, 0, 0, 0, 1, 1])
    data = transitions_of(Trace(commanded, measured, layer=layer), ender5)
    assert data.nominal_steps[:, 0].tolist() == [*range(60, 65), *range(70, 75)]  # 12 → 13 mm and 14 → 15 mm


def test_nothing_to_learn_from_is_an_error(ender5: Printer) -> None:
    with pytest.raises(TraceError):
        transitions_of(Trace(np.zeros((1, 2)), np.zeros((1, 2))), ender5)
