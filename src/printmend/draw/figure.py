"""Draw drives, errors and a printer's history, without pyplot, on the Agg canvas, with one palette."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import matplotlib.dates as dates
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator, ScalarFormatter

from printmend.files import replacing
from printmend.messages import Tell, say
from printmend.units import TURN_RAD

INK = "#22303a"
PALETTE = ("#0b7285", "#e8590c", "#5f3dc4", "#2b8a3e", "#c2255c", "#868e96", "#1864ab")
# Cool colours mean small errors, hot colours large ones; the lightness grows to the middle and falls again.
ERROR_COLOURS = LinearSegmentedColormap.from_list("error", ["#0b7285", "#3bc9b0", "#ffd43b", "#f76707", "#a61e4d"])
# The lower half of these colours is for the small errors after mending, which would otherwise all look the same.
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
    first: int = 0, tell: Tell = str,
) -> Figure:  # fmt: skip
    """Return a row of pictures, as the paper's Fig. 1 and 5; below those from ``first`` on is a bar of error [mm]."""
    figure, axes = new_figure(len(draw), width_in=4.4, height_in=4.6)
    figure.subplots_adjust(left=0.01, right=0.99, top=0.84, bottom=0.15, wspace=0.02)
    figure.suptitle((words := tell(title))[:1].upper() + words[1:], color=INK, fontsize=13, y=0.98)
    left, right = axes[first].get_position().x0, axes[-1].get_position().x1
    for one, name, draw_one in zip(axes, titles, draw, strict=True):
        draw_one(one)
        one.set_title(tell(name), color=INK, fontsize=11)
    if colours is not None:
        bar = figure.colorbar(
            ScalarMappable(colours, ERROR_COLOURS),
            cax=figure.add_axes((0.7 * left + 0.3 * right, 0.09, 0.4 * (right - left), 0.022)),
            orientation="horizontal",
            extend="max",
            format=_Numbers(tell),
        )
        bar.set_label(tell(say("draw-error")), color=INK, fontsize=9)
        bar.ax.tick_params(labelsize=8, colors=INK)
        bar.outline.set_visible(False)
    return figure


def plain(axes: Axes) -> Axes:
    """Remove the frame and the ticks from a picture with a scale bar."""
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
    """Draw a bar with a round length [mm] and its label in the lower left corner, below the drawing."""
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


class _Numbers(ScalarFormatter):
    """The numbers at an axis, as a language writes them."""

    def __init__(self, tell: Tell) -> None:
        super().__init__()
        self._tell = tell

    def __call__(self, x: float, pos: int | None = None) -> str:
        return self._tell(super().__call__(x, pos))


