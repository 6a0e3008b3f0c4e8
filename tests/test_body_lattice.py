"""Laws of the lattice path: it follows the line within half a step, is 8-connected, and never drifts."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printmend.errors import GcodeError
from printmend.printer import Printer, read_printer
from printmend_lab.body.kernels import UNITS
from printmend_lab.body.layers import follow_polyline, to_steps
from tests import naive_body

# Multiples of 1/8 step meet every tie of the rounding; 1/1000 step is ordinary G-code.
coordinate = st.one_of(st.integers(-32, 32).map(lambda n: n / 8), st.integers(-4000, 4000).map(lambda n: n / 1000))
polylines = st.lists(st.tuples(coordinate, coordinate), min_size=2, max_size=12).map(np.array)


def nodes_of(points: np.ndarray, drawing: np.ndarray) -> np.ndarray:
    start, controls, _ = follow_polyline(points, drawing)
    return np.vstack([start, start + np.cumsum(controls, axis=0, dtype=np.int64)])


@settings(max_examples=250, deadline=None)
@given(polylines, st.integers(0, 2**12 - 1))
def test_kernel_equals_the_obvious_version(points: np.ndarray, bits: int) -> None:
    drawing = np.array([bool(bits >> k & 1) for k in range(len(points) - 1)])
    nodes, flags, _ = naive_body.follow(points, drawing)
    _start, controls, extruding = follow_polyline(points, drawing)
    if not nodes:
        assert len(controls) == 0
        return
    assert [tuple(n) for n in nodes_of(points, drawing).tolist()] == nodes
    assert extruding.tolist() == flags


@settings(max_examples=250, deadline=None)
@given(polylines)
def test_path_is_eight_connected_and_within_half_a_step_of_its_segment(points: np.ndarray) -> None:
    drawing = np.ones(len(points) - 1, bool)
    _start, controls, _ = follow_polyline(points, drawing)
    if len(controls):
        assert np.abs(controls).max() == 1
        assert np.abs(controls).max(axis=1).min() == 1, "a tick must move"
    nodes, _, owners = naive_body.follow(points, drawing)
    for node, k in zip(nodes, owners, strict=True):
        assert naive_body.distance_to_segment(np.array(node), points[k], points[k + 1]) <= 0.5 + 2 / UNITS


@settings(max_examples=150, deadline=None)
@given(polylines)
def test_every_point_of_the_line_has_a_node_nearby(points: np.ndarray) -> None:
    nodes = nodes_of(points, np.ones(len(points) - 1, bool))
    for p, q in itertools.pairwise(points):
        for t in np.linspace(0, 1, 9):
            # Between four nodes (a tip in the middle of a cell) the line may pass the path by √5/2.
            assert np.linalg.norm(nodes - (p + t * (q - p)), axis=1).min() <= np.sqrt(5) / 2 + 2 / UNITS


def test_long_chains_do_not_drift(rng: np.random.Generator) -> None:
    """Thousands of short moves end where one long move would: on the rounding of the last way-point."""
    points = np.cumsum(rng.normal(0.0, 0.4, (20_000, 2)), axis=0)
    points = np.vstack([points, np.rint(points[-1])])
    nodes = nodes_of(points, np.ones(len(points) - 1, bool))
    assert np.array_equal(nodes[-1], points[-1])


def test_a_straight_line_needs_as_many_ticks_as_its_longer_side() -> None:
    start, controls, extruding = follow_polyline(np.array([[0.0, 0.0], [1000.0, 371.0]]), np.array([True]))
    assert len(controls) == 1000
    assert controls.sum(axis=0).tolist() == [1000, 371]
    assert extruding.all()
    assert start.tolist() == [0, 0]


def test_reversed_line_visits_the_same_nodes_where_nothing_ties() -> None:
    points = np.array([[0.1, 0.2], [97.3, 41.7]])
    there = nodes_of(points, np.array([True]))
    back = nodes_of(points[::-1], np.array([True]))
    assert np.array_equal(there, back[::-1])


def test_flags_follow_their_segments() -> None:
    points = np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 5.0], [0.0, 5.0]])
    _, _, extruding = follow_polyline(points, np.array([True, False, True]))
    assert extruding.tolist() == [True] * 5 + [False] * 5 + [True] * 5


def test_a_path_between_the_nodes_stands_still() -> None:
    _, controls, _ = follow_polyline(np.array([[0.5, 0.5], [0.55, 0.45]]), np.array([True]))
    assert len(controls) == 0


def test_steps_count_from_the_lower_corner(printer: Printer) -> None:
    corner = to_steps(np.array([printer.x.min_mm, printer.y.min_mm]), printer)
    far = to_steps(np.array([printer.x.max_mm, printer.y.max_mm]), printer)
    assert corner.tolist() == [0.0, 0.0]
    assert far == pytest.approx(printer.bed_steps)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e9])
def test_impossible_places_are_refused(bad: float) -> None:
    with pytest.raises(GcodeError, match="steps of the bed"):
        follow_polyline(np.array([[0.0, 0.0], [bad, 0.0]]), np.array([True]))


def test_endless_motion_is_refused_before_memory_is_taken() -> None:
    points = np.tile([[0.0, 0.0], [60_000.0, 0.0]], (3000, 1))
    with pytest.raises(GcodeError, match="steps of motion"):
        follow_polyline(points, np.ones(len(points) - 1, bool))


def test_ender5_lattice_is_the_papers() -> None:
    assert read_printer("ender5").bed_steps == (1100, 1100)
