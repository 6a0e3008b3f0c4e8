"""`printmend measure`: turn scans of the probe into a trace, or calliper readings if there is no scanner."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from printmend.cli.terminal import Finite, echo, spoken
from printmend.files import all_or_none
from printmend.messages import say, say_count

if TYPE_CHECKING:
    import numpy as np

    from printmend.measure.callipers import Distances
    from printmend.printer import Printer

MOST_NAMED = 40  # most missing marks that are named one by one


# Its many parameters are its options.
@click.command(
    epilog="Examples: printmend measure scan.png turned.png --probe probe.json -o trace.csv --overlay seen.png; "
    "printmend measure --callipers --probe probe.json --overlay map.png --printer ender3 -o printer.mend.json"
)
@click.argument("scans", nargs=-1, type=click.Path(path_type=Path), metavar="SCAN...")
@click.option("--probe", "plan_path", type=click.Path(path_type=Path), help="The plan that `probe` wrote.")
@click.option("--gcode", "part_path", metavar="PART.gcode", type=click.Path(path_type=Path),
              help="SCAN shows a layer of this file, not a probe. Needs --printer.")  # fmt: skip
@click.option("--layer", type=click.IntRange(min=1), default=1, show_default=True,
              help="With --gcode: the layer that SCAN shows; 1 is the underside.")  # fmt: skip
@click.option("--dpi", type=Finite(min=50, max=9600), help="Resolution [default: what the file says, or 600]")
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="[default: trace.csv]")
@click.option(
    "--overlay", type=click.Path(path_type=Path, dir_okay=False), help="Draw what was found over the first scan."
)
@click.option("--distance", "distances_mm", metavar="MM", type=Finite(min=1, max=1000), multiple=True,
              help="Calliper reading of the distance that `measure` names, for the scale. With --gcode up to two.",
              )  # fmt: skip
@click.option("--scanner-error", "scanner_percent", metavar="PERCENT", type=Finite(min=0.005, max=2),
              help="RMS error of lengths in your scanner's scans, if you know it [default: 0.13]",
              )  # fmt: skip
@click.option("--callipers", is_flag=True,
              help="Without a scan: ask for a few distances. SCAN may be a list of them, one a line; </dev/null shows "
              "which.")  # fmt: skip
@click.option("--printer", "printer_name", metavar="NAME|FILE.toml",
              help="With --gcode: the printer. With --callipers: learn a model of it.")  # fmt: skip
@click.option("--filament", metavar="NAME", help="With --gcode: the filament of the part, as pla-black.")
@all_or_none()
def command(
    scans: tuple[Path, ...], plan_path: Path | None, part_path: Path | None, layer: int, dpi: float | None,
    output: Path | None, overlay: Path | None, distances_mm: tuple[float, ...],
    scanner_percent: float | None, callipers: bool, printer_name: str | None, filament: str | None,
) -> None:  # fmt: skip
    """Find the dots of the printed probe in SCANs, or the walls of any printed layer, and write where they are.

    A second scan of the same plate, turned by a quarter, removes the errors of the scanner's axes, and one distance by
    callipers (--distance) that of its scale. A photo needs the reference sheet (`printmend probe --sheet sheet.pdf`)
    around the print or under it.

    With --gcode, SCAN shows the underside of any part, or its first layer printed alone (`printmend probe
    --first-layer`): its outlines are matched with the path that the file commands. A photo of it on the reference sheet
    serves as well.
    """
    from printmend.cli.terminal import spare
    from printmend.extras import require
    from printmend.filament import check_name

    if not callipers or overlay is not None:
        require("printmend measure", "cv2", "PIL", "scipy")
    output = output or Path("printer.mend.json" if callipers else "trace.csv")
    spare((output, overlay), (plan_path, part_path, *scans))
    if filament is not None and part_path is None:
        raise click.UsageError(say("terminal-usage-filament"))
    if filament is not None:
        check_name(filament)
    if scanner_percent is not None and (part_path is not None or callipers):
        raise click.UsageError(say("terminal-usage-scanner-error"))
    if part_path is not None:
        _measure_layer(scans, part_path, layer, printer_name, dpi, overlay, output, distances_mm, filament)
        return
    if plan_path is None:
        raise click.UsageError(say("terminal-usage-what-printed"))
    if callipers:
        _measure_by_hand(scans, plan_path, overlay, printer_name, output)
        return
    error = None if scanner_percent is None else scanner_percent / 100
    _measure_probe(scans, plan_path, dpi, overlay, output, distances_mm, error)


def _measure_probe(
    scans: tuple[Path, ...], plan_path: Path, dpi: float | None, overlay: Path | None, output: Path,
    distances_mm: tuple[float, ...], scanner_error: float | None,
) -> None:  # fmt: skip
    import numpy as np

    from printmend.measure import read_plan, write_trace
    from printmend.measure.measurement import measure_scans

    plan = read_plan(plan_path)
    if not scans:
        raise click.UsageError(say("terminal-usage-scan"))
    if len(distances_mm) > 1:
        raise click.UsageError(say("terminal-usage-one-distance"))
    distance_mm = distances_mm[0] if distances_mm else None
    measurement = measure_scans(
        scans, plan, dpi=dpi, overlay=overlay, distance_mm=distance_mm, scanner_error=scanner_error, tell=spoken
    )
    write_trace(output, measurement.trace)
    asked = _told(measurement.notes)
    if 0 < len(missing := measurement.missing) <= MOST_NAMED:
        echo(say("marks-not-found", ", ".join(map(str, missing.tolist())), plan_path))
    found = int(np.isfinite(measurement.measured_mm).all(axis=1).sum())
    echo(say_count("so-many-measured-marks", found, output))
    for note in asked:
        echo(note)
    if asked and len(plan.sheets) < 2:  # the overlay shows the first scan's sheet only
        echo(say("both-ringed-in", overlay) if overlay else say("terminal-see-both-ringed"))


def _measure_layer(
    scans: tuple[Path, ...], part_path: Path, layer: int, printer_name: str | None, dpi: float | None,
    overlay: Path | None, output: Path, distances_mm: tuple[float, ...], filament: str | None,
) -> None:  # fmt: skip
    from printmend.measure import write_trace
    from printmend.mend.fit import fits
    from printmend.mend.part import measure_part
    from printmend.printer import read_printer

    if printer_name is None or len(scans) != 1:
        raise click.UsageError(say("terminal-usage-gcode"))
    printer = read_printer(printer_name)
    measured = measure_part(
        scans[0], part_path, printer, layer=layer, dpi=dpi, overlay=overlay, distances_mm=distances_mm, tell=spoken
    )
    write_trace(output, measured.trace)
    asked = _told(measured.notes)
    echo(say_count("terminal-so-many-measured-places", measured.found, output))
    for line in fits([(layer, measured)], part_path, printer, None, filament).sizes():
        echo(line)
    for note in asked:
        echo(note)


def _told(notes: Sequence[str]) -> list[str]:
    """Print a measurement's notes; return those that ask for something, to be printed last, where they are noticed."""
    from printmend.measure.distance import is_asking

    for note in notes:
        if not is_asking(note):
            echo(note)
    return [say("still-open", note) for note in notes if is_asking(note)]


