"""`printmend probe`: write the test print that learning needs, its plan, and the reference sheet."""

import re
import shlex
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from printmend.cli.terminal import Finite, echo, language
from printmend.files import all_or_none
from printmend.messages import say, together
from printmend.units import A4_MM, LETTER_MM

if TYPE_CHECKING:
    from printmend.measure import ProbePlan
    from printmend.printer import Extruder, Printer


SHEETS_MM = {"a4": A4_MM, "letter": LETTER_MM}


class Glass(click.ParamType):
    """A sheet of paper or a scanner's glass: a name, or width × height in mm."""

    name = "glass"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        """Return width and height [mm]."""
        if isinstance(value, tuple):
            return value
        if (known := SHEETS_MM.get(value.lower())) is not None:
            return known
        if (found := re.fullmatch(r"(\d+(?:\.\d+)?)[x×](\d+(?:\.\d+)?)", value.lower())) is None:
            self.fail(say("usage-glass"), param, ctx)
        return float(found[1]), float(found[2])


# Long, with many parameters, because of its options, and because it explains each file that it writes.
@click.command(epilog="Example: printmend probe --printer ender3 -o probe.gcode")
@click.option("--printer", "printer_name", metavar="NAME|FILE.toml", help="A preset or your own printer.")
@click.option("--size", "size_mm", type=Finite(min=30), help="Side of the square of dots in mm [default: the bed]")
@click.option(
    "--for", "part_path", type=click.Path(path_type=Path), metavar="PART.gcode", help="Choose the dots for this part."
)
@click.option("--design", type=click.Choice(["fixed", "layer", "optimal", "active"]), default="fixed",
              show_default=True, help="How to choose the dots (see above).")  # fmt: skip
@click.option("--after", type=click.Path(path_type=Path), metavar="TRACE.csv", help="Measurement of a first print, "
              "for optimal and active.")  # fmt: skip
@click.option("--phase", is_flag=True, help="Two-minute print after work on the belts of a known printer, "
              "for `learn --phase`.")  # fmt: skip
@click.option(
    "--dots", "marks", type=click.IntRange(16, 1000), default=600, show_default=True, help="Largest number of dots."
)
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, dir_okay=False), default=Path("probe.gcode"), show_default=True
)
@click.option("--extruder", type=click.Choice(["bowden", "direct"]), help="Place of the filament's motor: sets the "
              "retraction between dots [default: as the printer says]")  # fmt: skip
@click.option("--start-from", "start_path", type=click.Path(path_type=Path), metavar="PART.gcode",
              help="Copy the start of this sliced file: temperatures, homing, levelling, purge line.")  # fmt: skip
@click.option("--on", "surface", type=click.Choice(["plate", "paper"]), default="plate", show_default=True,
              help="paper: print on a sheet taped to the bed, which lies flat on any scanner.")  # fmt: skip
@click.option("--pen", is_flag=True, help="Draw with a pen in a clip on the tool head, cold, on paper.")
@click.option("--scanner", "glass", type=Glass(), metavar="a4|letter|WxH",
              help="Keep the dots within this glass [on paper: a4].")  # fmt: skip
@click.option("--sheets", type=click.IntRange(1, 3), default=1, show_default=True,
              help="With --on paper or --pen: number of sheets, one after the other, for a large bed.")  # fmt: skip
@click.option("--net", is_flag=True, help="On the plate: join larger dots by a thin net that comes off as one sheet.")
@click.option("--first-layer", "layer_path", type=click.Path(path_type=Path), metavar="PART.gcode",
              help="Instead: write the first layer of this part alone, for `measure --gcode`.")  # fmt: skip
@click.option("--overwrite", is_flag=True, help="Replace the plan of another test print.")
@click.option("--sheet", type=click.Path(path_type=Path, dir_okay=False), metavar="SHEET.pdf",
              help="Also write the A4 reference sheet, for photos or to check a scanner's scale.")  # fmt: skip
