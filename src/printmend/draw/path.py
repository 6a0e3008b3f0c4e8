"""Paths of beads, coloured by how far each point is from where it belongs."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.path import Path

from printmend.draw.figure import points_per_unit
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
