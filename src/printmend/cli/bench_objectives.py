"""`printmend bench objectives`: plans for the RMSE, the 95th percentile, the area or the Fréchet distance."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

NAMES = ("rmse", "p95", "area", "frechet")


@click.command(
    short_help="Does planning for p95, area or Fréchet pay?",
    epilog="Example: printmend bench objectives --objective rmse --objective area --families pulley-loose",
)
@click.option("--objective", "chosen", multiple=True, type=click.Choice(NAMES), help="Repeat; all without it.")
@click.option("--body", type=click.Path(path_type=Path), help="A G-code file or mesh; without it, a timing pulley.")
@click.option("--families", default="pulley,pulley-play,pulley-loose", show_default=True, help="With commas.")
@click.option("--severity", type=click.Choice(["damaged", "realistic"]), default="damaged", show_default=True)
@click.option("--learner", default="greybox", show_default=True, help="Whose model to plan with; oracle is the truth.")
@click.option("--layers", type=click.IntRange(1), default=2, show_default=True, help="How many to hold out and print.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.option("--printer", default="ender5", show_default=True, help="A preset or a TOML file.")
@click.option("--json", "as_json", is_flag=True, help="The table as JSON on stdout.")
def objectives(
    chosen: tuple[str, ...], body: Path | None, families: str, severity: Any, learner: str, layers: int, seed: int,
    printer: str, as_json: bool,
) -> None:  # fmt: skip
    """Learn from one layer, plan others for each objective, print them, measure them by every metric."""
    from printmend.bench.objectives import HEADER, cells, objective_lines
    from printmend.body import body_of, demo_body_gcode, load_body
    from printmend.cli.progress import progress
    from printmend.cli.table import show_table
    from printmend.printer import read_printer

    machine, names, wanted = read_printer(printer), families.split(","), chosen or NAMES
    part = load_body(body, machine) if body else body_of(demo_body_gcode(), machine, name="timing pulley")
    with progress("plans", len(names) * len(wanted)) as tick:
        lines = objective_lines(
            part, machine, families=names, objectives=wanted, learner=learner, severity=severity, layers=layers,
            seed=seed, tick=tick,
        )  # fmt: skip
    if as_json:
        click.echo(json.dumps([asdict(line) for line in lines]))
        return
    show_table(f"Planned for, then measured: {part.name}", HEADER, [cells(line) for line in lines])
