"""Slow, obvious versions of the lattice kernels, in exact fractions."""

import itertools
from fractions import Fraction

import numpy as np

UNITS = 2**14


def snapped(points_steps: np.ndarray) -> list[tuple[Fraction, Fraction]]:
    """The way-points as the kernel sees them."""
    return [tuple(Fraction(round(float(c) * UNITS), UNITS) for c in p) for p in points_steps]


def nearest(value: Fraction) -> int:
    """Round half up."""
    return (value + Fraction(1, 2)).__floor__()


def follow(points_steps: np.ndarray, drawing: np.ndarray) -> tuple[list[tuple[int, int]], list[bool], list[int]]:
    """Return the visited nodes, the flag of each tick, and the segment that owns each node."""
    points = snapped(points_steps)
    candidates = [(points[0], 0, False)]
    for k, (p, q) in enumerate(itertools.pairwise(points)):
        delta = (q[0] - p[0], q[1] - p[1])
        axis = 0 if abs(delta[0]) >= abs(delta[1]) else 1
        if delta[axis]:
            low, high = sorted((p[axis], q[axis]))
            whole = [i for i in range(low.__floor__(), high.__ceil__() + 1) if low <= i <= high and i != p[axis]]
            for i in whole if delta[axis] > 0 else reversed(whole):
                t = (i - p[axis]) / delta[axis]
                candidates.append(((p[0] + t * delta[0], p[1] + t * delta[1]), k, True))
        candidates.append((q, k, False))
    nodes: list[tuple[int, int]] = []
    flags: list[bool] = []
    owners: list[int] = []
    for point, k, crossing in candidates:
        node = (nearest(point[0]), nearest(point[1]))
        near = (point[0] - node[0]) ** 2 + (point[1] - node[1]) ** 2 <= Fraction(1, 4)
        if not (near or crossing) or (nodes and nodes[-1] == node):
            continue
        if nodes:
            flags.append(bool(drawing[k]))
        nodes.append(node)
        owners.append(k)
    return nodes, flags, owners


def distance_to_segment(node: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    """Euclidean distance of a point to a segment."""
    along = end - start
    length = float(along @ along)
    t = 0.0 if length == 0 else min(1.0, max(0.0, float((node - start) @ along) / length))
    return float(np.linalg.norm(node - start - t * along))
