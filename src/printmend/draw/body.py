"""Draw whole bodies from above, as in the paper's Fig. 5.

Paths are drawn as beads, coloured by each point's distance from its target.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import Normalize
from matplotlib.path import Path

from printmend.draw.figure import ERROR_COLOURS, draw_scale_bar, fit_view, plain, points_per_unit
from printmend.path import frozen

BEAD_MM = 0.4  # width of a drawn bead: an ordinary nozzle's
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
    """Add polylines as beads: a dark edge below, a lighter ridge above, so that neighbours look separate."""
    width = bead_mm * points_per_unit(axes)
    paths = [Path(line) for line in lines]
    for share, light, above in ((1.0, 0.72, 0.0), (0.62, 1.0, 0.5)):
        drawn = PathCollection(
            paths, edgecolors=light * colours, facecolors="none", linewidths=share * width, zorder=order + above
        )
        axes.add_collection(drawn, autolim=False)


def draw_above(
    axes: Axes,
    layers: Sequence[PrintedLayer],
    *,
    colours: Normalize,
    view_mm: np.ndarray,
) -> Axes:
    """Draw a body from above, the higher layers over the lower; ``view_mm`` [2, 2] are the corners shown."""
    fit_view(axes, *view_mm)
    for order, layer in enumerate(layers):
        lines, errors = runs(layer.points_mm, layer.extruding, layer.error_mm)
        if lines:
            add_beads(axes, lines, ERROR_COLOURS(colours(errors))[:, :3], bead_mm=BEAD_MM, order=order)
    return draw_scale_bar(plain(axes))


def draw_alike(layers: Sequence[PrintedLayer], *, colours: Normalize) -> list[Callable[[Axes], Axes]]:
    """Return a function for each layer that draws it from above, all at one scale."""
    view_mm = above_view(layers)
    return [partial(draw_above, layers=[one], colours=colours, view_mm=view_mm) for one in layers]


def above_view(layers: Sequence[PrintedLayer]) -> np.ndarray:
    """Return the corners [2, 2] of the box that `draw_above` needs for all the layers."""
    return box_of([layer.points_mm for layer in layers])


def box_of(paths: Sequence[np.ndarray]) -> np.ndarray:
    """Return the corners [2, 2] of the box around paths [K] of [N, 2]."""
    return np.array(
        [np.min([path.min(axis=0) for path in paths], axis=0), np.max([path.max(axis=0) for path in paths], axis=0)]
    )
