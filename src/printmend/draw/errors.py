"""Pictures of errors: over the bed and a part's layers, along its lines, and on a circle."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, TwoSlopeNorm
from matplotlib.ticker import MaxNLocator

from printmend.draw.drive import ENLARGED
from printmend.draw.figure import ERROR_COLOURS, FINE_COLOURS, INK, PALETTE, draw_scale_bar, fit_view, plain
from printmend.messages import Tell, say
from printmend.units import TURN_RAD


def draw_errors(
    axes: Axes, places_mm: np.ndarray, errors_mm: np.ndarray, *, bed_mm: tuple[np.ndarray, np.ndarray], title: str,
    tell: Tell = str,
) -> Axes:  # fmt: skip
    """Draw the error [N, 2] at places [N, 2] as arrows over the bed (corners low, high [2]), enlarged to be seen."""
    size = np.hypot(*errors_mm.T)
    usual = float(np.quantile(size, 0.95)) + 1e-9
    span = float(max(bed_mm[1] - bed_mm[0]))
    factor = max((k for k in ENLARGED if k * usual <= span / 15), default=1)
    fit_view(axes, bed_mm[0], bed_mm[1], margin=0.03)
    axes.quiver(
        *places_mm.T, *(factor * errors_mm).T, size, angles="xy", scale_units="xy", scale=1, cmap=ERROR_COLOURS,
        norm=Normalize(0, usual), width=0.004,
    )  # fmt: skip
    axes.set_title(tell(title), color=INK, fontsize=10)
    rms = float(np.sqrt(np.mean(size**2)))
    axes.set_xlabel(tell(say("draw-arrows", f"{rms:.3f}", factor)), fontsize=8)
    axes.set_ylabel("y [mm]", fontsize=8)
    axes.tick_params(colors=INK, labelsize=8)
    return axes


def draw_layer_errors(axes: Axes, before_mm: Sequence[float], after_mm: Sequence[float], *, tell: Tell = str) -> Axes:
    """Draw the predicted RMS error of each layer of a part [L], as it is and mended."""
    at = np.arange(1, len(before_mm) + 1)
    style = "o-" if len(at) < 30 else "-"
    axes.plot(at, before_mm, style, color=PALETTE[1], linewidth=1.5, markersize=4, label=tell(say("as-it-is")))
    axes.plot(at, after_mm, style, color=PALETTE[3], linewidth=1.5, markersize=4, label=tell(say("mended")))
    axes.set_ylim(0, 1.15 * max([*before_mm, *after_mm, 1e-3]))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel(tell(say("layer-2")), fontsize=8)
    axes.set_ylabel(tell(say("draw-rms-error")), fontsize=8)
    axes.legend(fontsize=8, frameon=False)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.tick_params(colors=INK, labelsize=8)
    return axes


def draw_coloured(
    axes: Axes, lines_mm: Sequence[np.ndarray], error_mm: np.ndarray, *, corners_mm: tuple[np.ndarray, np.ndarray],
    worst_mm: float, title: str, fine_mm: float | None = None, tell: Tell = str,
) -> Axes:  # fmt: skip
    """Draw lines [K] of [N, 2] in the colour of their errors [K], up to ``worst_mm``, and a colour bar below them.

    Errors up to ``fine_mm`` get half of the colours, so that they do not look all the same.
    """
    fit_view(axes, *corners_mm, margin=0.04)
    norm = Normalize(0.0, worst_mm) if fine_mm is None else TwoSlopeNorm(fine_mm, 0.0, worst_mm)
    colours = ERROR_COLOURS if fine_mm is None else FINE_COLOURS
    ticks = MaxNLocator(4) if fine_mm is None else [0.0, fine_mm, worst_mm]
    beads = LineCollection(list(lines_mm), array=error_mm, cmap=colours, norm=norm, linewidths=1.1)
    beads.set_rasterized(len(lines_mm) > 2000)  # as an image: a page of a hundred thousand lines would be slow
    axes.add_collection(beads, autolim=False)
    figure = axes.get_figure(root=True)
    if figure is not None:
        high_in = figure.get_size_inches()[1]
        place = figure.add_axes((0.12, 0.48 / high_in, 0.76, 0.12 / high_in))
        bar = figure.colorbar(
            ScalarMappable(norm, colours), cax=place, orientation="horizontal", extend="max", ticks=ticks
        )
        if fine_mm is not None:
            bar.set_ticklabels(["0", f"{fine_mm:.3f}", f"{worst_mm:.2f}"])
        bar.set_label(tell(say("draw-error")), color=INK, fontsize=9)
        bar.ax.tick_params(labelsize=8, colors=INK)
        bar.outline.set_visible(False)
    axes.set_title(tell(title), color=INK, fontsize=11)
    return draw_scale_bar(plain(axes))


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
