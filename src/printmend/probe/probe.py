"""A probe print: from a printer to G-code and its plan."""

from pathlib import Path

import numpy as np

from printmend.files import replacing
from printmend.measure.plan import ProbePlan, write_plan
from printmend.printer import Printer
from printmend.probe.gcode import probe_gcode
from printmend.probe.layout import lay_out, mark_area_mm
from printmend.probe.walk import walk


def design_probe(printer: Printer, *, size_mm: float | None = None) -> ProbePlan:
    """Lay the marks out over the whole bed, or over a square of ``size_mm`` in its middle (physics.md §5).

    Raises `ConfigError` where the bed or the square is too small for marks.
    """
    low, high = mark_area_mm(printer, size_mm)
    return walk(printer, lay_out(printer, low, high))


def turns_covered(printer: Printer, plan: ProbePlan) -> tuple[float, float]:
    """Return how many turns of each motor the marks span. Below one turn a pulley cannot be learned well."""
    spans = np.ptp(printer.to_motor(plan.marks_mm), axis=0)
    return float(spans[0] / printer.x.mm_per_turn), float(spans[1] / printer.y.mm_per_turn)


def write_probe(path: Path, plan: ProbePlan) -> Path:
    """Write the G-code to ``path`` and the plan beside it; return the plan's path."""
    plan_path = path.with_suffix(".json")
    with replacing(path) as file:
        file.write(probe_gcode(plan))
    write_plan(plan_path, plan)
    return plan_path