def quiet(axes: Axes, tell: Tell = str, *, framed: bool = False) -> Axes:
    """Make the numbers small, and remove the lines above and to the right if not ``framed``; return the axes."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(framed)
    for axis in (axes.xaxis, axes.yaxis):
        if type(axis.get_major_formatter()) is ScalarFormatter:
            axis.set_major_formatter(_Numbers(tell))
    axes.tick_params(colors=INK, labelsize=8)
    return axes


def save(figure: Figure, path: Path, *, dpi: int = 150) -> Path:
    """Write a PNG; the file appears when it is complete. Equal figures give equal bytes."""
    with replacing(path, "wb") as file:
        figure.savefig(file, format="png", dpi=dpi, metadata={"Software": None})
    return Path(path)


# Draw one motor's learned drive: its error along the axis, its play, and its pulley.

WAYS = (say("moving-forwards"), say("moving-backwards"))
ENLARGED = (1, 2, 5, 10, 20, 50, 100, 200)
LEAST_UNROUND_MM = 0.02  # deviations of a rounder pulley are not enlarged: it would look like a star
LEAST_SPAN_MM = 0.05  # a healthy axis should not look wild


def draw_fit(
    axes: Axes,
    motor_mm: np.ndarray,
    error_mm: np.ndarray,
    band_mm: np.ndarray,
    points: tuple[np.ndarray, np.ndarray, np.ndarray],
    *,
    name: str,
    mm_per_turn: float,
    shows_scale: bool = True,
    tell: Tell = str,
) -> Axes:
    """Draw the learned error [2, N] over the motor's position [N], a colour for each direction, with measured points.

    ``band_mm`` [2, N] is the half-width of the band that should contain 95 % of the measured points. ``points`` are
    their positions [M], errors [M] and directions [M] (0 forwards, 1 backwards). ``shows_scale``:
    they include the scale error.
    """
    place, off, side = points
    for turn in np.arange(np.ceil(motor_mm[0] / mm_per_turn), np.floor(motor_mm[-1] / mm_per_turn) + 1):
        axes.axvline(turn * mm_per_turn, color="#dee2e6", linewidth=1, zorder=0)
    axes.axhline(0, color=INK, linewidth=0.6, zorder=1)
    for way in (0, 1):
        colour = PALETTE[way]
        axes.plot(place[side == way], off[side == way], ".", color=colour, markersize=2.5, alpha=0.5, zorder=2)
        low, high = error_mm[way] - band_mm[way], error_mm[way] + band_mm[way]
        axes.fill_between(motor_mm, low, high, color=colour, alpha=0.22, linewidth=0, zorder=3)
        axes.plot(motor_mm, error_mm[way], color=colour, linewidth=1.4, label=tell(WAYS[way]), zorder=4)
    low, high = float(error_mm.min()), float(error_mm.max())
    room = 0.15 * (high - low) + 2 * float(np.median(band_mm)) + LEAST_SPAN_MM / 2
    axes.set_ylim(low - room, high + room + 0.12 * (high - low + 2 * room))  # with room for the legend above
    axes.set_xlim(motor_mm[0], motor_mm[-1])
    axes.set_xlabel(tell(say("draw-position-turns", name)), fontsize=8)
    label = say("draw-printed-commanded" if shows_scale else "draw-printed-commanded-no-scale")
    axes.set_ylabel(tell(label), fontsize=8)
    axes.set_title(tell(say("draw-dots-lines", name)), color=INK, fontsize=10)
    axes.legend(fontsize=7, frameon=False, loc="upper left", ncols=2)
    return quiet(axes, tell)


def draw_play(
    axes: Axes, motor_mm: np.ndarray, play_mm: np.ndarray, sd_mm: np.ndarray, *, name: str, tell: Tell = str
) -> Axes:
    """Draw the play [N] mm along the axis, with a band of two standard deviations [N]."""
    axes.fill_between(
        motor_mm, np.maximum(play_mm - 2 * sd_mm, 0), play_mm + 2 * sd_mm, color=PALETTE[2], alpha=0.25, linewidth=0
    )
    axes.plot(motor_mm, play_mm, color=PALETTE[2], linewidth=1.4)
    axes.set_xlim(motor_mm[0], motor_mm[-1])
    axes.set_ylim(0, max(1.25 * float((play_mm + 2 * sd_mm).max()), LEAST_SPAN_MM))
    axes.set_xlabel(tell(say("draw-position", name)), fontsize=8)
    axes.set_ylabel(tell(say("draw-play")), fontsize=8)
    axes.set_title(tell(say("draw-slack", name)), color=INK, fontsize=10)
    return quiet(axes, tell)


def draw_hull(axes: Axes, outline_mm: np.ndarray, *, radius_mm: float, name: str, tell: Tell = str) -> Axes:
    """Draw a pulley's hull [N, 2] over a round one, about the shaft; small differences are enlarged."""
    reach = np.hypot(*outline_mm.T)
    most = float(np.abs(reach - radius_mm).max())
    factor = max((k for k in ENLARGED if k * most <= 0.35 * radius_mm), default=1) if most > LEAST_UNROUND_MM else 1
    drawn = outline_mm * ((radius_mm + factor * (reach - radius_mm)) / reach)[:, None]
    axes.add_patch(Circle((0, 0), radius_mm, fill=False, edgecolor=PALETTE[5], linestyle=(0, (4, 3)), linewidth=1))
    axes.fill(*drawn.T, facecolor=PALETTE[0], alpha=0.18, linewidth=0)
    axes.plot(*np.vstack([drawn, drawn[:1]]).T, color=PALETTE[0], linewidth=1.6)
    axes.plot([0], [0], "+", color=INK, markersize=9)
    span = 1.15 * max(float(np.abs(drawn).max()), radius_mm)
    axes.set_xlim(-span, span)
    axes.set_ylim(-span, span)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)
    shown = say("draw-true-to-scale") if factor == 1 else say("draw-enlarged", factor)
    axes.set_title(tell(say("draw-pulley", name)), color=INK, fontsize=10)
    axes.set_xlabel(tell(say("draw-dashed-round", shown)), fontsize=7)
    return axes


# Draw errors: over the bed and a part's layers, along its lines, and on a circle.


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
    return quiet(axes, tell, framed=True)


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
    return quiet(axes, tell)