@all_or_none()
def command(
    printer_name: str | None, size_mm: float | None, part_path: Path | None, design: str, after: Path | None,
    marks: int, output: Path, extruder: "Extruder | None", start_path: Path | None,
    surface: str, pen: bool, glass: tuple[float, float] | None, sheets: int, net: bool, layer_path: Path | None,
    phase: bool, overwrite: bool, sheet: Path | None,
) -> None:  # fmt: skip
    """Write a test print that shows every fault. Beside it go its plan (probe.json), which `measure` needs, and a page
    that says what to do (probe-how-to.pdf).

    Designs: fixed fills an area evenly, along both diagonals. layer follows the longest layer of the part, in the air,
    with dots beside its path. optimal chooses the dots that make the part's expected error smallest, active those
    that teach most. Without --for both consider the whole bed. All are measured in the same way.
    """
    if layer_path is not None:
        if pen or net or sheets > 1:
            raise click.UsageError(say("terminal-usage-first-layer"))
        _write_first_layer(layer_path, output, printer_name)
        return
    import numpy as np

    from printmend.cli.terminal import spare
    from printmend.extras import require
    from printmend.gcode.read import read_gcode
    from printmend.measure.table import read_trace
    from printmend.printer import read_printer
    from printmend.probe import (
        PHASE_MARKS,
        cost,
        design_probe,
        expected_error_mm,
        phase_size_mm,
        turns_covered,
        write_probe,
    )
    from printmend.probe.gcode import homed_start, start_from
    from printmend.probe.layout import with_moving, with_net
    from printmend.probe.leaflet import PAPER_COLOURS, PLATE_COLOURS, leaflet_of, pen_and_paper, weight, write_leaflet
    from printmend.probe.paper import design_sheets, on_paper, paper_for, papers_of
    from printmend.probe.pen import with_pen
    from printmend.probe.probe import gcode_of, keep_plan

    if printer_name is None and sheet is None:
        raise click.UsageError(say("terminal-usage-probe-printer"))
    papered = pen or surface == "paper"
    if net and papered:
        raise click.UsageError(say("terminal-usage-net"))
    if sheets > 1 and not papered:
        raise click.UsageError(say("terminal-usage-sheets"))
    if sheets > 1 and (size_mm is not None or part_path is not None or design != "fixed"):
        raise click.UsageError(say("terminal-usage-sheets-alone"))
    if phase:
        if size_mm is not None or part_path is not None or design != "fixed" or sheets > 1:
            raise click.UsageError(say("terminal-usage-phase-alone"))
        marks = PHASE_MARKS
    if sheet is not None:
        require("printmend probe --sheet", "cv2", "PIL", "scipy")
    made = () if printer_name is None else (output, output.with_suffix(".json"), leaflet_of(output))
    spare((*made, sheet), (part_path, after, start_path, Path(printer_name or "-")))
    if sheet is not None:
        from printmend.measure.fiducials import window_mm
        from printmend.probe.tags import write_sheet

        write_sheet(sheet, language=language())
        echo(say("print-at-full-size", sheet))
    if printer_name is None:
        return
    printer = read_printer(printer_name)
    size_mm = phase_size_mm(printer) if phase else size_mm
    part = read_gcode(part_path, printer=printer) if part_path else None
    trace = read_trace(after, printer=printer) if after else None
    if papered:
        glass = paper_for(glass or A4_MM)
    if sheets > 1 and glass is not None:
        plan = design_sheets(printer, glass, sheets, marks=marks)
    else:
        plan = design_probe(
            printer, design=design, size_mm=size_mm, part=part, after=trace, marks=marks, glass_mm=glass
        )
    if net:
        plan = with_net(plan, printer)
    papers = papers_of(plan, printer, glass) if papered and glass is not None else ()
    if papers:
        plan = on_paper(plan, printer, papers)
    if pen:
        plan = with_pen(plan)
    elif not net and not phase:
        plan = with_moving(plan, printer)
    files = gcode_of(output, plan)
    spare((*files, *made[1:], sheet), (part_path, after, start_path, Path(printer_name)))
    if not overwrite:
        keep_plan(output.with_suffix(".json"), plan)
    start = printer.start_gcode and homed_start(printer.start_gcode, subject=f"start_gcode of {printer_name}")
    if start_path is not None:
        start, left_out = start_from(start_path, printer)
        if left_out:
            echo(together("\n  ", (say("not-copied-from", start_path), *left_out)), err=True)
    error_mm = None if phase else expected_error_mm(printer, plan, part=part, after=trace)
    plan_path = write_probe(
        output, plan, extruder=extruder or printer.extruder, start_gcode=start, papers=papers,
        pause_gcode=printer.pause_gcode,
    )  # fmt: skip
    minutes, grams = cost(plan)
    used = pen_and_paper(plan) if pen else say("filament-used", weight(grams))
    echo(say("probe-written", together(", ", map(str, files)), len(plan), f"{minutes:.0f}", used))
    for number, (paper, file) in enumerate(zip(papers, files, strict=False), start=1):
        which = say("sheet-number", number) if sheets > 1 else say("the-sheet")
        echo(say("print-on-sheet", which, paper.name, paper.place, file.name))
    is_usual = sheets == 1 and size_mm is None and part is None and design == "fixed"
    if papered and is_usual and (unseen := _unseen(printer, plan)):
        echo(unseen)
    if error_mm is None:
        echo(say("terminal-next-phase", plan_path))
        return
    echo(say("expected-after-part" if part else "expected-after", f"{error_mm:.3f}"))
    echo(say("terminal-keep-plan", plan_path))
    page = write_leaflet(output, plan, printer, printer_name, papers=papers, language=language())
    echo(say("probe-page", page))
    if not pen:
        echo(say(PAPER_COLOURS if surface == "paper" else PLATE_COLOURS))
    if sheet is not None and (np.ptp(plan.marks_mm, axis=0) > window_mm()).any():
        echo(say("terminal-window-too-small", f"{window_mm().min():.0f}"), err=True)
    for motor, turns in zip(printer.motors, turns_covered(printer, plan), strict=True):
        if turns < 1:
            echo(say("marks-span-too-little", f"{turns:.1f}", motor.upper()), err=True)


