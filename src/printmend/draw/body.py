"""Whole bodies, from above and as a solid seen from the side: the paper's Fig. 5 and Fig. 1."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, to_rgb

from printmend.draw.figure import ERROR_COLOURS, INK, draw_scale_bar, fit_view, plain
from printmend.draw.path import BEAD_MM, PrintedLayer, add_beads, runs

SOLID_BEAD_MM = 0.45  # width of a bead in the solid view: a little wider, so that no light shows between layers
_AZIMUTH, _ELEVATION = np.radians(-60.0), np.radians(38.0)


def draw_above(
    axes: Axes,
    layers: Sequence[PrintedLayer],
    *,
    colours: Normalize,
    view_mm: np.ndarray | None = None,
) -> Axes:
    """Draw a body from above, the higher layers over the lower; ``view_mm`` [2, 2] fixes the corners shown."""
    low, high = above_view(layers) if view_mm is None else view_mm
    fit_view(axes, low, high)
    for order, layer in enumerate(layers):
        lines, errors = runs(layer.points_mm, layer.extruding, layer.error_mm)
        if lines:
            add_beads(axes, lines, ERROR_COLOURS(colours(errors))[:, :3], bead_mm=BEAD_MM, order=order)
    return draw_scale_bar(plain(axes))


def draw_alike(layers: Sequence[PrintedLayer], *, colours: Normalize) -> list[Callable[[Axes], Axes]]:
    """Return what draws each layer from above, all at one scale."""
    view_mm = above_view(layers)
    return [partial(draw_above, layers=[one], colours=colours, view_mm=view_mm) for one in layers]


def draw_solid(
    axes: Axes,
    layers: Sequence[PrintedLayer],
    *,
    colours: Normalize,
    view_mm: np.ndarray | None = None,
) -> Axes:
    """Draw a body as its stacked beads, seen obliquely from above and lit from the left; see `draw_above`.

    An orthographic projection drawn from the bed upwards: what is nearer the eye is drawn later, so nothing has
    to be sorted, and a body of a million points takes seconds where a 3-D canvas takes minutes.
    """
    low, high = solid_view(layers) if view_mm is None else view_mm
    fit_view(axes, low, high)
    ink = np.array(to_rgb(INK))
    top_mm = max(layer.z_mm for layer in layers)
    for order, layer in enumerate(layers):
        lines, errors = runs(project(layer.points_mm, layer.z_mm), layer.extruding, layer.error_mm)
        if not lines:
            continue
        # The lid is seen full on; the walls below it are darker, so that the solid stands out.
        light = _light(lines)[:, None] * (1.0 if layer.z_mm >= top_mm else 0.85)
        colour = light * ERROR_COLOURS(colours(errors))[:, :3] + (1 - light) * ink
        add_beads(axes, lines, colour, bead_mm=SOLID_BEAD_MM, order=order)
    return draw_scale_bar(plain(axes))


def project(points_mm: np.ndarray, z_mm: float) -> np.ndarray:
    """Return points [N, 2] at height z in the picture plane [N, 2]."""
    x, y = points_mm.T
    across = -np.sin(_AZIMUTH) * x + np.cos(_AZIMUTH) * y
    away = np.cos(_AZIMUTH) * x + np.sin(_AZIMUTH) * y
    return np.stack([across, -np.sin(_ELEVATION) * away + np.cos(_ELEVATION) * z_mm], axis=1)


def _light(lines: list[np.ndarray]) -> np.ndarray:
    """Return the light [K] of 0.75…1 on each run by its direction."""
    direction = np.array([line[-1] - line[0] for line in lines])
    return 0.875 + 0.125 * np.cos(2 * np.arctan2(direction[:, 1], direction[:, 0]) - 0.6)


def above_view(layers: Sequence[PrintedLayer]) -> np.ndarray:
    """Return the corners [2, 2] of the box that `draw_above` needs for all the layers."""
    return _box([layer.points_mm for layer in layers])


def solid_view(layers: Sequence[PrintedLayer]) -> np.ndarray:
    """Return the corners [2, 2] of the box that `draw_solid` needs for all the layers."""
    return _box([project(layer.points_mm, layer.z_mm) for layer in layers])


def _box(paths: Sequence[np.ndarray]) -> np.ndarray:
    return np.array(
        [np.min([path.min(axis=0) for path in paths], axis=0), np.max([path.max(axis=0) for path in paths], axis=0)]
    )
