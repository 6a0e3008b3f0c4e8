"""Laws of the paired metrics, and the paper's own convention."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from printmend.errors import TraceError
from printmend.metrics import aligned, aligned_rmse, rmse

paths = arrays(float, (7, 2), elements=st.floats(-100, 100, width=32))


def turned(points: np.ndarray, angle: float, shift: tuple[float, float]) -> np.ndarray:
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return points @ rotation.T + shift


@given(paths, paths, paths)
def test_rmse_is_a_metric(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> None:
    assert rmse(a, a) == 0
    assert rmse(a, b) == rmse(b, a)
    assert rmse(a, c) <= rmse(a, b) + rmse(b, c) + 1e-9
    assert (rmse(a, b) > 0) == bool(np.any(a != b)) or np.abs(a - b).max() < 1e-150


def test_rmse_counts_both_coordinates_in_one_distance() -> None:
    """The published convention: a 3-4-5 error at every point is 5, not 5/√2."""
    target = np.zeros((4, 2))
    assert rmse(target, np.add(target, (3, 4))) == 5
    assert rmse(target, np.add(target, (1, 0))) == 1


@given(paths, paths, st.floats(-3.2, 3.2), st.tuples(st.floats(-50, 50), st.floats(-50, 50)))
def test_aligned_rmse_ignores_rigid_motion_and_never_exceeds_rmse(
    a: np.ndarray, b: np.ndarray, angle: float, shift: tuple[float, float]
) -> None:
    assert aligned_rmse(a, b) <= rmse(a, b) + 1e-9
    assert aligned_rmse(a, turned(b, angle, shift)) == pytest.approx(aligned_rmse(a, b), abs=1e-6)
    assert aligned_rmse(a, turned(a, angle, shift)) == pytest.approx(0, abs=1e-9)


def test_alignment_is_the_best_of_all_rotations(rng: np.random.Generator) -> None:
    """Against a slow search over angles, with the centroids matched."""
    a, b = rng.normal(size=(2, 30, 2))
    centred = b - b.mean(axis=0)
    slow = min(rmse(a - a.mean(axis=0), turned(centred, angle, (0, 0))) for angle in np.linspace(-np.pi, np.pi, 20001))
    assert aligned_rmse(a, b) == pytest.approx(slow, abs=1e-6)
    assert aligned(a, b).mean(axis=0) == pytest.approx(a.mean(axis=0))


def test_alignment_does_not_reflect() -> None:
    letter = np.array([[0, 0], [0, 3], [2, 3], [0, 2], [1, 1]], float)
    assert aligned_rmse(letter, letter * [-1, 1]) > 0.5


@pytest.mark.parametrize(
    ("target", "printed"),
    [
        (np.zeros((3, 2)), np.zeros((4, 2))),
        (np.zeros((0, 2)), np.zeros((0, 2))),
        (np.zeros((3, 2)), np.full((3, 2), np.nan)),
    ],
)
def test_points_that_do_not_pair_up_are_refused(target: np.ndarray, printed: np.ndarray) -> None:
    with pytest.raises(TraceError):
        rmse(target, printed)
