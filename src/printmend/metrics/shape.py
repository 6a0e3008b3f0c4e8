"""Metrics of drawn shapes: they see the outline, not which point was printed when."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from printmend.errors import TraceError
from printmend.messages import say


@dataclass(frozen=True)
class ContourError:
    """Distances of the printed points from the nearest point of the ideal path."""

    rms: float
    p95: float
    max: float


def contour_error(target: np.ndarray, printed: np.ndarray) -> ContourError:
    """Measure how far printed points [N, 2] lie from the polyline ``target`` [M, 2], whatever the timing.

    Unlike RMSE it forgives a print that runs early or late along the right line. Not symmetric: parts of the target
    that were never printed do not count.
    """
    distance = _distances(_points(printed), _points(target))
    return ContourError(float(np.sqrt(np.mean(distance**2))), float(np.percentile(distance, 95)), float(distance.max()))


def frechet(target: np.ndarray, printed: np.ndarray) -> float:
    """Return the discrete Fréchet distance of two polylines: the shortest leash for two walkers who never turn back.

    Time and memory grow with the product of the lengths: a layer of 6500 points takes seconds.
    """
    return float(shapely.frechet_distance(shapely.LineString(_points(target)), shapely.LineString(_points(printed))))


def symmetric_difference_area(target: Sequence[np.ndarray], printed: Sequence[np.ndarray]) -> float:
    """Return the area that only one of two figures covers; each is a list of closed contours [N, 2].

    Contours are filled by the even-odd rule, so a contour inside another is a hole. Unit: that of the inputs, squared.
    """
    return float(_filled(target).symmetric_difference(_filled(printed)).area)


def bead_difference_area(target: Sequence[np.ndarray], printed: Sequence[np.ndarray], width: float) -> float:
    """Return the area that only one of two prints covers; each is a list of strokes [N, 2] of beads ``width`` wide."""
    return float(_beads(target, width).symmetric_difference(_beads(printed, width)).area)


def _filled(contours: Sequence[np.ndarray]) -> shapely.Geometry:
    figure: shapely.Geometry = shapely.Polygon()
    for contour in contours:
        figure = figure.symmetric_difference(shapely.make_valid(shapely.Polygon(_points(contour))))
    return figure


def _beads(strokes: Sequence[np.ndarray], width: float) -> shapely.Geometry:
    if not width > 0:
        raise TraceError(
            say("subject-bead-width"), wanted=say("width-above-0"), came=f"{width}", todo=say("give-nozzle-line-width")
        )
    lines = [shapely.LineString(_points(stroke)) for stroke in strokes]
    return shapely.unary_union([shapely.buffer(line, width / 2) for line in lines])


def stroke_distances(strokes: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how far points [N, 2] lie from the nearest of separate strokes [K, 2, 2]: the distances [N], and the steps
    [N, 2] that would bring them there."""
    lines = shapely.linestrings(strokes)
    places = shapely.points(points)
    nearest = lines[shapely.STRtree(lines).nearest(places)]
    on_line = shapely.line_interpolate_point(nearest, shapely.line_locate_point(nearest, places))
    steps = shapely.get_coordinates(on_line) - points
    return np.hypot(*steps.T), steps


def _distances(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Return the distance [N] of each point [N, 2] from a polyline [M, 2]."""
    ends = np.stack([line[:-1], line[1:]], axis=1)
    # Equal neighbours (a tick without a control) are no segments; a line that never moves is a point.
    moving = (ends[:, 0] != ends[:, 1]).any(axis=1)
    if not moving.any():
        return np.hypot(*(points - line[0]).T)
    tree = shapely.STRtree(shapely.linestrings(ends[moving]))
    (at, _), distance = tree.query_nearest(shapely.points(points), return_distance=True, all_matches=False)
    result = np.empty(len(points))
    result[at] = distance
    return result


def _points(points: np.ndarray) -> np.ndarray:
    points = np.asarray(points, float)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2 or not np.isfinite(points).all():
        came = f"{points.shape}" if np.isfinite(points).all() else say("nan-infinity-2", points.shape)
        raise TraceError(
            say("subject-shapes"), wanted=say("finite-points-n-2-n-2"), came=came, todo=say("correct-path")
        )
    return points


def nearest(places: np.ndarray, asked: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how far the nearest of the ``places`` [N, 2] is from each of ``asked`` [M, 2], and which one it is."""
    at = shapely.STRtree(shapely.points(places)).nearest(shapely.points(asked))
    return np.hypot(*(places[at] - asked).T), at


def spacing(places: np.ndarray) -> np.ndarray:
    """Return how far each of the places [N, 2] is from its neighbour [N]; 0 where another is at the same place."""
    single, which, times = np.unique(places, axis=0, return_inverse=True, return_counts=True)
    points = shapely.points(single)
    _, apart = shapely.STRtree(points).query_nearest(points, exclusive=True, return_distance=True, all_matches=False)
    return np.where(times[which.ravel()] > 1, 0.0, apart[which.ravel()])
