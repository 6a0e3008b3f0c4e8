"""A slow broken printer that shares no code with printmend: hulls as points, play as a loop. physics.md §1–3."""

import math
from functools import cache

import numpy as np


def circle(radius: float = 20 / math.pi, points: int = 240, centre: tuple[float, float] = (0.0, 0.0)) -> tuple:
    angle = [2 * math.pi * i / points for i in range(points)]
    return tuple((centre[0] + radius * math.cos(a), centre[1] + radius * math.sin(a)) for a in angle)


def corners(radii: list[float], phase: float = 0.3) -> tuple:
    angle = [phase + 2 * math.pi * i / len(radii) for i in range(len(radii))]
    return tuple((r * math.cos(a), r * math.sin(a)) for r, a in zip(radii, angle, strict=True))


def support(points: tuple, angles: np.ndarray) -> np.ndarray:
    """h(φ): how far the hull of the points reaches in each direction."""
    return np.max([x * np.cos(angles) + y * np.sin(angles) for x, y in points], axis=0)


@cache
def unwound(points: tuple, side: float, cells: int = 2880) -> np.ndarray:
    """U over one turn [cells + 1] mm: the integral of h(side − θ), by Simpson's rule."""
    d = 2 * math.pi / cells
    start = side - d * np.arange(cells)
    slices = d * (support(points, start) + 4 * support(points, start - d / 2) + support(points, start - d)) / 6
    return np.concatenate([[0.0], np.cumsum(slices)])


class NaiveDrive:
    """One motor: lower and upper branch over its position m [mm], 40 mm a turn, and where the belt is."""

    def __init__(
        self, points: tuple, *, play: float = 0.0, slack: tuple[float, float] | None = None, shift: float = 0.0
    ):
        self.one, self.two = unwound(points, 0.0), unwound(points, math.pi)
        self.play, self.slack, self.shift = play, slack, shift
        self.place = 0.0

    def span(self, table: np.ndarray, m: float) -> float:
        turns = math.floor(m / 40.0)
        at = (m / 40.0 - turns) * (len(table) - 1)
        i = min(int(at), len(table) - 2)
        return turns * table[-1] + table[i] + (at - i) * (table[i + 1] - table[i])

    def branches(self, m: float) -> tuple[float, float]:
        one = self.span(self.one, m) + self.shift
        if self.slack is None:
            return one - self.play / 2, one + self.play / 2
        return one - self.slack[0], self.span(self.two, m) + self.shift + self.slack[1]

    def move(self, m: float) -> float:
        lower, upper = self.branches(m)
        self.place = min(max(self.place, lower), upper)
        return self.place


def loose(points: tuple, play: float) -> tuple[float, float]:
    """The slacks of a belt whose smallest play over the turn is ``play``."""
    one, two = unwound(points, 0.0), unwound(points, math.pi)
    need = max(0.0, float((one - two).max())) + play
    return 0.4 * need, 0.6 * need


def walk(
    drives: tuple[NaiveDrive, NaiveDrive], waypoints: np.ndarray, *, home: tuple[float, float], place: float = 1.0
):
    """Print way-points [N, 2] of a cartesian machine; return printed [N, 2].

    Homing puts the carriage at ``home``, the belt at ``place`` of its play (0 the lower branch, 1 the upper).
    """
    for drive, at in zip(drives, home, strict=True):
        lower, upper = drive.branches(at)
        drive.shift += at - (lower + place * (upper - lower))
        drive.place = at
    return np.array([[drive.move(m) for drive, m in zip(drives, point, strict=True)] for point in waypoints])
