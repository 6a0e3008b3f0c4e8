"""The circular test as a machinist knows it: deviations from a circle, magnified, both directions."""

import numpy as np
from matplotlib.axes import Axes

from printmend.draw.figure import INK, PALETTE, plain
from printmend.messages import Tell, say
from printmend.units import TURN_RAD

_DIVISIONS_MM = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
_RINGS = 3  # divisions drawn to either side of the circle
_RING = 0.11  # of the radius: how wide a division is drawn
_PALE = "#dee2e6"
_WAYS = (say("clockwise"), say("counter-clockwise"))


def draw_circle_test(
    axes: Axes, angle_rad: np.ndarray, off_mm: tuple[np.ndarray, np.ndarray], *, radius_mm: float,
    tell: Tell = str,
) -> Axes:  # fmt: skip
    """Draw how far outside of a circle a machine runs at ``angle_rad`` [N], ``off_mm`` [N] clockwise and
    counter-clockwise; the distance between two grey rings is one division, of a round size."""
    most = max(float(np.abs(run).max()) for run in off_mm)
    division = next((size for size in _DIVISIONS_MM if most <= _RINGS * size), _DIVISIONS_MM[-1])
    around = np.linspace(0, TURN_RAD, 361)
    for ring in range(-_RINGS, _RINGS + 1):
        wide, colour = (1.0, INK) if ring == 0 else (0.8, _PALE)
        at = 1 + _RING * ring
        axes.plot(at * np.cos(around), at * np.sin(around), color=colour, linewidth=wide, zorder=1)
    for along, across in (([-1.4, 1.4], [0, 0]), ([0, 0], [-1.4, 1.4])):
        axes.plot(along, across, color=_PALE, linewidth=0.8, zorder=1)
    for run, colour, way in zip(off_mm, PALETTE, _WAYS, strict=False):
        closed = np.append(run, run[:1])
        angle = np.append(angle_rad, angle_rad[:1])
        radius = 1 + _RING * closed / division
        axes.plot(
            radius * np.cos(angle), radius * np.sin(angle), color=colour, linewidth=1.5, label=tell(way), zorder=3
        )
    axes.text(0, 0.06, tell(say("draw-division", f"{division:g}")), ha="center", va="bottom", color=INK, fontsize=9)
    axes.text(0, -0.06, tell(say("draw-radius", f"{radius_mm:.0f}")), ha="center", va="top", color=INK, fontsize=9)
    axes.text(1.43, 0.03, "X", color=INK, fontsize=9)
    axes.text(0.03, 1.41, "Y", color=INK, fontsize=9)
    axes.set_xlim(-1.5, 1.5)
    axes.set_ylim(-1.62, 1.5)
    axes.set_aspect("equal")
    axes.legend(fontsize=9, frameon=False, loc="lower center", ncols=2)
    return plain(axes)
