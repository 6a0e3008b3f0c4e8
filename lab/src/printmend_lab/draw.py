"""Pictures of the paper: bodies as solids (Fig. 1), an axis' error, and the errors of many bodies (Fig. 6)."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, to_rgb
from matplotlib.ticker import MaxNLocator

from printmend.draw import PrintedLayer
from printmend.draw.body import add_beads, box_of, runs
from printmend.draw.figure import ERROR_COLOURS, INK, PALETTE, draw_scale_bar, fit_view, plain, quiet
from printmend.printer import Printer
from printmend_lab.path import Layer

SOLID_BEAD_MM = 0.45  # width of a bead in the solid view: a little wider, so that no light shows between layers
_AZIMUTH, _ELEVATION = np.radians(-60.0), np.radians(38.0)
_CLIP_STEPS, _BINS = 100.0, 50  # of the paper's own figure
_LOG_BINS = 40
_MANY = 30  # bodies in one bin, beside which single ones are not seen


def printed_layer(layer: Layer, printed_steps: np.ndarray, printer: Printer) -> PrintedLayer:
    """Return the print [T + 1, 2] steps of a layer in mm, with each point's distance from its target."""
    pitch_mm = np.array(printer.mm_per_step)
    error_mm = np.hypot(*((printed_steps - layer.nominal_steps) * pitch_mm).T)
    corner_mm = np.array([printer.x.min_mm, printer.y.min_mm])
    return PrintedLayer(layer.z_mm, corner_mm + printed_steps * pitch_mm, layer.extruding, error_mm)


def draw_solid(
    axes: Axes,
    layers: Sequence[PrintedLayer],
    *,
    colours: Normalize,
    view_mm: np.ndarray,
) -> Axes:
    """Draw a body as its stacked beads, seen obliquely from above and lit from the left; see `draw_above`.

    An orthographic projection drawn from the bed upwards: what is nearer the eye is drawn later, so nothing has
    to be sorted, and a body of a million points takes seconds where a 3-D canvas takes minutes.
    """
    fit_view(axes, *view_mm)
    ink = np.array(to_rgb(INK))
    top_mm = max(layer.z_mm for layer in layers)
    for order, layer in enumerate(layers):
        lines, errors = runs(project(layer.points_mm, layer.z_mm), layer.extruding, layer.error_mm)
        if not lines:
            continue
        # The lid is seen full on; the walls below it are darker, so that the solid stands out.
        light = _light(lines)[:, None] * (1.0 if layer.z_mm >= top_mm else 0.85)
        colour = light * ERROR_COLOURS(colours(errors))[:, :3] + (1 - light) * ink
        add_beads(axes, lines, colour, bead_mm=SOLID_BEAD_MM, order=order)
    return draw_scale_bar(plain(axes))


def project(points_mm: np.ndarray, z_mm: float) -> np.ndarray:
    """Return points [N, 2] at height z in the picture plane [N, 2]."""
    x, y = points_mm.T
    across = -np.sin(_AZIMUTH) * x + np.cos(_AZIMUTH) * y
    away = np.cos(_AZIMUTH) * x + np.sin(_AZIMUTH) * y
    return np.stack([across, -np.sin(_ELEVATION) * away + np.cos(_ELEVATION) * z_mm], axis=1)


def _light(lines: list[np.ndarray]) -> np.ndarray:
    """Return the light [K] of 0.75…1 on each run by its direction."""
    direction = np.array([line[-1] - line[0] for line in lines])
    return 0.875 + 0.125 * np.cos(2 * np.arctan2(direction[:, 1], direction[:, 0]) - 0.6)


def solid_view(layers: Sequence[PrintedLayer]) -> np.ndarray:
    """Return the corners [2, 2] of the box that `draw_solid` needs for all the layers."""
    return box_of([project(layer.points_mm, layer.z_mm) for layer in layers])


def draw_axis_error(
    axes: Axes, nominal_mm: np.ndarray, printed_mm: np.ndarray, *, axis_name: str, mm_per_turn: float = 40.0
) -> Axes:
    """Draw printed − nominal [mm] over the nominal position [N] mm of one axis, one colour a direction of motion.

    A round of the wave a turn of the motor (grey lines) is the pulley; the gap between the two colours is the play.
    """
    nominal_mm, printed_mm = np.asarray(nominal_mm, float), np.asarray(printed_mm, float)
    error, motion = printed_mm - nominal_mm, np.diff(nominal_mm, prepend=nominal_mm[0])
    for turn in np.arange(np.floor(nominal_mm.min() / mm_per_turn), np.ceil(nominal_mm.max() / mm_per_turn) + 1):
        axes.axvline(turn * mm_per_turn, color="#dee2e6", linewidth=1, zorder=0)
    axes.axhline(0, color=INK, linewidth=0.6, zorder=1)
    for sign, colour, name in ((1, PALETTE[0], "moving forwards"), (-1, PALETTE[1], "moving backwards")):
        going = np.sign(motion) == sign
        axes.plot(nominal_mm[going], error[going], ".", color=colour, markersize=2, label=name, alpha=0.6)
    span = nominal_mm.max() - nominal_mm.min() or 1.0
    axes.set_xlim(nominal_mm.min() - 0.02 * span, nominal_mm.max() + 0.02 * span)
    axes.set_xlabel(f"{axis_name} where it belongs [mm]; grey: whole turns of the motor")
    axes.set_ylabel(f"error of {axis_name} [mm]")
    axes.legend(fontsize=8, frameon=False, markerscale=4)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return axes


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
