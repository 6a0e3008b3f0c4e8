"""`printmend dataset`: exchange bodies and corruptions with the paper's published code."""

import json
from pathlib import Path

import click


@click.group(epilog="Example: printmend dataset export-reference data --bodies models/ --corruptions 50 --layers 3")
def command() -> None:
    """Write or check a data set in the layout of the paper's published code."""


@command.command(
    "export-reference",
    short_help="Write bodies and corruptions as the published code reads them.",
    epilog="Example: printmend dataset export-reference data --bodies models/ --layers 3",
)
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--bodies", required=True, multiple=True, type=click.Path(path_type=Path), help="Files or folders; repeat."
)
@click.option("--corruptions", default=50, show_default=True, help="How many gain tables to draw.")
@click.option("--layers", type=click.IntRange(1), help="Evenly spaced layers a body; all without it.")
@click.option("--severity", type=click.Choice(["damaged", "realistic"]), default="damaged", show_default=True)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Draws the corruptions.")
@click.option("--json", "as_json", is_flag=True, help="The summary as JSON on stdout.")
def export_reference(
    folder: Path,
    bodies: tuple[Path, ...],
    corruptions: int,
    layers: int | None,
    severity: str,
    seed: int,
    as_json: bool,
) -> None:
    """Write FOLDER/dataset/*.csv and FOLDER/simulation/add_dudw_data.mat, which the published evaluation reads
    when FOLDER is its folder `data`."""
    from printmend.cli.progress import progress
    from printmend.dataset.bodies import body_files
    from printmend.dataset.export import export_reference

    files = body_files(bodies)
    with progress("bodies", len(files)) as tick:
        done = export_reference(
            folder, files, corruptions=corruptions, seed=seed, layers=layers, severity=severity, tick=tick  # type: ignore[arg-type]
        )  # fmt: skip
    if as_json:
        click.echo(json.dumps({"folder": str(folder), "bodies": done.bodies, "refused": dict(done.refused)}))
        return
    click.echo(f"{folder}: {done.bodies} bodies, {corruptions} corruptions")
    for path, reason in done.refused:
        click.echo(f"left out {path}: {reason}", err=True)


@command.command(
    "import-reference", short_help="Read and check a published data set, list its bodies.",
    epilog="Example: printmend dataset import-reference data --json",
)  # fmt: skip
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="JSON lines on stdout.")
def import_reference(folder: Path, as_json: bool) -> None:
    """Read a data set in the published layout, check every row, and list its bodies."""
    from printmend.cli.progress import progress
    from printmend.dataset.reference import read_reference

    reference = read_reference(folder)
    lines = []
    with progress("bodies", len(reference.names)) as tick:
        for name in reference.names:
            item = reference.body(name)
            layers, transitions, (x, y) = len(item.body.layers), item.body.transitions, item.corruption_ids
            if as_json:
                row = {"body": name, "layers": layers, "transitions": transitions, "corr_x": x, "corr_y": y}
                lines.append(json.dumps(row))
            else:
                lines.append(f"{name}  {layers} layers  {transitions} transitions  corruptions {x} and {y}")
            tick(name)
    click.echo("\n".join(lines))
