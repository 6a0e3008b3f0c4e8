"""Design a probe print for a printer; write its G-code and its plan."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from printmend.errors import ConfigError, GcodeError, InputError
from printmend.files import read_text, replacing
from printmend.gcode.read import Program
from printmend.measure.plan import ProbePlan, plan_text, write_plan
from printmend.messages import say
from printmend.path import Trace
from printmend.printer import Extruder, Printer, printer_of
from printmend.printer.printer import PAUSE
from printmend.probe.gcode import probe_gcode
from printmend.probe.layout import MARKS, area_around_mm, glass_area_mm, lay_out, mark_area_mm, square_mm, walk
from printmend.probe.paper import Paper
from printmend.probe.part_layer import layer_plan, longest_layer_mm
from printmend.probe.pen import pen_gcode
from printmend.probe.tiles import belief_after, chosen_plans, fall_of, information, prior_belief, still_unknown
from printmend.provenance import sealed_test_print

DESIGNS = ("fixed", "layer", "optimal", "active")
PHASE_MARKS, PHASE_TURNS = 80, 1.6  # marks and turns of the print that finds a known printer's motor phases
TARGETS = 2000  # places of the bed for which a print is optimised


def design_probe(
    printer: Printer | str | Path,
    *,
    design: str = "fixed",
    size_mm: float | None = None,
    part: Program | None = None,
    after: Trace | None = None,
    marks: int = MARKS,
    glass_mm: tuple[float, float] | None = None,
) -> ProbePlan:
    """Lay out about ``marks`` marks over the whole bed, a square of ``size_mm`` in its middle, or for ``part``.

    ``glass_mm`` keeps them within what a scanner's glass of this size, or a sheet of paper, shows.

    ``fixed`` is the pattern of physics.md §5 where the part is printed; ``layer`` follows the part's longest layer;
    ``optimal`` chooses the marks that reduce the part's expected error most, ``active`` those with most information;
    both may start from the trace ``after``. Raises `ConfigError` for another design and if the bed is too small,
    `GcodeError` for a part that extrudes nothing or whose layer is too small.
    """
    printer = printer_of(printer)
    if design not in DESIGNS:
        raise ConfigError(
            "--design", wanted=say("usage-one-of", ", ".join(DESIGNS)), came=repr(design), todo=say("correct-name")
        )
    if design == "layer":
        if part is None:
            raise InputError(
                "--design layer", wanted=say("part"), came=say("none"), todo=say("terminal-name-part-gcode")
            )
        return layer_plan(printer, longest_layer_mm(part), marks=marks)
    if design == "fixed":
        return walk(printer, lay_out(printer, *_area_mm(printer, size_mm, part, glass_mm), marks=marks))
    belief = prior_belief(printer) if after is None else belief_after(printer, after)
    area = _area_mm(printer, size_mm, None, glass_mm)
    wanted = belief.wanted(targets_mm(printer, part))
    worth = information if design == "active" else fall_of(wanted)
    # The fixed patterns compete, too: with few marks their evenness is hard to beat.
    drawn = [area] if part is None else [area, _area_mm(printer, size_mm, part, glass_mm)]
    plans = [walk(printer, lay_out(printer, *corners, marks=marks)) for corners in drawn]
    plans += chosen_plans(printer, area, belief, worth, marks=marks)
    known = [belief.told(belief.columns(plan.waypoints_mm, plan.rows)) for plan in plans]
    scores = [still_unknown(one) if design == "active" else one.expected_mm(wanted) for one in known]
    return plans[int(np.argmin(scores))]


def expected_error_mm(
    printer: Printer, plan: ProbePlan, *, part: Program | None = None, after: Trace | None = None
) -> float:
    """Return the expected RMS error of a part after measuring the marks; without a part, of the whole bed."""
    belief = prior_belief(printer) if after is None else belief_after(printer, after)
    wanted = belief.wanted(targets_mm(printer, part))
    return belief.told(belief.columns(plan.waypoints_mm, plan.rows)).expected_mm(wanted)


def targets_mm(printer: Printer, part: Program | None) -> np.ndarray:
    """Return way-points [N, 2] where the printer must be right: on the part's moves, or all over the bed."""
    if part is None:
        low, high = mark_area_mm(printer)
        return low + np.random.default_rng(0).random((TARGETS, 2)) * (high - low)
    ends = _printed_mm(part).reshape(2, -1, 2)
    ends = ends[:, :: max(1, ends.shape[1] // TARGETS)]
    # predict long lines along their length, not only at their ends
    share = np.linspace(0.0, 1.0, 5)[:, None, None]
    return np.swapaxes(ends[0] + share * (ends[1] - ends[0]), 0, 1).reshape(-1, 2)


def _area_mm(
    printer: Printer, size_mm: float | None, part: Program | None, glass_mm: tuple[float, float] | None
) -> tuple[np.ndarray, np.ndarray]:
    if part is not None:
        low, high = area_around_mm(printer, _printed_mm(part))
    else:
        low, high = mark_area_mm(printer) if size_mm is None else square_mm(printer, size_mm)
    if glass_mm is None:
        return low, high
    seen_low, seen_high = glass_area_mm(printer, glass_mm)
    size = np.minimum(high - low, seen_high - seen_low)
    return (low + high - size) / 2, (low + high + size) / 2


def _printed_mm(part: Program) -> np.ndarray:
    """Return the ends [N, 2] of the moves that print the part."""
    rows = part.moves.extruding & part.moves.known[:, :2].all(axis=1)
    if not rows.any():
        raise GcodeError(part.name, wanted=say("part-printed"), came=say("no-extruding-move"), todo=say("check-file"))
    return np.vstack([part.moves.start_mm[rows, :2], part.moves.end_mm[rows, :2]])


def phase_size_mm(printer: Printer) -> float:
    """Return the side of the square that shows one turn of both motors, limited by the bed."""
    low, high = mark_area_mm(printer)
    return float(min(PHASE_TURNS * max(printer.mm_per_turn), (high - low).max()))


def turns_covered(printer: Printer, plan: ProbePlan) -> tuple[float, float]:
    """Return how many turns of each motor the marks span. Below one turn a pulley cannot be learned well."""
    spans = np.ptp(printer.to_motor(plan.marks_mm), axis=0)
    return float(spans[0] / printer.x.mm_per_turn), float(spans[1] / printer.y.mm_per_turn)


def write_probe(
    path: str | Path, plan: ProbePlan, *, extruder: Extruder = "bowden", start_gcode: str = "",
    papers: Sequence[Paper] = (), pause_gcode: str = PAUSE,
) -> Path:  # fmt: skip
    """Write the G-code to ``path`` and the plan beside it; return the plan's path. The options are `probe_gcode`'s.

    ``papers`` are the sheets of a plan `on_paper`. A plan `with_pen` becomes a drawing, which waits by
    ``pause_gcode``. Each of several sheets has its own file (`gcode_of`).
    """
    path = Path(path)
    plan_path = path.with_suffix(".json")
    with ExitStack() as files:
        for number, sheet in enumerate(plan.sheets, start=1):
            said = f"sheet {number} of {len(plan.sheets)}" if len(plan.sheets) > 1 else ""
            file = files.enter_context(replacing(gcode_of(path, plan)[number - 1], "wb"))
            paper = papers[number - 1] if papers else None
            if sheet.pen:
                text = pen_gcode(sheet, paper, sheet=said, pause_gcode=pause_gcode)
            else:
                text = probe_gcode(sheet, extruder=extruder, start_gcode=start_gcode, paper=paper, sheet=said)
            file.write(sealed_test_print(text.encode("utf-8", "replace")))
            file.flush()  # a full disk fails here, before the plan is written: both files or neither
        write_plan(plan_path, plan)
    return plan_path


def gcode_of(path: Path, plan: ProbePlan) -> list[Path]:
    """Return the files of a plan: ``path``, or for several sheets one file each, such as probe-1.gcode."""
    if len(plan.sheets) == 1:
        return [path]
    return [path.with_name(f"{path.stem}-{number}{path.suffix}") for number in range(1, len(plan.sheets) + 1)]


def keep_plan(path: Path, plan: ProbePlan) -> None:
    """Raise `InputError` if ``path`` holds another plan: it may belong to the plate on the bed."""
    todo = say("write-again-printmend-probe")
    if path.exists() and read_text(path, wanted=say("probe-json"), todo=todo) != plan_text(plan):
        raise InputError(
            path, wanted=say("name-free"), came=say("plan-another-test-print-measure-may"),
            todo=say("choose-another-say-overwrite"),
        )  # fmt: skip
