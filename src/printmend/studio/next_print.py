"""Find the cheapest next print: the smallest test print that would close a measurement's gaps."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from printmend.diagnosis.named import is_gap_of_z
from printmend.printer import Printer
from printmend.probe import cost, design_probe, expected_error_mm, turns_covered

_STEP_MM = 10.0  # step between the offered sizes
_ENOUGH_RATIO = 2.0  # largest ratio of a smaller print's remaining error to that of a print over the whole bed


@dataclass(frozen=True)
class NextPrint:
    """A square of marks: its side, its cost, and the error that remains over the bed after measuring it."""

    size_mm: float
    marks: int
    minutes: float
    grams: float
    expected_mm: float


def next_print(printer: Printer, gaps: Sequence[str]) -> NextPrint | None:
    """Return the smallest print that shows each motor's whole turn and leaves at most twice the error of the largest.

    None if all gaps concern Z, which no flat print shows.
    """
    if all(map(is_gap_of_z, gaps)):
        return None
    largest_mm = min(printer.x.max_mm - printer.x.min_mm, printer.y.max_mm - printer.y.min_mm)
    least_mm = min(largest_mm, max(printer.mm_per_turn))
    largest = _square(printer, None)
    sizes_mm = [*np.arange(-(-least_mm // _STEP_MM) * _STEP_MM, largest_mm, _STEP_MM), None]

    def is_enough(size_mm: float | None) -> bool:
        plan = design_probe(printer, size_mm=size_mm)
        seen = min(turns_covered(printer, plan)) >= 1
        return seen and expected_error_mm(printer, plan) <= _ENOUGH_RATIO * largest.expected_mm

    at = bisect_left(sizes_mm[:-1], True, key=is_enough)
    return largest if sizes_mm[at] is None else _square(printer, float(sizes_mm[at]))


def _square(printer: Printer, size_mm: float | None) -> NextPrint:
    """Return a test print with this side, the largest for None."""
    plan = design_probe(printer, size_mm=size_mm)
    minutes, grams = cost(plan)
    size_mm = float(np.ptp(plan.marks_mm, axis=0).max()) if size_mm is None else size_mm
    return NextPrint(size_mm, len(plan), float(minutes), float(grams), expected_error_mm(printer, plan))
