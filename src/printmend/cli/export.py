"""`printmend export`: write the part of a learned fault that a firmware can correct."""

from pathlib import Path

import click

from printmend.cli.model import ModelType
from printmend.cli.terminal import echo
from printmend.files import all_or_none
from printmend.messages import say


@click.command(epilog="Example: printmend export -m printer.mend.json --to marlin")
@click.option(
    "-m", "--model", "model_path", required=True, metavar="NAME|printer.mend.json", type=ModelType(),
    help="What `printmend learn` wrote about this printer.",
)  # fmt: skip
@click.option("--to", "firmware", required=True, type=click.Choice(["klipper", "marlin", "rrf", "linuxcnc"]),
              help="The printer's firmware.")  # fmt: skip
@click.option(
    "-o", "--output", "folder", type=click.Path(path_type=Path, file_okay=False),
    help="Write the files into this folder instead of printing them.",
)  # fmt: skip
@all_or_none()
def command(model_path: Path, firmware: str, folder: Path | None) -> None:
    """Write the firmware settings that correct part of the faults, and say what remains for `printmend mend`.

    A setting whose gain is smaller than its uncertainty is left out; if none is left, nothing is written (exit code 3).
    Nothing is stored in the firmware: the files say how to undo their settings.
    """
    from printmend.export.firmware import remainder
    from printmend.export.supported import export_supported
    from printmend.files import replacing
    from printmend.model import read_model

    model = read_model(model_path)
    export = export_supported(model, firmware)
    for name, text in export.files:
        if folder is None:
            click.echo(f"; {name}\n{text}" if len(export.files) > 1 else text, nl=False)
            continue
        folder.mkdir(parents=True, exist_ok=True)
        with replacing(folder / name) as file:
            file.write(text)
        echo(say("written", folder / name), err=True)
    echo(remainder(export), err=True)
