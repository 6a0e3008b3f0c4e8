"""`printmend bench objectives`: plans for the RMSE or for the area."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from printmend_lab.cli.table import with_executor

NAMES = ("rmse", "area")


# Its many parameters are its options.
@click.command(
    short_help="Does planning for the area instead of the RMSE pay?",
    epilog="Example: printmend bench objectives --objective area --families pulley-loose",
)
@click.option("--objective", "chosen", multiple=True, type=click.Choice(NAMES), help="Repeat; all without it.")
@click.option("--body", type=click.Path(path_type=Path), help="A G-code file or mesh; without it, a timing pulley.")
@click.option("--families", default="pulley,pulley-play,pulley-loose", show_default=True, help="With commas.")
@click.option("--severity", type=click.Choice(["damaged", "realistic", "paper"]), default="damaged", show_default=True)
@click.option("--learner", default="greybox", show_default=True, help="Whose model to plan with; oracle is the truth.")
@click.option("--layers", type=click.IntRange(1), default=2, show_default=True, help="How many to hold out and print.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.option("--printer", default="ender5", show_default=True, help="A preset or a TOML file.")
@with_executor
@click.option("-o", "--out", type=click.Path(path_type=Path), default="printmend-objectives", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="The table as JSON on stdout.")
def objectives(
    chosen: tuple[str, ...], body: Path | None, families: str, severity: Any, learner: str, layers: int, seed: int,
    printer: str, executor: Any, out: Path, as_json: bool,
) -> None:  # fmt: skip
    """Learn from one layer, plan others for each objective, print them, measure them by every metric.

    Results go to OUT/objectives.jsonl; an interrupted run goes on where it was.
    """
    from printmend.cli.output import progress
    from printmend_lab.bench.objectives import HEADER, cells, objective_cases, objectives_table
    from printmend_lab.cli.table import show_failures, show_table

    cases = objective_cases(
        body, families=families.split(","), severity=severity, layers=layers, seed=seed, printer=printer
    )
    with progress("faults", len(cases)) as tick:
        lines, results = objectives_table(cases, chosen or NAMES, out, learner=learner, executor=executor, tick=tick)
    if as_json:
        click.echo(json.dumps([asdict(line) for line in lines]))
    else:
        show_table(f"Planned for, then measured: {cases[0].body}", HEADER, [cells(line) for line in lines])
    show_failures(results)
