"""Lines in the colours of their errors, with the bar that says which colour is how much."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, TwoSlopeNorm
from matplotlib.ticker import MaxNLocator

from printmend.draw.figure import ERROR_COLOURS, FINE_COLOURS, INK, draw_scale_bar, fit_view, plain
from printmend.messages import Tell, say


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
