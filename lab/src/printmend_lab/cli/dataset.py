"""`printmend dataset`: bodies and their prints on broken printers as Parquet; exchange with the published code.

`printmend dataset episodes` records an agent's episodes for offline learning, in Minari's format or LeRobot's.
"""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from printmend.errors import InputError
from printmend_lab.cli.table import with_executor


@click.command(
    "episodes",
    short_help="Record episodes for offline learning: Minari, LeRobot.",
    epilog="Example: printmend dataset episodes --family pulley-loose --agent greybox --episodes 20 -o offline",
)
@click.option("--family", default="pulley-loose", show_default=True, help="What is broken; a wrong one lists them.")
@click.option("--severity", type=click.Choice(["damaged", "realistic"]), default="damaged", show_default=True)
@click.option("--agent", default="greybox", show_default=True, help="naive, or a learner that plans the print.")
@click.option("--episodes", type=click.IntRange(1, 100_000), default=20, show_default=True)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of the first episode.")
@click.option("--form", type=click.Choice(["minari", "lerobot"]), default="minari", show_default=True)
@click.option("--author", default="unknown", show_default=True, help="Noted in Minari's metadata.")
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="The folder.")
def episodes_command(
    family: str, severity: str, agent: str, episodes: int, seed: int, form: str, author: str, out: Path
) -> None:
    """Let an agent play OnePrint, and keep observations, actions and rewards.

    minari: OUT/printmend/one-print-FAMILY-SEVERITY-AGENT-v1, Parquet. Set MINARI_DATASETS_PATH to OUT to load it by
    that name. lerobot: OUT is a LeRobot data set, version 3.0.
    """
    from printmend.extras import require

    require("printmend dataset episodes", "gymnasium", "pyarrow")
    from printmend_lab.offline import agent_of, environment, fresh, record, write_lerobot, write_minari

    env = environment(family, severity)
    plays = agent_of(agent, env)
    plain = "".join(mark if mark.isalnum() or mark == "-" else "-" for mark in agent)
    name = f"printmend/one-print-{family}-{severity}-{plain}-v1"
    fresh(out / name if form == "minari" else out)  # before hours of play
    found = record(env, plays, episodes, seed=seed)
    if form == "minari":
        root = write_minari(out, found, env, name=name, algorithm=agent, author=author)
    else:
        task = f"print the path on a printer with {family} ({severity}), after one test print"
        root = write_lerobot(out, found, task=task, robot="printmend twin")
    score = sum(float(one.rewards.sum()) for one in found) / len(found)
    click.echo(f"{root}: {len(found)} episodes, {sum(map(len, found))} steps, mean score {score:.3f}")


@click.group(epilog="Example: printmend dataset export-reference data --bodies models/ --corruptions 50 --layers 3")
def command() -> None:
    """Build, check and fetch data sets; exchange them with the paper's published code."""


command.add_command(episodes_command)


# Its many parameters are its options.
@command.command(
    short_help="Slice bodies and print them on broken printers, as Parquet.",
    epilog="Example: printmend dataset build --bodies generated:100 --corruptions 3 -o data --workers 2",
)
@click.option(
    "--bodies", required=True, multiple=True, type=click.Path(path_type=Path),
    help="Files, folders, generated:N for N bodies that are made here, or thingi10k; repeat.",
)  # fmt: skip
@click.option("--corruptions", default=1, show_default=True, help="Broken printers that each body is printed on.")
@click.option("--families", default="pulley", show_default=True, help="What is broken on them by turns, with commas.")
@click.option("--severity", type=click.Choice(["damaged", "realistic", "paper"]), default="damaged", show_default=True)
@click.option("--printer", default="ender5", show_default=True, help="Their healthy kind, a preset.")
@click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Of corruptions and generated bodies."
)
@click.option("--licence", default="unknown", show_default=True,
              help="Of the bodies' files, noted with each; where "
              "a licence is known (thingi10k, a licences.json beside), only bodies of which it says so.")  # fmt: skip