def _unseen(printer: "Printer", plan: "ProbePlan") -> str:
    """Say where the bed is larger than the sheet, and how to cover all of it."""
    import numpy as np

    from printmend.probe.layout import mark_area_mm

    low, high = mark_area_mm(printer)
    marked = np.ptp(plan.marks_mm, axis=0)
    if (marked > high - low - plan.pitch_mm).all():
        return ""
    whole = high - low
    return say("terminal-sheet-shows-part", *(f"{each:.0f}" for each in (*marked, *whole)))


def _write_first_layer(part: Path, output: Path, printer_name: str | None) -> None:
    from printmend.cli.terminal import spare
    from printmend.files import replacing
    from printmend.gcode.read import read_gcode
    from printmend.mend.mend import refuse_beyond_bed
    from printmend.printer import read_printer
    from printmend.probe.leaflet import leaflet_of, write_layer_leaflet
    from printmend.probe.part_layer import STANDS_IN, first_layer

    spare((output, leaflet_of(output)), (part,))
    printer = None if printer_name is None else read_printer(printer_name)
    program = read_gcode(part, printer=printer)
    text = first_layer(program)
    if printer is not None:
        ends_mm = program.moves.end_mm[program.moves.extruding, :2]
        refuse_beyond_bed(
            program.name, printer, ends_mm.min(axis=0), ends_mm.max(axis=0), say("terminal-name-printer-or-move")
        )
    walls = None
    if find_spec("cv2") is not None:  # otherwise problems only show when it is measured
        from printmend.measure.walls import read_walls

        walls = read_walls(program, printer or read_printer(STANDS_IN))
    with replacing(output, "wb") as file:
        file.write(text)
    page = write_layer_leaflet(output, program, printer, printer_name, walls, language=language())
    echo(say("first-layer-written", output, part.name))
    click.echo(
        f"printmend measure scan.png --gcode {output} --printer {shlex.quote(printer_name or 'YOURS')} -o trace.csv"
    )
    if printer_name is None:
        echo(say("terminal-yours-is"))
    echo(say("layer-page", page))
