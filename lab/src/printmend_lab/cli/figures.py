"""`printmend figures`: the paper's figures and its Table I, made anew."""

from pathlib import Path
from typing import Any

import click

from printmend_lab.cli.table import with_executor


@click.command(epilog="Example: printmend figures --dataset data -o figures --workers 2")
@click.option("--dataset", "root", required=True, type=click.Path(path_type=Path),
              help="A data set of `printmend dataset build`.")  # fmt: skip
@click.option("--protocol", type=click.Choice(["paper", "heldout"]), default="paper", show_default=True)
@click.option("--models", help="Rows of the table, with commas. Default: the paper's and the grey box.")
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Which printer and layers a body gets."
)
@click.option("--limit", type=click.IntRange(1), help="How many bodies; all without it.")
@with_executor
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Folder for figures and table.")
def command(
    root: Path, protocol: Any, models: str | None, seed: int, limit: int | None, executor: Any, out: Path
) -> None:  # fmt: skip
    """Draw Fig. 1 to 6 as SVG and write Table I as Markdown, LaTeX and SVG, from a data set.

    Results are kept in OUT/table1.jsonl: an interrupted run continues where it left off.
    """
    from printmend.cli.terminal import progress
    from printmend.demo.contour import check_out
    from printmend.extras import require
    from printmend_lab.bench.case import PAPER_ROWS, libraries
    from printmend_lab.bench.table1 import dataset_cases, parts, table1
    from printmend_lab.cli.table import show_failures, show_table

    rows = tuple(models.split(",")) if models else PAPER_ROWS
    require("printmend figures", "matplotlib", "pyarrow", "scipy", *libraries(rows))
    from printmend_lab.demo.figures import table_lines, write_figures

    check_out(out)
    cases = dataset_cases(root, protocol=protocol, seed=seed, limit=limit)
    with progress("bodies", len(cases)) as tick:
        _, results = table1(cases, rows, out, executor=executor, tick=tick)
    show_failures(results)
    with progress("figures", 7) as tick:
        written = write_figures(root, cases, rows, results, out, tick=tick)
    for part in parts(results, rows):
        show_table(f"Table I, protocol {protocol}, families {part.title}", *table_lines(part))
    for path in written:
        click.echo(f"written: {path}")
