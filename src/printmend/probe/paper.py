"""Sheets of paper on the bed: where to tape each, its prime line, and several sheets for a larger bed.

Two or three sheets are printed one after the other and overlap. All show one pattern. Where two overlap, the printer
makes the same dots again and approaches each as before, so that a scan of one sheet can be aligned with the next. Each
sheet has its own code.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from printmend.errors import ConfigError
from printmend.measure.plan import LEAST_SHARED, ProbePlan, approaches
from printmend.messages import say
from printmend.path import frozen
from printmend.printer import Printer
from printmend.probe.layout import (
    EDGE_MM,
    GLASS_EDGE_MM,
    LEAST_AREA_MM,
    MARKS,
    PURGE_MM,
    Layout,
    code_of,
    lay_out,
    mark_area_mm,
    snapped,
    swings_for,
    walk_with,
)
from printmend.units import A4_MM, LETTER_MM

OVERLAP = 0.35  # share of a sheet that its neighbour shows, too
SPARE_RATIO = 1.2  # least ratio of marks printed in an overlap to marks that scans must share


def sheets_mm(printer: Printer, paper_mm: tuple[float, float], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners (low [K, 2], high [K, 2]) of the marks of ``count`` sheets, side by side across the bed.

    Their orientation covers most of the bed. Raises `ConfigError` for paper too small for any marks.
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
            times = np.ones(2)  # size of the area on all sheets, over that of one
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

    Raises `ConfigError` for a bed or paper that is too small, for a bed that needs fewer sheets, and if too few marks
    would join them.
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

    Homing moves every axis to its end, as a straight move would. So one trace can hold all sheets.
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


PRIME_EDGE_MM = 4.0  # from the sheet's edges to the prime line, or to where a pen first touches
NAMES = {A4_MM: "A4", LETTER_MM: "letter"}
SPARE_MM = 10.0  # how much larger a scanner's glass may be than the sheet that it is made for


@dataclass(frozen=True, eq=False)
class Paper:
    """A sheet on the bed: its corners ``low_mm`` [2] and ``high_mm`` [2], and how far it hangs over the bed's back
    edge, ``back_mm``."""

    low_mm: np.ndarray
    high_mm: np.ndarray
    back_mm: float

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width along X and along Y."""
        return (float(self.high_mm[0] - self.low_mm[0]), float(self.high_mm[1] - self.low_mm[1]))

    @property
    def name(self) -> str:
        """Its name and orientation."""
        short, long = sorted(self.size_mm)
        known = next((name for size, name in NAMES.items() if np.allclose(size, (short, long))), None)
        if known is None:
            return say("paper-of-size", *(f"{side:g}" for side in self.size_mm))
        return say("paper-upright" if self.size_mm[1] >= self.size_mm[0] else "paper-lying", known)

    @property
    def place(self) -> str:
        """Where its corner goes, and how far it overhangs the bed."""
        corner = say("paper-corner", f"{self.low_mm[0]:.0f}", f"{self.low_mm[1]:.0f}")
        return say("paper-hangs-over", corner, f"{self.back_mm:.0f}") if self.back_mm > 0.5 else corner


def paper_for(glass_mm: tuple[float, float]) -> tuple[float, float]:
    """Return the sheet [mm] for a scanner's glass: A4 or letter if the glass is made for one, else its whole size."""
    for sheet in NAMES:
        if all(0 <= glass - side <= SPARE_MM for glass, side in zip(glass_mm, sheet, strict=True)):
            return sheet
    return glass_mm


def papers_of(plan: ProbePlan, printer: Printer, paper_mm: tuple[float, float]) -> tuple[Paper, ...]:
    """Return where each sheet of a plan goes: in the orientation that holds its dots, with as much of it on the bed as
    possible.

    Raises `ConfigError` for dots that a sheet cannot hold.
    """
    return tuple(_paper(one, printer, paper_mm) for one in plan.sheets)


def _paper(plan: ProbePlan, printer: Printer, paper_mm: tuple[float, float]) -> Paper:
    first, last = plan.marks_mm.min(axis=0), plan.marks_mm.max(axis=0)
    bed = np.array([[axis.min_mm, axis.max_mm] for axis in (printer.x, printer.y)])
    needed = last - first + 2 * (GLASS_EDGE_MM - 0.5)
    ways = [np.array(way) for way in (paper_mm, paper_mm[::-1]) if (needed <= way).all()]
    if not ways:
        raise ConfigError(
            say("subject-paper"),
            wanted=say("sheet-dots-over-mm", f"{last[0] - first[0]:.0f}", f"{last[1] - first[1]:.0f}"),
            came=say("mm", f"{paper_mm[0]:g}", f"{paper_mm[1]:g}"),
            todo=say("terminal-make-size-smaller-name-larger-scanner"),
        )  # fmt: skip
    size = min(ways, key=lambda way: float(np.maximum(way - np.ptp(bed, axis=1), 0.0).sum()))
    low = np.maximum(np.minimum((first + last - size) / 2, bed[:, 1] - size), bed[:, 0])
    return Paper(low, low + size, max(float(low[1] + size[1] - bed[1, 1]), 0.0))


def on_paper(plan: ProbePlan, printer: Printer, papers: Sequence[Paper]) -> ProbePlan:
    """Return the plan of marks on paper, with each sheet's prime line on the sheet itself, along its front edge."""
    sheets = [_primed(one, printer, paper) for one, paper in zip(plan.sheets, papers, strict=True)]
    return sheets[0] if len(sheets) == 1 else sheet_after_sheet(sheets)


def _primed(plan: ProbePlan, printer: Printer, paper: Paper) -> ProbePlan:
    bed = np.array([[axis.min_mm + EDGE_MM, axis.max_mm - EDGE_MM] for axis in (printer.x, printer.y)])
    start = np.maximum(paper.low_mm + PRIME_EDGE_MM, bed[:, 0])
    end = min(start[0] + PURGE_MM, paper.high_mm[0] - PRIME_EDGE_MM, bed[0, 1])
    waypoints = plan.waypoints_mm.copy()
    waypoints[1:3] = snapped(printer, np.array([start, [end, start[1]]]))
    direction, reversal = approaches(waypoints)
    big = code_of(printer, waypoints, plan.site)
    return replace(
        plan, waypoints_mm=frozen(waypoints), big=big, direction=direction[plan.rows], reversal_mm=reversal[plan.rows],
        paper=True,
    )  # fmt: skip


def first_touch_mm(plan: ProbePlan, paper: Paper) -> tuple[float, float]:
    """Return how far from the sheet's left and front edge the prime line ends, where a pen touches first."""
    x, y = plan.waypoints_mm[2] - paper.low_mm
    return float(x), float(y)
