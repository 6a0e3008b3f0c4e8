"""Figures without global state: no pyplot, the Agg canvas, one palette."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure

from printmend.files import replacing
from printmend.messages import Tell, say

INK = "#22303a"
PALETTE = ("#0b7285", "#e8590c", "#5f3dc4", "#2b8a3e", "#c2255c", "#868e96", "#1864ab")
# Calm where the print is right, hot where it is wrong; the lightness grows to the middle and falls again.
ERROR_COLOURS = LinearSegmentedColormap.from_list("error", ["#0b7285", "#3bc9b0", "#ffd43b", "#f76707", "#a61e4d"])
# Of two parts: its lower half is for what is left after mending, which would else look all the same.
FINE_COLOURS = LinearSegmentedColormap.from_list(
    "error in two parts",
    [(0, "#1c3f6e"), (0.5, "#0b7285"), (0.625, "#3bc9b0"), (0.75, "#ffd43b"), (0.875, "#f76707"), (1, "#a61e4d")],
)


def new_figure(columns: int = 1, *, width_in: float = 5.0, height_in: float = 5.0) -> tuple[Figure, list[Axes]]:
    """Return a figure with a row of ``columns`` axes, each ``width_in`` × ``height_in``."""
    figure = Figure(figsize=(columns * width_in, height_in), facecolor="white")
    axes = np.atleast_1d(figure.subplots(1, columns))
    return figure, list(axes)


def comparison(
    titles: Sequence[str], draw: Sequence[Callable[[Axes], Axes]], *, title: str, colours: Normalize | None,
    tell: Tell = str,
) -> Figure:  # fmt: skip
    """Return a row of pictures with one colour bar of error [mm] under them: the paper's Fig. 1 and 5."""
    figure, axes = new_figure(len(draw), width_in=4.4, height_in=4.6)
    figure.subplots_adjust(left=0.01, right=0.99, top=0.84, bottom=0.15, wspace=0.02)
    figure.suptitle(tell(title), color=INK, fontsize=13, y=0.98)
    for one, name, draw_one in zip(axes, titles, draw, strict=True):
        draw_one(one)
        one.set_title(tell(name), color=INK, fontsize=11)
    if colours is not None:
        bar = figure.colorbar(
            ScalarMappable(colours, ERROR_COLOURS),
            cax=figure.add_axes((0.3, 0.09, 0.4, 0.022)),
            orientation="horizontal",
            extend="max",
        )
        bar.set_label(tell(say("draw-error")), color=INK, fontsize=9)
        bar.ax.tick_params(labelsize=8, colors=INK)
        bar.outline.set_visible(False)
    return figure


def plain(axes: Axes) -> Axes:
    """Take the frame and the ticks off a picture that has a scale bar."""
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)
    return axes


def fit_view(axes: Axes, low: np.ndarray, high: np.ndarray, *, margin: float = 0.06) -> Axes:
    """Show the box low…high [2], equal aspect, with a margin."""
    span = float(max(high - low)) or 1.0
    axes.set_xlim(low[0] - margin * span, high[0] + margin * span)
    axes.set_ylim(low[1] - margin * span, high[1] + margin * span)
    axes.set_aspect("equal")
    return axes


def points_per_unit(axes: Axes) -> float:
    """Return the size on paper [pt] of one data unit of axes with equal aspect: line widths in mm need it."""
    box = axes.get_position()
    width, height = axes.figure.get_figure(root=True).get_size_inches()
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    return float(72 * min(box.width * width / (x1 - x0), box.height * height / (y1 - y0)))


def draw_scale_bar(axes: Axes) -> Axes:
    """Draw a bar of a round length [mm] in the lower left corner, its length beside it: above it lies what is drawn."""
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    length = max(size for size in (0.1, 0.5, 1, 2, 5, 10, 20, 50, 100) if size <= (x1 - x0) / 4 or size == 0.1)
    left, low = x0 + 0.04 * (x1 - x0), y0 + 0.03 * (y1 - y0)
    axes.plot([left, left + length], [low, low], color=INK, linewidth=2.5, solid_capstyle="butt", zorder=1e6)
    axes.text(
        left + length + 0.015 * (x1 - x0),
        low,
        f"{length:g} mm",
        color=INK,
        fontsize=8,
        ha="left",
        va="center",
        zorder=1e6,
    )
    return axes


def quiet(axes: Axes) -> Axes:
    """Take away the lines above and to the right, and keep the numbers small; return the axes."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.tick_params(colors=INK, labelsize=8)
    return axes


def save(figure: Figure, path: Path, *, dpi: int = 150) -> Path:
    """Write a PNG; the file appears when it is whole. Equal figures give equal bytes."""
    with replacing(path, "wb") as file:
        figure.savefig(file, format="png", dpi=dpi, metadata={"Software": None})
    return Path(path)
