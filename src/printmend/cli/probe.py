"""`printmend probe`: the test print that learning needs, its plan, and the reference sheet."""

from pathlib import Path

import click


@click.command(epilog="Example: printmend probe --printer ender3 -o probe.gcode")
@click.option("--printer", "printer_name", metavar="NAME|FILE.toml", help="A preset or your own printer.")
@click.option(
    "--size", "size_mm", type=click.FloatRange(min=30), help="Side of the square of marks in mm [default: the bed]"
)
@click.option(
    "--for", "part_path", type=click.Path(path_type=Path), metavar="PART.gcode", help="Cover what this part needs."
)
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, dir_okay=False), default=Path("probe.gcode"), show_default=True
)
@click.option("--sheet", type=click.Path(path_type=Path, dir_okay=False), metavar="SHEET.pdf",
              help="Also write the A4 reference sheet, for photos or to check a scanner's scale.")  # fmt: skip
def command(
    printer_name: str | None, size_mm: float | None, part_path: Path | None, output: Path, sheet: Path | None
) -> None:
    """Write a test print that shows every fault, and its plan (probe.json beside it), which `measure` needs."""
    from printmend.gcode.read import read_gcode
    from printmend.measure.sheet import write_sheet
    from printmend.printer import read_printer
    from printmend.probe import cost, design_probe, turns_covered, write_probe

    if printer_name is None and sheet is None:
        raise click.UsageError("--printer says which bed the test print is for")
    if sheet is not None:
        write_sheet(sheet)
        click.echo(f"{sheet}: print it at 100 %")
    if printer_name is None:
        return
    printer = read_printer(printer_name)
    part = read_gcode(part_path, printer=printer) if part_path else None
    plan = design_probe(printer, size_mm=size_mm, part=part)
    plan_path = write_probe(output, plan)
    minutes, grams = cost(plan)
    click.echo(
        f"{output}: {len(plan)} marks, {len(plan.waypoints_mm)} way-points, {minutes:.0f} min, {grams:.1f} g of PLA"
    )
    click.echo(f"{plan_path}: the plan; keep it for `printmend measure`")
    for motor, turns in zip(printer.motors, turns_covered(printer, plan), strict=True):
        if turns < 1:
            click.echo(f"The marks span {turns:.1f} turns of motor {motor.upper()}: its pulley needs one.", err=True)
