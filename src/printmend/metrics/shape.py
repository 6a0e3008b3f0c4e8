"""Distances of points from lines and from each other: they compare outlines, whatever the order of printing."""

from dataclasses import dataclass

import numpy as np
import shapely


@dataclass(frozen=True)
class ContourError:
    """Distances of the printed points from the nearest point of the ideal path."""

    rms: float
    p95: float
    max: float

    @classmethod
    def of(cls, distance: np.ndarray) -> "ContourError":
        """Return the error of distances [N]."""
        return cls(float(np.sqrt(np.mean(distance**2))), float(np.percentile(distance, 95)), float(distance.max()))


def stroke_distances(strokes: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how far points [N, 2] lie from the nearest of separate strokes [K, 2, 2]: the distances [N], and the steps
    [N, 2] that would bring them there."""
    lines = shapely.linestrings(strokes)
    places = shapely.points(points)
    nearest = lines[shapely.STRtree(lines).nearest(places)]
    on_line = shapely.line_interpolate_point(nearest, shapely.line_locate_point(nearest, places))
    steps = shapely.get_coordinates(on_line) - points
    return np.hypot(*steps.T), steps


def nearest(places: np.ndarray, asked: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how far the nearest of the ``places`` [N, 2] is from each of ``asked`` [M, 2], and which one it is."""
    at = shapely.STRtree(shapely.points(places)).nearest(shapely.points(asked))
    return np.hypot(*(places[at] - asked).T), at


def spacing(places: np.ndarray) -> np.ndarray:
    """Return the distance [N] of each of the points [N, 2] from its nearest neighbour."""
    single, which, times = np.unique(places, axis=0, return_inverse=True, return_counts=True)
    points = shapely.points(single)
    _, apart = shapely.STRtree(points).query_nearest(points, exclusive=True, return_distance=True, all_matches=False)
    return np.where(times[which.ravel()] > 1, 0.0, apart[which.ravel()])
