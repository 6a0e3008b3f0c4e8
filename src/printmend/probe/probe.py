"""A probe print: from a printer to G-code and its plan."""

from pathlib import Path

import numpy as np

from printmend.errors import GcodeError
from printmend.files import replacing
from printmend.gcode.read import Program
from printmend.measure.plan import ProbePlan, write_plan
from printmend.printer import Printer
from printmend.probe.gcode import probe_gcode
from printmend.probe.layout import area_around_mm, lay_out, mark_area_mm, square_mm
from printmend.probe.walk import walk


def design_probe(printer: Printer, *, size_mm: float | None = None, part: Program | None = None) -> ProbePlan:
    """Lay the marks out over the whole bed, a square of ``size_mm`` in its middle, or where ``part`` is printed.

    The pattern is that of physics.md §5. Raises `ConfigError` where the bed is too small for marks, `GcodeError` for a
    part that extrudes nothing.
    """
    if part is not None:
        low, high = area_around_mm(printer, _printed_mm(part))
    elif size_mm is not None:
        low, high = square_mm(printer, size_mm)
    else:
        low, high = mark_area_mm(printer)
    return walk(printer, lay_out(printer, low, high))


def _printed_mm(part: Program) -> np.ndarray:
    """Return the ends [N, 2] of the moves that print the part."""
    rows = part.moves.extruding & part.moves.known[:, :2].all(axis=1)
    if not rows.any():
        raise GcodeError(part.name, wanted="a part that is printed", came="no extruding move", todo="check the file")
    return np.vstack([part.moves.start_mm[rows, :2], part.moves.end_mm[rows, :2]])


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
