"""How many bodies have which error: the paper's Fig. 6."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from printmend.draw.figure import INK, PALETTE


def draw_histogram(axes: Axes, rmse_steps: np.ndarray, *, name: str, clip: float = 100.0, bins: int = 50) -> Axes:
    """Draw the bodies' RMSE [steps] as the paper does: one model, values above ``clip`` counted in the last bin."""
    values = np.asarray(rmse_steps, float)
    axes.hist(
        np.minimum(values, clip),
        bins=np.linspace(0, clip, bins + 1).tolist(),
        color=PALETTE[0],
        edgecolor="white",
        linewidth=0.4,
    )
    beyond = int((values > clip).sum())
    axes.set_xlabel(f"RMSE of a body [full steps], clipped at {clip:g} ({beyond} of {len(values)} above)")
    axes.set_ylabel("bodies")
    axes.set_title(name, color=INK, fontsize=11)
    return _quiet(axes)


def draw_log_histogram(axes: Axes, rmse_steps: Mapping[str, np.ndarray], *, bins: int = 40) -> Axes:
    """Draw every model's RMSE [steps] unclipped over a logarithmic axis, as outlines."""
    everything = np.concatenate([np.asarray(values, float) for values in rmse_steps.values()])
    positive = everything[everything > 0]
    low, high = (positive.min(), positive.max()) if len(positive) else (0.1, 1.0)
    edges = np.geomspace(low / 1.05, high * 1.05, bins + 1).tolist()
    for (name, values), colour in zip(
        rmse_steps.items(), PALETTE * (1 + len(rmse_steps) // len(PALETTE)), strict=False
    ):
        shown = np.clip(values, edges[0], edges[-1])
        axes.hist(shown, bins=edges, histtype="stepfilled", color=colour, alpha=0.12)
        axes.hist(
            shown,
            bins=edges,
            histtype="step",
            color=colour,
            linewidth=1.4,
            label=f"{name} (median {np.median(values):.3g})",
        )
    axes.set_xscale("log")
    axes.set_xlabel("RMSE of a body [full steps], not clipped")
    axes.set_ylabel("bodies")
    axes.legend(fontsize=8, frameon=False, loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    return _quiet(axes)


def _quiet(axes: Axes) -> Axes:
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.tick_params(colors=INK, labelsize=8)
    return axes
