"""Whole bodies, from above and as a solid seen from the side: the paper's Fig. 5 and Fig. 1.

Their paths are beads, coloured by how far each point is from where it belongs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import Normalize, to_rgb
from matplotlib.path import Path

from printmend.draw.figure import ERROR_COLOURS, INK, draw_scale_bar, fit_view, plain, points_per_unit
from printmend.path import Layer, frozen
from printmend.printer import Printer

BEAD_MM = 0.4  # width of a drawn bead, as of an ordinary nozzle
_RUN = 6  # segments that share a colour


@dataclass(frozen=True, eq=False)
class PrintedLayer:
    """A layer as it lies on the bed: ``points_mm`` [T + 1, 2], ``extruding`` [T], ``error_mm`` [T + 1]."""

    z_mm: float
    points_mm: np.ndarray
    extruding: np.ndarray
    error_mm: np.ndarray

    def __post_init__(self) -> None:
        for name in ("points_mm", "extruding", "error_mm"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def printed_layer(layer: Layer, printed_steps: np.ndarray, printer: Printer) -> PrintedLayer:
    """Return the print [T + 1, 2] steps of a layer in mm, with each point's distance from its target."""
    pitch_mm = np.array(printer.mm_per_step)
    error_mm = np.hypot(*((printed_steps - layer.nominal_steps) * pitch_mm).T)
    corner_mm = np.array([printer.x.min_mm, printer.y.min_mm])
    return PrintedLayer(layer.z_mm, corner_mm + printed_steps * pitch_mm, layer.extruding, error_mm)


def runs(points: np.ndarray, extruding: np.ndarray, error: np.ndarray) -> tuple[list, np.ndarray]:
    """Cut a path [T + 1, 2] into extruded polylines of a few segments, each with its mean error [K]."""
    first = np.flatnonzero(extruding & ~np.concatenate([[False], extruding[:-1]]))
    last = np.flatnonzero(extruding & ~np.concatenate([extruding[1:], [False]])) + 1
    cuts = [
        (at, min(at + _RUN, end) + 1)
        for begin, end in zip(first.tolist(), last.tolist(), strict=True)
        for at in range(begin, end, _RUN)
    ]
    total = np.concatenate([[0.0], np.cumsum(error)])
    begin, end = np.array(cuts, np.int64).reshape(-1, 2).T
    return [points[at:until] for at, until in cuts], (total[end] - total[begin]) / (end - begin)


def add_beads(axes: Axes, lines: list, colours: np.ndarray, *, bead_mm: float, order: int) -> None:
    """Add polylines as beads: a dark edge below, a lighter ridge above, so that neighbours can be told apart."""
    width = bead_mm * points_per_unit(axes)
    paths = [Path(line) for line in lines]
    for share, light, above in ((1.0, 0.72, 0.0), (0.62, 1.0, 0.5)):
        drawn = PathCollection(
            paths, edgecolors=light * colours, facecolors="none", linewidths=share * width, zorder=order + above
        )
        axes.add_collection(drawn, autolim=False)


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
