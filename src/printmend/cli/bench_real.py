"""`printmend bench real`: measured traverses, learned from the first, predicted the later."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click


@click.command(
    short_help="Learn from real traverses, predict later ones.",
    epilog="Example: printmend bench real position_error_by_travel.csv",
)
@click.argument("data", type=click.Path(path_type=Path))
@click.option("--protocol", type=click.Choice(["first", "pooled"]), default="first", show_default=True)
@click.option("--out", type=click.Path(path_type=Path), help="Also save the table as JSON to this file.")
@click.option("--json", "as_json", is_flag=True, help="The table as JSON on stdout.")
def real(data: Path, protocol: Any, out: Path | None, as_json: bool) -> None:
    """Learn from the first measured traverse of each direction, predict the later ones.

    DATA is a CSV of traverses (motion capture of real pulleys). --protocol pooled learns a shape from the first
    traverses of all its speeds. The floor is the scatter of the later traverses about their own mean.
    """
    from printmend.bench.real.real import HEADER, cells, real_lines
    from printmend.bench.real.traverse import read_traverses
    from printmend.cli.progress import progress
    from printmend.cli.table import show_table
    from printmend.files import replacing

    traverses = read_traverses(data)
    with progress("pulleys and speeds", len({(item.shape, item.speed_mm_s) for item in traverses})) as tick:
        lines = real_lines(traverses, protocol, tick=tick)
    text = json.dumps({"protocol": protocol, "lines": [asdict(line) for line in lines]}, indent=1)
    if out is not None:
        with replacing(out) as file:
            file.write(text + "\n")
    if as_json:
        click.echo(text)
    else:
        show_table(f"Measured traverses, protocol {protocol}", HEADER, [cells(line) for line in lines])
