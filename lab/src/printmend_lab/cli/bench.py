"""`printmend bench`: the paper's tables over your own bodies."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from printmend_lab.cli.bench_families import families
from printmend_lab.cli.bench_measured import measured
from printmend_lab.cli.bench_objectives import NAMES, objectives
from printmend_lab.cli.bench_prints import prints
from printmend_lab.cli.bench_real import real
from printmend_lab.cli.bench_suite import submit_check, suite
from printmend_lab.cli.table import with_executor

if TYPE_CHECKING:
    from printmend_lab.bench.case import Result


@click.group(epilog="Example: printmend bench table1 --bodies models/ --limit 20 --workers 2")
def command() -> None:
    """Judge learners and planners: Table I, every fault, measured data, test prints."""


command.add_command(real)
command.add_command(measured)
command.add_command(families)
command.add_command(prints)
command.add_command(objectives)
command.add_command(suite)
command.add_command(submit_check)


# Its many parameters are its options.
@command.command(epilog="Example: printmend bench table1 --bodies models/ --protocol heldout --limit 60 --workers 2")
@click.option(
    "--bodies",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Files, folders, or generated:N for N bodies that are made here; repeat.",
)
@click.option(
    "--reference", type=click.Path(path_type=Path), help="A data set in the published layout, instead of --bodies."
)
@click.option(
    "--dataset", type=click.Path(path_type=Path), help="A data set of `printmend dataset build`, instead of --bodies."
)
@click.option("--every-printer", is_flag=True, help="With --dataset: each body on all of its printers, not on one.")
@click.option("--protocol", type=click.Choice(["paper", "heldout", "covered"]), default="paper", show_default=True)
@click.option("--families", default="pulley", show_default=True, help="Corruptions to draw from, with commas.")
@click.option("--severity", type=click.Choice(["damaged", "realistic", "paper"]), default="damaged", show_default=True)
@click.option(
    "--printer", default="ender5", show_default=True, help="A preset, for --bodies; `printmend printer` lists them."
)
@click.option(
    "--models", help="Rows, with commas: LEARNER or LEARNER+CONTROLLER. Default: the paper's and the grey box."
)
@click.option("--objective", type=click.Choice(NAMES), help="Plan every learned row for this; else as the row says.")
@click.option("--seed", default=0, show_default=True)
@click.option("--limit", type=click.IntRange(1), help="How many bodies to draw; all without it.")
@with_executor
@click.option("-o", "--out", type=click.Path(path_type=Path), default="printmend-bench", show_default=True)
@click.option("--per-body", is_flag=True, help="Also the RMSE of every body; always with --reference.")
@click.option("--json", "as_json", is_flag=True, help="The table as JSON on stdout.")
def table1(
    bodies: tuple[Path, ...], reference: Path | None, dataset: Path | None, every_printer: bool, protocol: Any,
    families: str, severity: Any, printer: str, models: str | None, objective: str | None, seed: int, limit: int | None,
    executor: Any, out: Path, per_body: bool, as_json: bool,
) -> None:  # fmt: skip
    """Print the paper's Table I. Results go to OUT/table1.jsonl, Fig. 6 to OUT/figure6-*.png.

    Each body is printed on a broken printer (on each, with --every-printer), a model learns from its largest layer, and
    up to three random layers are planned and printed: any layers with --protocol paper, never the training layer with
    heldout. With covered, the training layer shows the most of both motors' turns, and is not judged. An interrupted
    run goes on where it was; OUT/sliced keeps the G-code of meshes.
    """
    from printmend.cli.output import progress
    from printmend.extras import require
    from printmend_lab.bench.rows import PAPER_ROWS, libraries, planned_for
    from printmend_lab.bench.table1 import dataset_cases, draw_cases, parts, reference_cases, table1
    from printmend_lab.cli.table import show_failures
    from printmend_lab.dataset.bodies import body_files

    rows = tuple(models.split(",")) if models else PAPER_ROWS
    if objective is not None:
        rows = tuple(dict.fromkeys(planned_for(name, objective) for name in rows))
    require("printmend bench table1", "matplotlib", *libraries(rows))
    if sum(map(bool, (bodies, reference, dataset))) != 1:
        raise click.UsageError("give --bodies or --reference or --dataset, one of them")
    if every_printer and dataset is None:
        raise click.UsageError("--every-printer needs --dataset, whose printers it means")
    if dataset is not None:
        cases = dataset_cases(dataset, protocol=protocol, seed=seed, limit=limit, every_printer=every_printer)
    elif reference is not None:
        cases = reference_cases(reference, protocol=protocol, seed=seed, limit=limit)
    else:

        def left_out(path: Path, why: str) -> None:
            click.echo(f"left out {path.name}: {why}", err=True)

        files = body_files(bodies, made=out / "generated", seed=seed, left_out=left_out)
        cases = draw_cases(
            files, protocol=protocol, families=tuple(families.split(",")), severity=severity, seed=seed, limit=limit,
            sliced=out / "sliced", printer=printer,
        )  # fmt: skip
    with progress("bodies", len(cases)) as tick:
        lines, results = table1(cases, rows, out, executor=executor, tick=tick)
    if as_json:
        table = [asdict(line) for line in lines]
        by_play = {part.title: [asdict(line) for line in part.lines] for part in parts(results, rows)}
        bodies_ = [item.flat() for item in results]
        click.echo(json.dumps({"table": table, "parts": by_play, "bodies": bodies_}))
    else:
        what = f"{len({case.body for case in cases})} bodies" + every_printer * " on every printer"
        _show(results, rows, f"Table I, protocol {protocol}, {what}", per_body=per_body or reference is not None)
    show_failures(results)


def _show(results: "Sequence[Result]", rows: Sequence[str], title: str, *, per_body: bool) -> None:
    """Print the table, one each for families with play and without it, and what to know of its rows."""
    from printmend_lab.bench.report import body_table, left_texts
    from printmend_lab.bench.table1 import HEADER, cells, parts, stands_still
    from printmend_lab.cli.table import show_table

    found = parts(results, rows)
    for part in found:
        families = f", families {part.title}" if len(found) > 1 else ""
        show_table(title + families, HEADER, [cells(line) for line in part.lines])
    if per_body:
        click.echo("\n" + body_table(results, rows))
    for text in left_texts(results):
        click.echo(text)
    if worse := stands_still(results, rows):
        click.echo(
            f"Worse than naive: {', '.join(worse)}, planned by the paper's Algorithm 1, which stands still where "
            f"play swallows a step; {worse[-1]}+optimal crosses it."
        )
