"""`printmend bench real`: measured traverses, learned from the first, predicted the later."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from printmend_lab.cli.table import with_executor


@click.command(
    short_help="Learn from real traverses, predict later ones.",
    epilog="Example: printmend bench real position_error_by_travel.csv",
)
@click.argument("data", type=click.Path(path_type=Path))
@with_executor
@click.option("-o", "--out", type=click.Path(path_type=Path), default="printmend-real", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="The table as JSON on stdout.")
def real(data: Path, executor: Any, out: Path, as_json: bool) -> None:
    """Learn from the first measured traverse of each direction, predict the later ones.

    DATA is a CSV of traverses, or a clone of RenzoCab/Non-Circular-Pulleys with motion capture of real pulleys.
    The floor is the scatter of the later traverses about their own mean. Results go to OUT/real.jsonl; an interrupted
    run goes on where it was.
    """
    from printmend.cli.output import progress
    from printmend_lab.bench.real.mocap import read_runs
    from printmend_lab.bench.real.real import HEADER, cells, real_cases, real_table
    from printmend_lab.cli.table import show_failures, show_table

    cases = real_cases(data, read_runs(data))
    with progress("pulleys and speeds", len(cases)) as tick:
        lines, results = real_table(cases, out, executor=executor, tick=tick)
    if as_json:
        click.echo(json.dumps({"lines": [asdict(line) for line in lines]}))
    else:
        show_table("Measured traverses", HEADER, [cells(line) for line in lines])
    show_failures(results)
