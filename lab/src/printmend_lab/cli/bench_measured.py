"""`printmend bench measured`: every learner on measured data."""

import json
from pathlib import Path
from typing import Any

import click

from printmend_lab.cli.table import with_executor


@click.command(
    short_help="Every learner on measured data.",
    epilog="Example: printmend bench measured measured/ --models naive,backlash,greybox",
)
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--sets", help="Names of sets, with commas. Default: all; a wrong one lists them.")
@click.option("--models", help="Learners, with commas. Default: ours, the paper's and those of other trades.")
@with_executor
@click.option("-o", "--out", type=click.Path(path_type=Path), default="printmend-measured", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="The results as JSON on stdout.")
def measured(folder: Path, sets: str | None, models: str | None, executor: Any, out: Path, as_json: bool) -> None:
    """Learn from one part of each measured set below FOLDER, predict the other.

    A cell is what a learner misses as a share of what a straight line misses. The splits are fixed. For a set that is
    not there, its place below FOLDER and the command that fetches it are printed. Results go to OUT/measured.jsonl, the
    table to OUT/measured.md; an interrupted run goes on where it was.
    """
    from printmend.cli.output import progress
    from printmend.errors import InputError
    from printmend_lab.bench.measured.measured import ROWS, measured_cases, measured_lines, measured_table
    from printmend_lab.bench.report import write_markdown
    from printmend_lab.cli.table import show_failures, show_table

    cases, absent = measured_cases(folder, sets.split(",") if sets else ())
    for item in absent:
        click.echo(f"absent: {item.name}, expected at {folder / item.place} ({item.licence}): {item.fetch}", err=True)
    if not cases:
        raise InputError(folder, wanted="a measured set", came="none", todo="fetch one as said above")
    with progress("sets", len(cases)) as tick:
        rows = models.split(",") if models else ROWS
        results = measured_table(cases, rows, out, executor=executor, tick=tick)
    header, lines = measured_lines(results)
    write_markdown(out / "measured.md", header, lines)
    if as_json:
        click.echo(json.dumps([item.flat() for item in results]))
    else:
        show_table(f"Missed, as a share of what a straight line misses, {len(cases)} sets", header, lines)
    show_failures(results)
