"""`printmend selfrepair`: a broken printer prints its own timing pulley, and the next on that."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from printmend.cli.model import ModelType

if TYPE_CHECKING:
    from printmend.corruption import Corruption
    from printmend.model import SavedModel

ALL = "all"


@click.command(epilog="Example: printmend selfrepair --hull egg --generations 6 -o repair")
@click.option("--hull", help="The broken pulley: small, line, triangle, square or egg, as the paper's authors "
              "printed them [default: egg]; or all, a table of many damages.")  # fmt: skip
@click.option(
    "--corruption", "broken_path", type=click.Path(path_type=Path), help="A TOML file that says what is broken."
)
@click.option(
    "-m", "--model", "model_path", metavar="NAME|printer.mend.json", type=ModelType(),
    help="A printer of your own, as `printmend learn` knows it.",
)  # fmt: skip
@click.option("--generations", type=click.IntRange(1, 100), default=6, show_default=True, help="Pulleys to print.")
@click.option("--both", is_flag=True, help="Break and replace the pulleys of both motors, not only that of the first.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Draws how pulleys are mounted, "
              "rough edges and the noise of measurements.")  # fmt: skip
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Folder for G-code and figure.")
@click.option("--json", "as_json", is_flag=True, help="The table as JSON on stdout.")
def command(
    hull: str | None, broken_path: Path | None, model_path: Path | None, generations: int, both: bool, seed: int,
    out: Path, as_json: bool,
) -> None:  # fmt: skip
    """Let a broken printer print its own timing pulley, run on it, and print the next: as it is, and with printmend.

    OUT gets pulley.gcode (20 teeth, bore 5 mm, set screw M3), the same mended for each generation, and a figure.
    """
    from printmend.cli.terminal import progress
    from printmend.demo.contour import check_out
    from printmend.extras import require
    from printmend.printer import read_printer
    from printmend_lab.cli.table import show_table
    from printmend_lab.demo import selfrepair as report

    require("printmend selfrepair", "matplotlib")
    check_out(out)
    broken, title = (None, "") if hull == ALL else _broken(hull, broken_path, model_path, both=both)
    printer = getattr(broken, "printer", None) or read_printer("ender5")
    out.mkdir(parents=True, exist_ok=True)
    if broken is None:
        with progress("self-repair", len(report.damages(both=False)) * 4 * generations) as tick:
            lines = report.damage_rows(printer, out, generations=generations, seed=seed, tick=tick)
        if as_json:
            click.echo(json.dumps({"rows": [dict(zip(report.DAMAGE_HEADER, line, strict=True)) for line in lines]}))
        else:
            show_table(f"after {generations} generations, RMS mm", report.DAMAGE_HEADER, lines)
        return
    with progress("self-repair", 2 * generations) as tick:
        series = report.run_both(printer, broken, out, generations=generations, both=both, seed=seed, tick=tick)
    picture = report.draw(series, out / "selfrepair.png", title=title)
    if as_json:
        ways = {one.way: {"rms_mm": one.errors_mm, "verdict": one.verdict, "ended": one.ended} for one in series}
        click.echo(json.dumps({"ways": ways, "written": [str(picture), str(out / "pulley.gcode")]}))
        return
    show_table(title, report.HEADER, report.rows(series))
    for text in (*report.closing(series), f"written: {picture}", f"written: {out / 'pulley.gcode'}"):
        click.echo(text)


def _broken(
    hull: str | None, broken_path: Path | None, model_path: Path | None, *, both: bool
) -> "tuple[Corruption | SavedModel, str]":
    """Return what is broken, and the figure's title."""
    from printmend.corruption import published_names, read_corruption
    from printmend.errors import InputError
    from printmend.model import read_model
    from printmend_lab.demo.selfrepair import hull_damage

    if sum(value is not None for value in (hull, broken_path, model_path)) > 1:
        raise click.UsageError("--hull, --corruption and --model each say what is broken: give one")
    if broken_path is not None:
        return read_corruption(broken_path), f"self-repair of {broken_path.name}"
    if model_path is not None:
        model = read_model(model_path)
        return model, f"self-repair of {model.printer.name} ({model_path.name})"
    if hull is not None and hull not in (known := published_names()):
        raise InputError("--hull", wanted=f"{', '.join(known)} or {ALL}", came=repr(hull), todo="correct it")
    return hull_damage(hull or "egg", both=both), f"self-repair of the pulley “{hull or 'egg'}”"