def _measure_by_hand(
    files: tuple[Path, ...], plan_path: Path, overlay: Path | None, printer_name: str | None, output: Path
) -> None:
    from printmend.cli.calliper_talk import draw_map, talk
    from printmend.infer.distances import choose_distances
    from printmend.measure import read_plan
    from printmend.measure.callipers import describe, parse_readings, read_readings
    from printmend.measure.checks import check_origin
    from printmend.printer import read_printer

    plan = read_plan(plan_path)
    printer = None if printer_name is None else read_printer(printer_name)
    if printer is not None:
        check_origin(plan_path, plan.origin, printer)
    if not files and sys.stdin.isatty():
        distances, readings = talk(plan, lambda question: input(spoken(question)), echo, picture=overlay)
        if not len(readings):
            return
        _say_estimates(distances, readings, printer, output)
        return
    distances = choose_distances(plan)
    if overlay is not None:
        draw_map(overlay, distances, spoken)
    for line in describe(distances):
        echo(line, err=True)
    if files:
        readings = read_readings(files[0], distances)
    else:
        echo(say("terminal-outer-edges"), err=True)
        text = sys.stdin.read()
        if not text.strip():
            return
        readings = parse_readings(text, distances, subject=say("distances"))
    _say_estimates(distances, readings, printer, output)


def _say_estimates(distances: "Distances", readings_mm: "np.ndarray", printer: "Printer | None", output: Path) -> None:
    """Print the estimates from a measurement by hand, and save the resulting model."""
    from printmend.learn.by_hand import model_by_hand, said_by_hand
    from printmend.model import write_model

    if printer is None:
        for line in said_by_hand(distances, readings_mm):
            echo(line)
        return
    model = model_by_hand(distances, readings_mm, printer)
    for line in model.findings:
        echo(line)
    write_model(output, model)
    echo(say("only-known-corrected", output))
