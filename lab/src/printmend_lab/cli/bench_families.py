"""`printmend bench families`: every learner and controller on every family of faults."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from printmend_lab.cli.table import with_executor


def numbers(text: str) -> tuple[float, ...]:
    """Read numbers with commas."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise click.BadParameter(f"expected numbers with commas, found {text!r}") from None


# Its many parameters are its options.
@click.command(
    short_help="Every family of faults: learners, controllers, noise, coverage.",
    epilog="Example: printmend bench families --families pulley-loose,smooth --samples 3 --out families",
)
@click.option(
    "--families", help="FAMILY, FAMILY+screw, FAMILY@PRINTER, with commas. Default: all; a wrong one lists them."
)
@click.option("--dataset", type=click.Path(path_type=Path), help="The bodies and faults of `printmend dataset build` "
              "instead: a line for each of its families.")  # fmt: skip
@click.option("--severity", type=click.Choice(["both", "damaged", "realistic"]), default="both", show_default=True)
@click.option("--rows", help="LEARNER+CONTROLLER, with commas; optimum comes with them.")
@click.option("--noise", default="0,0.05,0.1", show_default=True, help="Of the measurement, mm a coordinate.")
@click.option("--coverage", default="0.5,1,2.5", show_default=True, help="Turns of a motor that the body is across.")
@click.option("--samples", type=click.IntRange(1), default=3, show_default=True, help="Faults drawn a family.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.option("--test", is_flag=True, help="The seed kept for the published tables, instead of --seed.")
@with_executor
@click.option("-o", "--out", type=click.Path(path_type=Path), default="printmend-families", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="The cells as JSON on stdout.")
def families(
    families: str | None, dataset: Path | None, severity: str, rows: str | None, noise: str, coverage: str,
    samples: int, seed: int, test: bool, executor: Any, out: Path, as_json: bool,
) -> None:  # fmt: skip
    """Print bodies on random faults of every family: learn from the first layer's noisy scan, print the others.

    A cell is the mean RMSE in full steps, with its ratio to the optimum: the optimal controller on the true machine.
    Results go to OUT/families.jsonl, the tables to OUT/families.md and OUT/families.csv; an interrupted run goes on
    where it was.
    """
    from printmend.cli.output import progress
    from printmend_lab.bench.families import (
        FAMILIES,
        ROWS,
        SEVERITIES,
        TEST_SEED,
        draw_family_cases,
        families_table,
        family_cells,
        family_tables,
        write_families,
    )
    from printmend_lab.cli.table import show_failures, show_table

    if dataset is not None:
        _over_dataset(
            dataset, rows.split(",") if rows else list(ROWS), TEST_SEED if test else seed, executor, out, as_json
        )
        return
    noises, coverages = numbers(noise), numbers(coverage)
    cases = draw_family_cases(
        families.split(",") if families else FAMILIES, coverages=coverages, samples=samples,
        severities=[name for name in SEVERITIES if severity in ("both", name)], seed=TEST_SEED if test else seed,
    )  # fmt: skip
    with progress("cases", len(cases)) as tick:
        chosen = rows.split(",") if rows else ROWS
        results = families_table(cases, chosen, noises, out, executor=executor, tick=tick)
    cells = family_cells(results, noises)
    write_families(out, cells, coverages, noises)
    if as_json:
        click.echo(json.dumps({"cells": [asdict(cell) for cell in cells]}))
    else:
        for title, header, lines in family_tables(cells, coverages, noises):
            show_table(title, header, lines)
    show_failures(results)


def _over_dataset(root: Path, rows: list[str], seed: int, executor: Any, out: Path, as_json: bool) -> None:
    from printmend.cli.output import progress
    from printmend_lab.bench.report import write_markdown
    from printmend_lab.bench.rows import OPTIMUM
    from printmend_lab.bench.table1 import by_family, dataset_cases, table1
    from printmend_lab.cli.table import show_failures, show_table

    rows = list(dict.fromkeys([*rows, OPTIMUM]))
    cases = dataset_cases(root, protocol="heldout", seed=seed)
    with progress("bodies", len(cases)) as tick:
        _, results = table1(cases, rows, out, executor=executor, tick=tick)
    header, lines = by_family(results, rows)
    write_markdown(out / "families.md", header, lines)
    if as_json:
        click.echo(json.dumps({"families": [dict(zip(header, line, strict=True)) for line in lines]}))
    else:
        show_table(f"mean RMSE in steps (ratio to the optimum), {len(cases)} bodies", header, lines)
    show_failures(results)
