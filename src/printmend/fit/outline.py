"""Which walls of a layer are its outline and which are holes, and which of these are round."""

from dataclasses import dataclass

import cv2
import numpy as np

from printmend.measure.walls import RASTER_MM, Walls

BESIDE_MM = 0.45  # distance from a bead's edge at which the air beside it is looked up
OUTER, NOWHERE = 0, -1
LEAST_HOLE_MM2 = 1.0  # area of a hole; smaller ones are gaps between beads
LEAST_PLACES = 5  # of a round hole's wall
ROUND_MM, ROUND_SHARE = 0.05, 0.01  # by which a round hole's places may lie off a circle, and the share of its radius
MOST_GAP_RAD = 2.1  # largest part of a round hole's wall that no ray may see: a third


@dataclass(frozen=True)
class Round:
    """A round hole: its number among a layer's holes, its middle, and the diameter that the file commands."""

    number: int
    x_mm: float
    y_mm: float
    diameter_mm: float


@dataclass(frozen=True, eq=False)
class Outline:
    """For each wall place the hole that it belongs to ``group`` [S] (`OUTER`: none, `NOWHERE`: not known), the edge
    that the file commands ``edge_mm`` [S, 2], how much its wall is bent ``curvature`` [S] 1/mm (round holes: below 0),
    and the round holes."""

    group: np.ndarray
    edge_mm: np.ndarray
    curvature: np.ndarray
    rounds: tuple[Round, ...]


def outline_of(walls: Walls) -> Outline:
    """Return which walls of a layer are its outline, and which are holes'."""
    air = np.pad(~walls.plastic, 1, constant_values=True).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(air, connectivity=4)
    edge_mm = walls.commanded_mm[walls.row] + walls.half_mm[:, None] * walls.normal
    pixel = np.rint((edge_mm + BESIDE_MM * walls.normal - walls.corner_mm) / RASTER_MM).astype(int) + 1
    pixel = np.clip(pixel, 0, np.array(labels.shape[::-1]) - 1)
    label = labels[pixel[:, 1], pixel[:, 0]]
    outside = labels[0, 0]
    small = stats[:, cv2.CC_STAT_AREA] * RASTER_MM**2 < LEAST_HOLE_MM2
    group = np.full(len(label), NOWHERE)
    group[label == outside] = OUTER
    holes = [one for one in np.unique(label) if one not in (0, outside) and not small[one]]
    for number, one in enumerate(holes, 1):
        group[label == one] = number
    rounds = [found for number in range(1, len(holes) + 1) if (found := _round(number, edge_mm[group == number]))]
    return Outline(group, edge_mm, _curvature(edge_mm, walls.normal, group), tuple(rounds))


def _round(number: int, edge_mm: np.ndarray) -> Round | None:
    """Return a hole as a circle through its places [N, 2] (Kåsa 1976), None where it is none."""
    if len(edge_mm) < LEAST_PLACES:
        return None
    middle = edge_mm.mean(axis=0)
    x, y = (edge_mm - middle).T
    (a, b, _), *_ = np.linalg.lstsq(np.column_stack([2 * x, 2 * y, np.ones(len(x))]), x * x + y * y, rcond=None)
    away = np.hypot(x - a, y - b)
    radius = float(away.mean())
    angles = np.sort(np.arctan2(y - b, x - a))
    gap = float(np.diff(np.append(angles, angles[0] + 2 * np.pi)).max())
    if np.abs(away - radius).max() > ROUND_MM + ROUND_SHARE * radius or gap > MOST_GAP_RAD:
        return None
    return Round(number, float(middle[0] + a), float(middle[1] + b), 2 * radius)


def _curvature(edge_mm: np.ndarray, normal: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Return how much walls bend, from their neighbours in the order of motion: 1/R outside, −1/R in a hole."""
    step, turn = np.diff(edge_mm, axis=0), np.diff(normal, axis=0)
    length2 = (step**2).sum(axis=1)
    near = (length2 < 2.5**2) & (length2 > 1e-6) & (group[1:] == group[:-1])
    bend = np.where(near, (step * turn).sum(axis=1) / np.where(near, length2, 1.0), np.nan)
    with np.errstate(invalid="ignore"):
        both = np.stack([np.append(np.nan, bend), np.append(bend, np.nan)])
    known = np.isfinite(both)
    return np.where(known.any(axis=0), np.nansum(both, axis=0) / np.maximum(known.sum(axis=0), 1), 0.0).clip(-1.0, 1.0)
