"""`printmend bench suite` and `submit-check`: rows on suites that do not change."""

import json
from pathlib import Path
from typing import Any

import click

from printmend_lab.cli.table import with_executor

_ROWS = "naive,greybox+optimal,meta+optimal"
_REASONS = 3  # of failed cases that are printed; the file has all


@click.command(epilog="Example: printmend bench suite printmend/Families-v1 --rows greybox+optimal -o results")
@click.argument("name", metavar="SUITE", required=False)
@click.option("--rows", help=f"With commas. Default: {_ROWS}; where nothing is planned, without +optimal.")
@click.option("--data", type=click.Path(path_type=Path, exists=True, file_okay=False), help="Folder of measured sets.")
@with_executor
@click.option("--out", "-o", type=click.Path(path_type=Path), default="printmend-suite", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="The results as JSON lines on stdout.")
def suite(name: str | None, rows: str | None, data: Path | None, executor: Any, out: Path, as_json: bool) -> None:
    """Run rows on a suite that never changes.

    Its seed, bodies, splits and metrics are frozen. Without a SUITE, all are listed. Measured-v1 wants the --data that
    `printmend bench measured` reads, and says how to fetch what is missing. Its rows are learners without a planner.
    Each row becomes a file OUT/SUITE/ROW.json with its figures, cost, versions and every case. An interrupted run goes
    on where it was.
    """
    from printmend.cli.output import progress
    from printmend.errors import InputError
    from printmend_lab.bench.submission import write_result
    from printmend_lab.bench.suites import SUITES, run_suite
    from printmend_lab.bench.suites import suite as suite_of

    if name is None:
        for one in SUITES.values():
            click.echo(f"{one.name}  {one.count} cases  {one.about}")
        return
    chosen = suite_of(name)
    if chosen.measured != (data is not None):
        todo = "add --data FOLDER" if chosen.measured else "leave --data out"
        raise InputError(chosen.name, wanted="--data" if chosen.measured else "no --data",
                         came="none" if chosen.measured else f"{data}", todo=todo)  # fmt: skip
    asked = rows or (_ROWS.replace("+optimal", "") if chosen.measured else _ROWS)
    for row in dict.fromkeys(asked.split(",")):
        with progress("cases", chosen.count) as tick:
            record = run_suite(chosen, row, out / "work", data=data, executor=executor, tick=tick)
        path = write_result(record, out)
        found, first = record["metrics"], chosen.metrics[0]
        figure = "–" if found[first] is None else f"{found[first]:.3f}{'' if chosen.measured else ' steps'}"
        said = f"{chosen.name} {row}: {first} {figure}, {found['failures']} failed; wrote {path}"
        click.echo(json.dumps(record) if as_json else said)
        for reason in list(dict.fromkeys(record.get("failures", {}).values()))[:_REASONS]:
            click.echo(f"failed: {reason}", err=True)


@click.command("submit-check", epilog="Example: printmend bench submit-check results/Families-v1/greybox+optimal.json")
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
def submit_check(files: tuple[Path, ...]) -> None:
    """Check results of `bench suite`: checksum, cases, figures."""
    from printmend_lab.bench.submission import check_submission

    for path in files:
        record = check_submission(path)
        click.echo(f"{path}: {record['row']} on {record['suite']}, whole")