@click.option("--timeout", default=600.0, show_default=True, help="Seconds that slicing a body may take.")
@with_executor
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="The data set's folder.")
@click.option("--json", "as_json", is_flag=True, help="The summary as JSON on stdout.")
def build(
    bodies: tuple[Path, ...], corruptions: int, families: str, severity: Any, printer: str, seed: int, licence: str,
    timeout: float, executor: Any, out: Path, as_json: bool,
) -> None:  # fmt: skip
    """Build a data set: STL or G-code to layers of controls, and where broken printers put the nozzle.

    A build that was interrupted goes on with the same command, which also builds again what is missing or damaged.
    Bodies that fail are listed in OUT/failures.jsonl.
    """
    from printmend.cli.terminal import progress
    from printmend.extras import require
    from printmend_lab.dataset.bodies import body_files
    from printmend_lab.dataset.build import Recipe, build_dataset, check_recipe

    require("printmend dataset build", "manifold3d", "matplotlib", "pyarrow", "trimesh")
    recipe = Recipe(corruptions, tuple(families.split(",")), severity, seed, printer, timeout_s=timeout)
    check_recipe(recipe)  # before bodies are made or fetched
    unread: dict[Path, str] = {}
    made = out.with_name(out.name + "-generated")
    files = body_files(bodies, made=made, seed=seed, licence=licence, left_out=unread.__setitem__)
    with progress("bodies", len(files)) as tick:
        built = build_dataset(out, files, recipe, executor, licence=licence, unread=unread, tick=tick)
    if as_json:
        said = {"bodies": built.bodies, "mended": built.mended, "left": built.left, "failures": dict(built.failures)}
        click.echo(json.dumps({"folder": str(out), **said}))
    else:
        again = f", {built.mended} built again" if built.mended else ""
        click.echo(f"{out}: {built.bodies} bodies, {corruptions} corruptions{again}")
        for name, reason in built.failures:
            click.echo(f"left out {name}: {reason}", err=True)
    if built.left:
        todo = "name their files, too, with --bodies"
        raise InputError(out, wanted="whole bodies", came=f"damaged ones: {', '.join(built.left[:3])}", todo=todo)
    if not built.bodies:
        todo = "see what is wrong with each in failures.jsonl"
        raise InputError(str(out), wanted="a body at least", came=f"none of {len(built.failures)}", todo=todo)


@command.command(epilog="Example: printmend dataset info data")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="JSON on stdout.")
def info(folder: Path, as_json: bool) -> None:
    """Say what a data set holds."""
    from printmend_lab.dataset.verify import contents

    found = contents(folder)
    if as_json:
        click.echo(json.dumps(asdict(found)))
        return
    click.echo(
        f"{folder}: {found.bodies} bodies ({found.failures} failed), {found.layers} layers, {found.points} points; "
        f"{found.prints} prints on {found.recipe.corruptions} broken printers ({', '.join(found.recipe.families)}, "
        f"{found.recipe.severity}, seed {found.recipe.seed})\n{found.size_bytes / 1e6:.1f} MB, "
        f"{found.bytes_a_value:.2f} bytes a point and column; licences: {', '.join(found.licences) or 'none'}"
    )


@command.command(short_help="Check every file; print a sample again.", epilog="Example: printmend dataset verify data")
@click.argument("folder", type=click.Path(path_type=Path))
def verify(folder: Path) -> None:
    """Check every file's checksum, and print a sample of the prints again on the twin."""
    from printmend.cli.terminal import progress
    from printmend_lab.dataset.build import read_recipe
    from printmend_lab.dataset.parquet import BODIES, read_lines
    from printmend_lab.dataset.verify import verify_dataset

    read_recipe(folder)  # says what a folder that is no data set is
    count = len(read_lines(folder / BODIES))
    with progress("bodies", count) as tick:
        wrong = verify_dataset(folder, tick=tick)
    for text in wrong:
        click.echo(text, err=True)
    if wrong:
        raise InputError(
            folder,
            wanted="a whole data set",
            came=f"{len(wrong)} faults",
            todo="fetch or build it again: what is whole stays",
        )
    click.echo(f"{folder}: {count} bodies, whole")


@command.command(
    short_help="Copy a published data set, checking every file.",
    epilog="Example: printmend dataset fetch https://example.org/data -o data",
)
@click.argument("source")
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="The data set's new folder.")
def fetch(source: str, out: Path) -> None:
    """Copy a published data set from a folder or an address, checking every file."""
    from printmend.cli.terminal import progress
    from printmend_lab.dataset.verify import fetch_dataset, fetch_list

    count = fetch_list(source, out)
    with progress("bodies", count) as tick:
        came = fetch_dataset(source, out, tick=tick)
    click.echo(f"{out}: {count} bodies, {came} files fetched")


@command.command(
    epilog="Example: printmend dataset card data --name Broken --creator Me --url https://example.org/data"
)
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--name", required=True, help="What the data set is called.")
@click.option("--creator", "creators", required=True, multiple=True, help="Who is cited for it; repeat.")
@click.option("--url", required=True, help="Where it is published.")
@click.option("--description", default="", help="In a sentence or two; without it, what it holds.")
@click.option("--doi", default="", help="Its identifier, once there is one: 10.5281/zenodo.123.")
def card(folder: Path, name: str, creators: tuple[str, ...], url: str, description: str, doi: str) -> None:
    """Write its card: Croissant, a README, DataCite."""
    from printmend_lab.dataset.card import write_card

    for path in write_card(folder, name=name, url=url, creators=creators, description=description, doi=doi):
        click.echo(path)


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
@click.option("--severity", type=click.Choice(["damaged", "realistic", "paper"]), default="damaged", show_default=True)
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
    from printmend.cli.terminal import progress
    from printmend.extras import require
    from printmend_lab.dataset.bodies import body_files
    from printmend_lab.dataset.reference import export_reference

    require("printmend dataset export-reference", "scipy")
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
    from printmend.cli.terminal import progress
    from printmend_lab.dataset.reference import read_reference

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