def draw_coloured(
    axes: Axes, lines_mm: Sequence[np.ndarray], error_mm: np.ndarray, *, corners_mm: tuple[np.ndarray, np.ndarray],
    worst_mm: float, title: str, fine_mm: float | None = None, tell: Tell = str,
) -> Axes:  # fmt: skip
    """Draw lines [K] of [N, 2], coloured by their errors [K] up to ``worst_mm``, with a colour bar below.

    Errors up to ``fine_mm`` get half of the colours, so that they do not all look the same.
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
            bar.set_ticklabels([tell(each) for each in ("0", f"{fine_mm:.3f}", f"{worst_mm:.2f}")])
        bar.set_label(tell(say("draw-error")), color=INK, fontsize=9)
        bar.ax.tick_params(labelsize=8, colors=INK)
        bar.outline.set_visible(False)
    axes.set_title(tell(title), color=INK, fontsize=11)
    return draw_scale_bar(plain(axes))


_DIVISIONS_MM = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
_RINGS = 3  # divisions drawn to either side of the circle
_RING = 0.11  # drawn width of a division, as a share of the radius
_PALE = "#dee2e6"
_WAYS = (say("clockwise"), say("counter-clockwise"))


def draw_circle_test(
    axes: Axes, angle_rad: np.ndarray, off_mm: tuple[np.ndarray, np.ndarray], *, radius_mm: float,
    tell: Tell = str,
) -> Axes:  # fmt: skip
    """Draw how far outside a circle a machine runs at ``angle_rad`` [N]: ``off_mm`` [N] clockwise and [N]
    counter-clockwise. Two grey rings are one division apart, which is a round size."""
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
    axes.legend(fontsize=8, frameon=False, loc="lower center", ncols=2, handlelength=1.2, columnspacing=1.0)
    return plain(axes)


# Draw faults over time: measured sizes with their ranges, the trend, and the sizes that matter.


_LEAST_DAYS = 28.0  # a shorter time is drawn as this: its days are then named


@dataclass(frozen=True, eq=False)
class Wear:
    """One fault over time: ``time_s`` [K] since 1970, ``size`` and ``sd`` [K] in ``unit``; its trend's ``line`` as two
    (time, size); the ``levels`` that matter with their meanings; the time ``passed_s`` of passing the first level, and
    the range of times ``reached_s`` of reaching the last. None if not known."""

    title: str
    unit: str
    time_s: Sequence[float]
    size: Sequence[float]
    sd: Sequence[float]
    line: tuple[tuple[float, float], tuple[float, float]] | None
    levels: Sequence[tuple[float, str]]
    passed_s: float | None
    reached_s: tuple[float, float] | None


def draw_wear(axes: Axes, wear: Wear, colour: str, tell: Tell = str) -> Axes:
    """Draw one fault over time; ``tell`` translates the words."""
    when = [_date(one) for one in wear.time_s]
    measured = tell(say("wear-measured"))
    axes.errorbar(when, wear.size, yerr=2 * np.asarray(wear.sd), fmt="o", color=colour, capsize=3, label=measured)
    if wear.line is not None:
        (first, low), (last, high) = wear.line
        axes.plot([_date(first), _date(last)], [low, high], color=colour, linewidth=1.5, label=tell(say("wear-trend")))
    for (level, means), style in zip(wear.levels, ("--", ":"), strict=False):
        axes.axhline(level, color=INK, linewidth=1, linestyle=style)
        passed = wear.line is None or level <= wear.line[1][1] - 1e-9  # the trend then leaves the right end free
        axes.annotate(
            tell(means), (1.0 if passed else 0.0, level), xycoords=("axes fraction", "data"),
            xytext=(-4, -10) if passed else (4, 3), textcoords="offset points", ha="right" if passed else "left",
            fontsize=8, color=INK,
        )  # fmt: skip
    if wear.passed_s is not None:
        here = tell(say("wear-passed"))
        axes.plot(_date(wear.passed_s), wear.levels[0][0], "X", color=INK, markersize=9, zorder=4, label=here)
    if wear.reached_s is not None:
        first, last = map(_date, wear.reached_s)
        axes.axvspan(first, last, color=colour, alpha=0.12, label=tell(say("wear-reached")))
    axes.xaxis_date()
    axes.set_title(tell(wear.title), color=INK, fontsize=11)
    axes.set_ylabel(wear.unit, color=INK)
    axes.set_ylim(bottom=0, top=1.12 * axes.get_ylim()[1])
    first, last = axes.dataLim.intervalx
    if last - first < _LEAST_DAYS:
        axes.set_xlim((first + last - _LEAST_DAYS) / 2, (first + last + _LEAST_DAYS) / 2)
    axes.xaxis.set_major_locator(dates.AutoDateLocator(minticks=3, maxticks=5))
    axes.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2)
    return quiet(axes, tell)


def _date(time_s: float) -> float:
    return float(dates.date2num(datetime.fromtimestamp(time_s, UTC)))
