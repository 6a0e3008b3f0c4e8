"""`printmend paper`: the paper's experiment on one body."""

import json
from pathlib import Path

import click


@click.command(epilog="Example: printmend paper --seed 3 --out my-demo")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Draws what is broken.")
@click.option("--corruption", "broken", multiple=True, metavar="broken.toml|EFFECT[:KEY=VALUE,…]",
              help="What is broken: a file, or an effect (`printmend twin --list`).")  # fmt: skip
@click.option(
    "--body", "file", type=click.Path(path_type=Path), help="A G-code file or mesh; without it, a timing pulley."
)
@click.option("-o", "--out", type=click.Path(path_type=Path), default="printmend-demo", show_default=True,
              help="Folder for the pictures.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="The table as JSON on stdout.")
def command(seed: int, broken: tuple[str, ...], file: Path | None, out: Path, as_json: bool) -> None:
    """Break a twin of an Ender-5, print one test layer, learn from it, plan all layers, print again.

    No printer, slicer or network is needed. If matplotlib is installed, pictures go to the folder --out.
    """
    import numpy as np

    from printmend.cli.terminal import progress
    from printmend.corruption import corruption_of
    from printmend.demo.contour import check_out, demo_corruption
    from printmend.printer import read_printer
    from printmend_lab.body import body_of, demo_body_gcode, load_body
    from printmend_lab.cli.table import show_table
    from printmend_lab.demo import demo

    check_out(out)
    printer = read_printer("ender5")
    corruption = corruption_of(broken, seed=seed) if broken else demo_corruption(np.random.default_rng(seed))
    body = (
        load_body(file, printer, note=lambda text: click.echo(text, err=True))
        if file
        else body_of(demo_body_gcode(), printer, name="timing pulley")
    )
    if less := demo.left_out():
        click.echo(less, err=True)
    with progress("paper", demo.ticks(body)) as tick:
        done = demo.run_demo(body, corruption, printer, seed=seed, tick=tick)
        written = demo.write_demo(done, out, tick=tick)
    if as_json:
        rows = [{key: value for key, value in vars(one).items() if key != "printed_steps"} for one in done.attempts]
        click.echo(json.dumps({"rows": rows, "written": [str(path) for path in written]}))
        return
    show_table(demo.title(done), demo.HEADER, [demo.cells(attempt) for attempt in done.attempts])
    click.echo(demo.closing(done, written))
