"""Layers to try things on: outlines and infill as a slicer draws them, on the lattice."""

import itertools

import numpy as np

from printmend.path import Layer


def layer_along(points_steps: np.ndarray, index: int = 0) -> Layer:
    """Return the layer that follows a polyline [N, 2] tick by tick: each tick moves each axis by at most one step."""
    controls = []
    points = np.rint(points_steps).astype(int)
    for a, b in itertools.pairwise(points):
        ticks = int(np.abs(b - a).max())
        way = np.rint(a + (b - a) * np.arange(ticks + 1)[:, None] / max(ticks, 1)).astype(int)
        controls.append(np.diff(way, axis=0))
    moves = np.concatenate(controls)
    return Layer(index, 0.2 * (index + 1), points[0], moves, np.ones(len(moves), bool))


def ring_layer(
    centre: tuple[float, float], radius: float, *, turn: float = 0.0, gap: float = 12.0, index: int = 0
) -> Layer:
    """Return two outlines of a lobed disc and its zigzag infill at 45°, then 135° on odd layers."""
    angle = np.linspace(0, 2 * np.pi, 240)
    lobes = 1 + 0.12 * np.cos(5 * angle + turn)
    outline = np.stack([np.cos(angle + turn), np.sin(angle + turn)], axis=1) * lobes[:, None]
    parts = [outline * radius, outline * (radius - 4)]
    along = np.array([1.0, 1.0 if index % 2 == 0 else -1.0]) / np.sqrt(2)
    across = np.array([-along[1], along[0]])
    inner = 0.8 * radius
    for k, offset in enumerate(np.arange(-inner, inner, gap)):
        half = np.sqrt(max(inner**2 - offset**2, 0.0))
        ends = np.array([across * offset - along * half, across * offset + along * half])
        parts.append(ends if k % 2 == 0 else ends[::-1])
    return layer_along(np.concatenate(parts) + np.asarray(centre), index)
