"""Laws of the metrics of drawn shapes, and the paper's Fig. 4."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from printmend.errors import TraceError
from printmend.metrics import rmse
from printmend_lab.shape import bead_difference_area, frechet, symmetric_difference_area

paths = arrays(float, (6, 2), elements=st.integers(-20, 20).map(float))
SQUARE = np.array([[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]], float)


def circle(radius: float, points: int, phase: float = 0.0) -> np.ndarray:
    phi = phase + np.linspace(0, 2 * np.pi, points)
    return radius * np.stack([np.cos(phi), np.sin(phi)], axis=1)


@given(paths, paths, paths)
def test_frechet_is_a_metric_and_bounds_hausdorff(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> None:
    assert frechet(a, a) == 0
    assert frechet(a, b) == frechet(b, a)
    assert frechet(a, c) <= frechet(a, b) + frechet(b, c) + 1e-9
    assert shapely.LineString(a).hausdorff_distance(shapely.LineString(b)) <= frechet(a, b) + 1e-9


def test_areas_of_known_figures() -> None:
    shifted = np.add(SQUARE, (5, 0))
    hole = SQUARE * 0.5 + 2.5
    assert symmetric_difference_area([SQUARE], [SQUARE]) == 0
    assert (
        symmetric_difference_area([SQUARE], [shifted])
        == symmetric_difference_area([shifted], [SQUARE])
        == pytest.approx(100)
    )
    assert symmetric_difference_area([SQUARE], [SQUARE, hole]) == pytest.approx(25)
    assert symmetric_difference_area([SQUARE], []) == pytest.approx(100)
    line = [np.array([[0, 0], [10, 0]], float)]
    away = [np.add(line[0], (0, 100))]
    one = shapely.LineString(line[0]).buffer(0.2).area
    assert bead_difference_area(line, line, 0.4) == 0
    assert bead_difference_area(line, away, 0.4) == pytest.approx(2 * one, rel=1e-3)


def test_area_and_pointwise_metrics_disagree_as_in_the_papers_figure_4() -> None:
    """One print covers the target exactly and misses every point; another is near every point and covers less.

    Each metric calls the other print the better one, so neither can stand for the other.
    """
    target = circle(20, 201)
    same_figure = circle(20, 201, phase=np.pi)
    nearby_points = target * (1 + 0.05 * np.cos(40 * np.linspace(0, 2 * np.pi, 201))[:, None])
    area = [symmetric_difference_area([target], [printed]) for printed in (same_figure, nearby_points)]
    pointwise = [rmse(target, printed) for printed in (same_figure, nearby_points)]
    assert area[0] < 1e-6 < area[1]
    assert pointwise[1] < 1 < 39 < pointwise[0]


@pytest.mark.parametrize("points", [np.zeros((1, 2)), np.zeros((4, 3)), np.array([[0, 0], [np.nan, 1]])])
def test_paths_that_are_no_paths_are_refused(points: np.ndarray) -> None:
    with pytest.raises(TraceError):
        frechet(SQUARE, points)


def test_a_bead_needs_a_width() -> None:
    with pytest.raises(TraceError, match="above 0"):
        bead_difference_area([SQUARE], [SQUARE], 0.0)
