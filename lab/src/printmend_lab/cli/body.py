"""`printmend body`: what a mesh or G-code file becomes on the lattice of full steps."""

import json
from pathlib import Path

import click

from printmend.messages import say_count


@click.command(epilog="Example: printmend body part.stl --printer ender5")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--printer", "printer_name", default="ender5", show_default=True, help="A preset or a TOML file.")
@click.option("--unit", help="The mesh's unit, if the file names none: mm, cm, m, inch, foot, micron.")
@click.option("--json", "as_json", is_flag=True, help="JSON on stdout.")
def command(file: Path, printer_name: str, unit: str | None, as_json: bool) -> None:
    """Slice FILE (STL, OBJ, 3MF, PLY) or read it (G-code), and list its layers: height, points, extruding points."""
    from printmend.printer import read_printer
    from printmend_lab.body import load_body

    body = load_body(file, read_printer(printer_name), unit=unit, note=lambda text: click.echo(text, err=True))
    rows = [(layer.index, layer.z_mm, layer.transitions, int(layer.extruding.sum())) for layer in body.layers]
    if as_json:
        keys = ("layer", "z_mm", "points", "extruding")
        layers = [dict(zip(keys, row, strict=True)) for row in rows]
        click.echo(json.dumps({"name": body.name, "points": body.transitions, "layers": layers}))
        return
    click.echo(f"{'layer':>6} {'z/mm':>8} {'points':>9} {'extruding':>10}")
    for index, z_mm, points, extruding in rows:
        click.echo(f"{index:>6} {z_mm:>8.2f} {points:>9} {extruding:>10}")
    click.echo(f"{body.name}: {say_count('so-many-layers', len(rows))}, {body.transitions} points")
