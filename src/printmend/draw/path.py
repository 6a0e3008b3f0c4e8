"""Paths of beads, coloured by how far each point is from where it belongs."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize

from printmend.draw.figure import ERROR_COLOURS, INK, draw_scale_bar, fit_view, plain, points_per_unit
from printmend.path import Layer, frozen
from printmend.printer import Printer

_RUN = 6  # points that share a colour


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


def runs(
    points: np.ndarray, extruding: np.ndarray, error: np.ndarray, *, length: int = _RUN
) -> tuple[list, np.ndarray]:
    """Cut a path [T + 1, 2] into extruded polylines of at most ``length`` segments, each with its mean error [K]."""
    first = np.flatnonzero(extruding & ~np.concatenate([[False], extruding[:-1]]))
    last = np.flatnonzero(extruding & ~np.concatenate([extruding[1:], [False]])) + 1
    lines, errors = [], []
    for begin, end in zip(first.tolist(), last.tolist(), strict=True):
        for at in range(begin, end, length):
            until = min(at + length, end)
            lines.append(points[at : until + 1])
            errors.append(error[at : until + 1].mean())
    return lines, np.array(errors)


def add_beads(axes: Axes, lines: list, colours: np.ndarray, *, bead_mm: float, order: int) -> None:
    """Add polylines as beads: a dark edge below, a lighter ridge above, so that neighbours can be told apart."""
    width = bead_mm * points_per_unit(axes)
    for share, light, above in ((1.0, 0.72, 0.0), (0.62, 1.0, 0.5)):
        drawn = LineCollection(lines, colors=light * colours, linewidths=share * width, zorder=order + above)
        axes.add_collection(drawn, autolim=False)


def draw_path(
    axes: Axes, points_mm: np.ndarray, *, colour: str = INK, width_mm: float | None = None, label: str = ""
) -> Axes:
    """Draw a plain path [N, 2]; with ``width_mm`` as wide as a bead in the axes' present view, else a hairline."""
    width = 0.8 if width_mm is None else width_mm * points_per_unit(axes)
    axes.plot(*np.asarray(points_mm).T, color=colour, linewidth=width, label=label or None, solid_capstyle="round")
    return axes


def draw_layer(
    axes: Axes, layer: PrintedLayer, *, colours: Normalize, bead_mm: float = 0.4, target_mm: np.ndarray | None = None
) -> Axes:
    """Draw one layer from above at bead width, coloured by error, over a hairline of its target [T + 1, 2]."""
    shown = layer.points_mm if target_mm is None else np.vstack([layer.points_mm, target_mm])
    fit_view(axes, shown.min(axis=0), shown.max(axis=0))
    lines, errors = runs(layer.points_mm, layer.extruding, layer.error_mm)
    width = bead_mm * points_per_unit(axes)
    axes.add_collection(
        LineCollection(lines, array=errors, cmap=ERROR_COLOURS, norm=colours, linewidths=width, capstyle="round"),
        autolim=False,
    )
    if target_mm is not None:
        wanted, _ = runs(target_mm, layer.extruding, layer.error_mm, length=len(layer.extruding))
        axes.add_collection(LineCollection(wanted, colors=INK, linewidths=0.5, zorder=5), autolim=False)
    return draw_scale_bar(plain(axes))
