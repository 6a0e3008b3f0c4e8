"""A bed larger than a sheet of paper: two or three sheets, taped and printed one after the other, that overlap.

All sheets show one pattern. Where two of them overlap, the printer makes the same dots again, coming to each as before,
so that a scan of one sheet can be laid onto that of the next. Each sheet spells a code of its own.
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from printmend.errors import ConfigError
from printmend.measure.plan import LEAST_SHARED, ProbePlan
from printmend.messages import say
from printmend.printer import Printer
from printmend.probe.layout import GLASS_EDGE_MM, LEAST_AREA_MM, MARKS, Layout, lay_out, mark_area_mm
from printmend.probe.walk import swings_for, walk_with

OVERLAP = 0.35  # of a sheet: what its neighbour shows, too
SPARE_RATIO = 1.2  # times as many marks are printed there as must be seen


def sheets_mm(printer: Printer, paper_mm: tuple[float, float], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners (low [K, 2], high [K, 2]) of the marks of so many sheets, side by side across the bed.

    They lie the way round that covers most of it. Raises `ConfigError` for paper too small for any marks.
    """
    low, high = mark_area_mm(printer)
    room = np.array(paper_mm) - 2 * GLASS_EDGE_MM
    if (room < LEAST_AREA_MM).any():
        raise ConfigError(
            "--scanner", wanted=say("sheets-least-mm-side", f"{LEAST_AREA_MM + 2 * GLASS_EDGE_MM:.0f}"),
            came=say("mm", f"{paper_mm[0]:g}", f"{paper_mm[1]:g}"),
            todo=say("give-their-width-height-mm-210x297"),
        )  # fmt: skip
    best: tuple[float, np.ndarray, np.ndarray] | None = None
    for sheet in (room, room[::-1]):
        for axis in range(2):
            times = np.ones(2)  # as large as one sheet is what all show
            times[axis] += (count - 1) * (1 - OVERLAP)
            whole = np.minimum(high - low, sheet * times)
            first, one = (low + high - whole) / 2, whole / times
            lows = first + np.arange(count)[:, None] / max(count - 1, 1) * (whole - one)
            if best is None or whole.prod() > 1.001 * best[0]:
                best = float(whole.prod()), lows, lows + one
    assert best is not None
    return best[1], best[2]


def design_sheets(printer: Printer, paper_mm: tuple[float, float], count: int, *, marks: int = MARKS) -> ProbePlan:
    """Lay out about ``marks`` marks over the bed, on ``count`` sheets of paper that overlap.

    Raises `ConfigError` for a bed or paper that is too small, for a bed that needs fewer sheets, and where too few
    marks would join them.
    """
    low, high = sheets_mm(printer, paper_mm, count)
    needless = sheets_mm(printer, paper_mm, count - 1)
    if np.ptp(np.vstack(needless), axis=0).prod() > 0.999 * np.ptp(np.vstack([low, high]), axis=0).prod():
        raise ConfigError(
            "--sheets", wanted=say("most-show-no-more-bed", count - 1, printer.name, count),
            came=str(count), todo=say("leave-out") if count == 2 else say("say-fewer"),
        )  # fmt: skip
    whole = lay_out(printer, low.min(axis=0), high.max(axis=0), marks=marks)
    swings = swings_for(len(whole.marks_mm))
    plans = []
    for corner, opposite in zip(low, high, strict=True):
        mine = np.flatnonzero(((whole.marks_mm >= corner) & (whole.marks_mm <= opposite)).all(axis=1))
        plans.append(walk_with(printer, _part(whole, mine), [swings[mark] for mark in mine]))
    shared = min(len({*map(tuple, one.site)} & {*map(tuple, other.site)}) for one, other in itertools.pairwise(plans))
    if shared < SPARE_RATIO * LEAST_SHARED:
        raise ConfigError(
            "--sheets",
            wanted=say("least-dots-where-two-sheets-overlap", f"{SPARE_RATIO * LEAST_SHARED:.0f}"),
            came=str(shared), todo=say("terminal-say-more-marks-larger-sheets-scanner"),
        )  # fmt: skip
    return sheet_after_sheet(plans)


def _part(whole: Layout, marks: np.ndarray) -> Layout:
    return replace(
        whole, marks_mm=whole.marks_mm[marks], site=whole.site[marks], heading=whole.heading[marks],
        row=whole.row[marks],
    )  # fmt: skip


def sheet_after_sheet(plans: Sequence[ProbePlan]) -> ProbePlan:
    """Return the plan of several sheets that are printed one after the other, homing before each.

    Homing moves every axis towards its end as a straight move would, so that one trace holds all of them.
    """
    begin = np.cumsum([0, *(len(plan.waypoints_mm) for plan in plans[:-1])])
    return replace(
        plans[0],
        waypoints_mm=np.concatenate([plan.waypoints_mm for plan in plans]),
        rows=np.concatenate([plan.rows + start for plan, start in zip(plans, begin, strict=True)]),
        site=np.concatenate([plan.site for plan in plans]),
        big=np.concatenate([plan.big for plan in plans]),
        direction=np.concatenate([plan.direction for plan in plans]),
        reversal_mm=np.concatenate([plan.reversal_mm for plan in plans]),
        starts=tuple(int(start) for start in begin),
    )
