"""`printmend printer`: a preset's TOML text on stdout."""

import click

from printmend.printer.toml import preset_names, preset_text


@click.command(epilog="Example: printmend printer ender3 > mine.toml")
@click.argument("name", type=click.Choice(preset_names()))
def command(name: str) -> None:
    """Print the printer preset NAME as TOML: change what differs on your machine, pass the file as --printer."""
    click.echo(preset_text(name), nl=False)
