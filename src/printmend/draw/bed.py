"""Errors over the bed, and over the layers of a part."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.ticker import MaxNLocator

from printmend.draw.drive import ENLARGED
from printmend.draw.figure import ERROR_COLOURS, INK, PALETTE, fit_view
from printmend.messages import Tell, say


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
