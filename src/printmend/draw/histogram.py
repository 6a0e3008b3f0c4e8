"""How many bodies have which error: the paper's Fig. 6."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from printmend.draw.figure import INK, PALETTE, quiet

_CLIP_STEPS, _BINS = 100.0, 50  # of the paper's own figure
_LOG_BINS = 40
_MANY = 30  # bodies in one bin, beside which single ones are not seen


def draw_histogram(axes: Axes, rmse_steps: np.ndarray, *, name: str) -> Axes:
    """Draw the bodies' RMSE [steps] as the paper does: one model, values above 100 counted in the last bin.

    The axis ends at the largest error where none is above; many bodies are counted on a logarithmic axis, so that the
    few with large errors are seen, too.
    """
    values = np.asarray(rmse_steps, float)
    beyond = int((values > _CLIP_STEPS).sum())
    end = _CLIP_STEPS if beyond else max(float(values.max(initial=0.0)), 1e-3)
    counts, _, _ = axes.hist(
        np.minimum(values, end),
        bins=np.linspace(0, end, _BINS + 1).tolist(),
        color=PALETTE[0],
        edgecolor="white",
        linewidth=0.4,
    )
    said = f", clipped at {_CLIP_STEPS:g} ({beyond} of {len(values)} above)" if beyond else ""
    axes.set_xlabel(f"RMSE of a body [full steps]{said}", fontsize=9)
    if np.max(counts) >= _MANY:
        axes.set_yscale("log")
        axes.set_ylim(0.7)
        axes.yaxis.set_major_formatter("{x:g}")
    else:
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylabel("bodies", fontsize=9)
    axes.set_title(name, color=INK, fontsize=11)
    return quiet(axes)


def draw_log_histogram(axes: Axes, rmse_steps: Mapping[str, np.ndarray]) -> Axes:
    """Draw every model's RMSE [steps] unclipped over one logarithmic axis, a strip a model, its median marked.

    Each strip is scaled to its own height; the numbers on the right are the medians. What is below a hundredth of the
    median of all counts in the first bar: one body without an error would press all others together."""
    everything = np.concatenate([np.asarray(values, float) for values in rmse_steps.values()])
    positive = everything[everything > 0]
    low, high = 0.1, 1.0
    if len(positive):
        low, high = max(float(positive.min()), float(np.median(positive)) / 100), float(positive.max())
    edges = np.geomspace(low / 1.05, high * 1.05, _LOG_BINS + 1)
    counts = [np.histogram(np.clip(values, edges[0], edges[-1]), edges)[0] for values in rmse_steps.values()]
    strips = np.arange(len(counts))[::-1]
    for strip, count, values in zip(strips, counts, rmse_steps.values(), strict=True):
        median = max(float(np.median(values)), edges[0])
        axes.stairs(strip + 0.8 * count / count.max(), edges, baseline=strip, fill=True, color=PALETTE[0], alpha=0.75)
        axes.plot([median, median], [strip, strip + 0.8], color=INK, linewidth=1.2)
        axes.text(1.01, strip + 0.3, f"{np.median(values):.3g}", transform=axes.get_yaxis_transform(), fontsize=8)
    axes.set_xscale("log")
    axes.set_xlim(edges[0], edges[-1])
    axes.set_yticks(strips + 0.3, list(rmse_steps))
    axes.set_ylim(-0.05, len(counts) + 0.15)
    axes.set_xlabel("RMSE of a body [full steps], not clipped; line and number: median", fontsize=9)
    axes.set_title("all models", color=INK, fontsize=11)
    return quiet(axes)
