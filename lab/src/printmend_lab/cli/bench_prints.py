"""`printmend bench prints`: which test print teaches most."""

import json
from pathlib import Path
from typing import Any

import click

from printmend_lab.cli.bench_families import numbers
from printmend_lab.cli.table import with_executor


@click.command(
    short_help="Which test print teaches most: prints, points, noise.",
    epilog="Example: printmend bench prints --prints fixed,layer,optimal --points 250 --samples 2 --out prints",
)
@click.option("--prints", help="Test prints, with commas. Default: the designs of `probe` and eight shapes.")
@click.option("--families", help="Faults to draw from, with commas.")
@click.option("--points", default="60,250,1000", show_default=True, help="Measured points.")
@click.option("--noise", default="0,0.05,0.1", show_default=True, help="Of the measurement, mm a coordinate.")
@click.option("--samples", type=click.IntRange(1), default=2, show_default=True, help="Faults drawn a family.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@with_executor
@click.option("-o", "--out", type=click.Path(path_type=Path), default="printmend-prints", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="Every result as JSON on stdout.")
def prints(
    prints: str | None, families: str | None, points: str, noise: str, samples: int, seed: int, executor: Any,
    out: Path, as_json: bool,
) -> None:  # fmt: skip
    """Make test prints on randomly damaged printers, learn from each, and print a body with what was learned.

    A cell is the bodies' mean RMSE in full steps, with its ratio to the optimum: the best plan on the true machine.
    Results go to OUT/prints.jsonl and the table to OUT/prints.md; an interrupted run goes on where it was.
    """
    from printmend.cli.output import progress
    from printmend_lab.bench import prints as bench
    from printmend_lab.bench.report import write_markdown
    from printmend_lab.cli.table import show_failures, show_table

    counts, noises = tuple(int(count) for count in numbers(points)), numbers(noise)
    cases = bench.draw_print_cases(families.split(",") if families else bench.FAMILIES, samples=samples, seed=seed)
    chosen = prints.split(",") if prints else bench.PRINTS
    with progress("cases", len(cases)) as tick:
        results = bench.prints_table(cases, chosen, counts, noises, out, executor=executor, tick=tick)
    if as_json:
        click.echo(json.dumps([item.flat() for item in results]))
    header, lines = bench.print_lines(results, counts, noises)
    write_markdown(out / bench.MARKDOWN, header, lines)
    if not as_json:
        show_table(f"Test prints, {len(cases)} damaged printers", header, lines)
    show_failures(results)
