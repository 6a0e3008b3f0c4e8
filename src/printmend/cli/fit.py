"""`printmend fit`: check whether a printed part fits, and find the slicer settings that correct it."""

import json
from pathlib import Path

import click

from printmend.cli.model import ModelType
from printmend.cli.terminal import Finite, echo, spoken
from printmend.files import all_or_none
from printmend.messages import is_one_of, say


# Its many parameters are its options.
@click.command(
    epilog="Example: printmend fit underside.png --gcode part.gcode --printer ender3 --filament pla-black --out fit"
)
@click.argument("scan", metavar="SCAN", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--gcode", "part_path", required=True, metavar="PART.gcode",
              type=click.Path(path_type=Path, dir_okay=False), help="The file that was printed.")  # fmt: skip
@click.option("--printer", "printer_name", metavar="NAME|FILE.toml", help="The printer, or give --model.")
@click.option("-m", "--model", "model_path", metavar="NAME|printer.mend.json", type=ModelType(),
              help="Model of the printer that `learn` wrote: removes the machine's own errors.")  # fmt: skip
@click.option("--filament", metavar="NAME", help="The filament, as pla-black.")
@click.option(
    "--top", metavar="SCAN", type=click.Path(path_type=Path, dir_okay=False),
    help="Scan of the top of a part at least 8 mm high: separates elephant's foot from wide lines.",
)  # fmt: skip
@click.option("--layer", type=click.IntRange(min=1), default=1, show_default=True,
              help="Which layer SCAN shows; 1 is the underside.")  # fmt: skip
@click.option("--dpi", type=Finite(min=50, max=9600), help="Resolution [default: what the file says, or 600]")
@click.option("--distance", "distances_mm", metavar="MM", type=Finite(min=1, max=1000), multiple=True,
              help="Calliper reading of the widths that `fit` names; settles the scale.")  # fmt: skip
@click.option("--overlay", type=click.Path(path_type=Path, dir_okay=False), help="Draw what was found over the scan.")
@click.option("--out", "folder", metavar="DIR", type=click.Path(path_type=Path, file_okay=False),
              help="Write the profile to import, and all numbers as fit.json.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="All numbers as JSON.")
@all_or_none()
def command(
    scan: Path, part_path: Path, printer_name: str | None, model_path: Path | None, filament: str | None,
    top: Path | None, layer: int, dpi: float | None, distances_mm: tuple[float, ...], overlay: Path | None,
    folder: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Say how large a printed part came out, hole by hole, and what to type into its slicer so that it fits.

    SCAN shows the part's underside, as for `measure --gcode`. The slicer corrects line width, holes and shrinkage;
    mending corrects the machine.
    """
    from printmend.cli.terminal import spare
    from printmend.extras import require
    from printmend.filament import check_name
    from printmend.fit import write_profiles
    from printmend.fit.setting import how_to_import
    from printmend.measure.distance import is_asking
    from printmend.mend.fit import LOW, fits, measured_part
    from printmend.mend.update import same_machine
    from printmend.model import read_model
    from printmend.printer import read_printer

    if printer_name is None and model_path is None:
        raise click.UsageError(say("terminal-usage-fit"))
    require("printmend fit", "cv2", "PIL", "scipy")
    spare((overlay,), (scan, part_path, top))
    model = None if model_path is None else read_model(model_path)
    printer = model.printer if printer_name is None and model is not None else read_printer(printer_name or "")
    if model is not None:
        same_machine(model, printer)
    if filament is not None:
        check_name(filament)
    measured = measured_part(
        scan, part_path, printer, layer=layer, top=top, dpi=dpi, distances_mm=distances_mm, overlay=overlay, tell=spoken
    )
    found = fits(measured, part_path, printer, model, filament)
    if as_json:
        click.echo(json.dumps(found.json(), ensure_ascii=False))
    else:
        for line in found.words():
            echo(line)
        for note in found.notes:
            if is_asking(note) or is_one_of(note, (LOW,)):
                echo(say("still-open", note))
    if folder is not None:
        for path in write_profiles(folder, found.settings, found.file, found.json()):
            echo(say("written", path), err=as_json)
        echo(how_to_import(found.file), err=as_json)
