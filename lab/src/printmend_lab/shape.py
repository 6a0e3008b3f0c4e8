"""Metrics of drawn shapes: the leash between two paths, and the area that only one of two figures covers."""

from collections.abc import Sequence

import numpy as np
import shapely

from printmend.errors import TraceError


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
        raise TraceError("bead width", wanted="a width above 0", came=f"{width}", todo="give the nozzle's line width")
    lines = [shapely.LineString(_points(stroke)) for stroke in strokes]
    return shapely.unary_union([shapely.buffer(line, width / 2) for line in lines])


def _points(points: np.ndarray) -> np.ndarray:
    points = np.asarray(points, float)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2 or not np.isfinite(points).all():
        came = f"{points.shape}" if np.isfinite(points).all() else f"{points.shape} with NaN or infinity"
        raise TraceError("a metric of shapes", wanted="finite points [N, 2], N ≥ 2", came=came, todo="correct the path")
    return points
