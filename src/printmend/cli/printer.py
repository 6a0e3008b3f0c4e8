"""`printmend printer`: print a printer's TOML: a preset's, or the user's own from printer.cfg or a slicer's profile."""

from pathlib import Path

import click

from printmend.cli.terminal import echo
from printmend.messages import say


@click.command(epilog="Example: printmend printer ~/printer_data/config/printer.cfg > mine.toml")
@click.argument("source", metavar="NAME|FILE", required=False)
@click.option("--like", metavar="NAME", help="The preset whose motors and end stops a slicer's profile gets.")
@click.option("--model", metavar="NAME", help="Which printer of a bundle with several: its name, or a part of it.")
def command(source: str | None, like: str | None, model: str | None) -> None:
    """Print a printer as TOML: change what differs on your machine, and pass the file as --printer.

    NAME is a preset; without any, all presets are listed. FILE is Klipper's printer.cfg, or a printer's profile as
    PrusaSlicer or SuperSlicer (.ini) and OrcaSlicer or Bambu Studio (.json) export it, or a bundle of several (.ini).
    """
    from printmend.printer import preset_names, read_printer
    from printmend.printer.convert import convert, printer_text
    from printmend.printer.toml import preset_of, preset_text

    if source is None:
        for name in preset_names():
            printer = read_printer(name)
            bed = say("mm", f"{printer.x.length_mm:g}", f"{printer.y.length_mm:g}")
            click.echo(f"{name:<15}{printer.name:<26}{printer.kinematics:<11}{bed}")
        return
    if (preset := preset_of(source)) is not None:
        click.echo(preset_text(preset), nl=False)
        return
    printer, left = convert(Path(source), like=like, model=model)
    click.echo(printer_text(printer), nl=False)
    for line in left:
        echo(say("terminal-not-taken-over", line), err=True)
