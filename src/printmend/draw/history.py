"""Faults over time: what was measured with its range, the trend, and the size that matters."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import matplotlib.dates as dates
import numpy as np
from matplotlib.axes import Axes

from printmend.draw.figure import INK


@dataclass(frozen=True, eq=False)
class Wear:
    """One fault over time: ``time_s`` [K] since 1970, ``size`` and ``sd`` [K] in ``unit``; the ``line`` of its trend as
    two (time, size), the ``level`` that matters and the range of time in which it is reached; None where not known."""

    title: str
    unit: str
    time_s: Sequence[float]
    size: Sequence[float]
    sd: Sequence[float]
    line: tuple[tuple[float, float], tuple[float, float]] | None
    level: float | None
    reached_s: tuple[float, float] | None


def draw_wear(axes: Axes, wear: Wear, colour: str) -> Axes:
    """Draw one fault over time."""
    when = [_date(one) for one in wear.time_s]
    axes.errorbar(
        when, wear.size, yerr=2 * np.asarray(wear.sd), fmt="o", color=colour, capsize=3, label="measured, 95 % range"
    )
    if wear.line is not None:
        (first, low), (last, high) = wear.line
        axes.plot([_date(first), _date(last)], [low, high], color=colour, linewidth=1.5, label="trend")
    if wear.level is not None:
        axes.axhline(wear.level, color=INK, linewidth=1, linestyle="--", label="matters from here on")
    if wear.reached_s is not None:
        axes.axvspan(_date(wear.reached_s[0]), _date(wear.reached_s[1]), color=colour, alpha=0.12)
    axes.xaxis_date()
    axes.set_title(wear.title, color=INK, fontsize=11)
    axes.set_ylabel(wear.unit, color=INK)
    axes.set_ylim(bottom=0)
    locator = dates.AutoDateLocator(maxticks=6)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(dates.ConciseDateFormatter(locator))
    axes.legend(fontsize=8, frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def _date(time_s: float) -> float:
    return float(dates.date2num(datetime.fromtimestamp(time_s, UTC)))
