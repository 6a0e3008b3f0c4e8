"""`printmend check`: predict, write nothing."""

from pathlib import Path

import click

from printmend.cli.model import ModelType, read_model_in
from printmend.cli.terminal import echo


@click.command(epilog="Example: printmend check part.gcode -m printer.mend.json --against part.mended.gcode")
@click.argument("source", metavar="PART.gcode", type=click.Path(path_type=Path, dir_okay=False, allow_dash=True))
@click.option(
    "-m", "--model", "model_path", required=True, metavar="NAME|printer.mend.json", type=ModelType(),
    help="What `printmend learn` wrote about this printer.",
)  # fmt: skip
@click.option("--filament", metavar="NAME",
              help="Also correct the shrinkage of this filament [default: left to the slicer].")  # fmt: skip
@click.option("--against", metavar="out.gcode", type=click.Path(path_type=Path, dir_okay=False),
              help="Judge this file, made from PART.gcode, instead of what mending would write.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="For programs.")
def command(source: Path, model_path: Path, filament: str | None, against: Path | None, as_json: bool) -> None:
    """Predict how far PART.gcode will be off on this printer, as it is and mended. Writes nothing."""
    import json

    from printmend.cli.terminal import file_progress
    from printmend.mend import check_gcode

    model = read_model_in(model_path, filament)
    with file_progress(source) as tick:
        prediction = check_gcode(source, model, progress=tick)
    if against is not None:
        from printmend.mend.against import checked_against

        prediction = checked_against(prediction, str(source), str(against), model)
    echo(json.dumps(prediction.json()) if as_json else prediction.summary())
