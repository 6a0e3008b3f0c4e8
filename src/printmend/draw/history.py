"""Faults over time: what was measured with its range, the trend, and the size that matters."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import matplotlib.dates as dates
import numpy as np
from matplotlib.axes import Axes

from printmend.draw.figure import INK
from printmend.messages import Tell, say


@dataclass(frozen=True, eq=False)
class Wear:
    """One fault over time: ``time_s`` [K] since 1970, ``size`` and ``sd`` [K] in ``unit``; the ``line`` of its trend as
    two (time, size), each of the ``levels`` that matter with what it means, when the first was ``passed_s``, and the
    range of time ``reached_s`` in which the last will be; None where not known."""

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
    """Draw one fault over time; ``tell`` puts the words into a language."""
    when = [_date(one) for one in wear.time_s]
    measured = tell(say("wear-measured"))
    axes.errorbar(when, wear.size, yerr=2 * np.asarray(wear.sd), fmt="o", color=colour, capsize=3, label=measured)
    if wear.line is not None:
        (first, low), (last, high) = wear.line
        axes.plot([_date(first), _date(last)], [low, high], color=colour, linewidth=1.5, label=tell(say("wear-trend")))
    for (level, means), style in zip(wear.levels, ("--", ":"), strict=False):
        axes.axhline(level, color=INK, linewidth=1, linestyle=style)
        passed = wear.line is None or level <= wear.line[1][1] - 1e-9  # then the trend leaves the right end free
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
    locator = dates.AutoDateLocator(minticks=3, maxticks=7)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(dates.ConciseDateFormatter(locator))
    axes.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def _date(time_s: float) -> float:
    return float(dates.date2num(datetime.fromtimestamp(time_s, UTC)))
