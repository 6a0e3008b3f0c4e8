"""`printmend probe`: the test print that learning needs, and its plan."""

from pathlib import Path

import click


@click.command(epilog="Example: printmend probe --printer ender3 -o probe.gcode")
@click.option(
    "--printer", "printer_name", required=True, metavar="NAME|FILE.toml", help="A preset or your own printer."
)
@click.option(
    "--size", "size_mm", type=click.FloatRange(min=30), help="Side of the square of marks in mm; default the whole bed."
)
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, dir_okay=False), default=Path("probe.gcode"), show_default=True
)
def command(printer_name: str, size_mm: float | None, output: Path) -> None:
    """Write a test print that shows every fault, and its plan (probe.json beside it), which `measure` needs."""
    from printmend.printer import read_printer
    from printmend.probe import cost, design_probe, turns_covered, write_probe

    printer = read_printer(printer_name)
    plan = design_probe(printer, size_mm=size_mm)
    plan_path = write_probe(output, plan)
    minutes, grams = cost(plan)
    click.echo(
        f"{output}: {len(plan)} marks, {len(plan.waypoints_mm)} way-points, {minutes:.0f} min, {grams:.1f} g of PLA"
    )
    click.echo(f"{plan_path}: the plan; keep it for `printmend measure`")
    for motor, turns in zip(printer.motors, turns_covered(printer, plan), strict=True):
        if turns < 1:
            click.echo(
                f"The marks span {turns:.1f} turns of motor {motor.upper()}: one is needed to know its pulley.",
                err=True,
            )
