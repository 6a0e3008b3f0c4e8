"""Bodies made up for benchmarks: random outlines with infill, of a size that is chosen."""

import numpy as np

from printmend.printer import Printer
from printmend.units import TURN_RAD
from printmend_lab.body.layers import follow_polyline, to_steps
from printmend_lab.path import Body, Layer

_BEAD_MM = 0.8  # between a layer's perimeters
_LAYER_MM = 0.2  # a layer's height
_LINES = 24  # of infill in a layer


def drawn_body(rng: np.random.Generator, printer: Printer, *, size_mm: float, layers: int = 3) -> Body:
    """Draw a body about ``size_mm`` across, anywhere in the bed's middle: two perimeters and zigzag infill a layer.

    The outline is a smooth star shape. The infill runs at 45° and 135° by turns, as slicers do, 24 lines a layer; so
    each layer goes both ways along both axes over the whole size, and small bodies have few points.
    """
    centre, outline = _outline(rng, printer, size_mm)
    drawn = []
    for index in range(layers):
        inner = outline * (1 - 2 * _BEAD_MM / size_mm)
        infill = _zigzag(outline * (1 - 4 * _BEAD_MM / size_mm), 1 if index % 2 == 0 else -1)
        points = centre + np.concatenate([outline, inner, infill])
        steps = to_steps(points, printer)
        start, controls, extruding = follow_polyline(steps, np.ones(len(steps) - 1, bool))
        drawn.append(Layer(index, _LAYER_MM * (index + 1), start, controls, extruding))
    return Body(f"drawn {size_mm:g} mm", tuple(drawn))


def drawn_tower(rng: np.random.Generator, printer: Printer, *, size_mm: float, height_mm: float) -> Body:
    """Draw a body about ``size_mm`` across and ``height_mm`` high, for prints of three axes: an outline a layer.

    The outlines are those of `drawn_body`, each begun elsewhere and gone round the other way than the one before.
    """
    centre, outline = _outline(rng, printer, size_mm)
    steps = np.rint(to_steps(centre + outline, printer))
    start, controls, _ = follow_polyline(steps, np.ones(len(steps) - 1, bool))
    loop = start + np.cumsum(controls, axis=0, dtype=np.int64)
    drawn = []
    for index in range(max(round(height_mm / _LAYER_MM), 2)):
        begun = np.roll(loop, int(rng.integers(len(loop))), axis=0)[:: 1 if index % 2 == 0 else -1]
        moves = np.diff(begun, axis=0)
        drawn.append(Layer(index, _LAYER_MM * (index + 1), begun[0], moves, np.ones(len(moves), bool)))
    return Body(f"drawn tower {size_mm:g} mm", tuple(drawn))


def _outline(rng: np.random.Generator, printer: Printer, size_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Draw where a body stands [2] and its closed outline about that [N, 2], mm."""
    centre = np.array(printer.middle_mm)
    room = [axis.length_mm / 2 - 0.7 * size_mm for axis in (printer.x, printer.y)]
    centre = centre + np.array([rng.uniform(-1, 1) * max(0.0, min(0.25 * size_mm + 20.0, free)) for free in room])
    waves = np.arange(2, 6)
    amplitude, phase = rng.uniform(-0.1, 0.1, 4) / waves * 2, rng.uniform(0, TURN_RAD, 4)
    angle = np.linspace(0.0, TURN_RAD, 181)
    shape = 1 + np.cos(np.outer(angle, waves) + phase) @ amplitude
    outline = shape[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outline *= size_mm / np.ptp(outline, axis=0).max()
    return centre, outline


def _zigzag(outline: np.ndarray, side: int) -> np.ndarray:
    """Return way-points [2·lines, 2] across a closed outline [N, 2] about the origin, lines at 45° or 135°."""
    along = np.array([1.0, side]) / np.sqrt(2)
    across = np.array([-along[1], along[0]])
    u, v = outline @ along, outline @ across
    points = []
    for k, level in enumerate(np.linspace(v.min(), v.max(), _LINES + 2)[1:-1]):
        cut = np.flatnonzero((v[:-1] - level) * (v[1:] - level) <= 0)
        share = (level - v[cut]) / np.where(v[cut + 1] == v[cut], 1.0, v[cut + 1] - v[cut])
        crossings = u[cut] + share * (u[cut + 1] - u[cut])
        ends = [crossings.min(), crossings.max()]
        points += [along * end + across * level for end in (ends if k % 2 == 0 else ends[::-1])]
    return np.array(points)
