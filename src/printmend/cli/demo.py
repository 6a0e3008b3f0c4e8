"""`printmend demo`: see a printer break, learn and print right again."""

import json
from pathlib import Path

import click


@click.command(epilog="Example: printmend demo --seed 3 --out my-demo")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Draws what is broken.")
@click.option("--corruption", "broken", type=click.Path(path_type=Path), help="A TOML file that says what is broken.")
@click.option(
    "--body", "file", type=click.Path(path_type=Path), help="A G-code file or mesh; without it, a timing pulley."
)
@click.option("-o", "--out", type=click.Path(path_type=Path), default="printmend-demo", show_default=True,
              help="Folder for the pictures.")  # fmt: skip
@click.option("--scan", is_flag=True, help="The owner's way instead: print a probe, scan it, learn, mend G-code.")
@click.option("--part", is_flag=True, help="One layer of a part instead: print, scan, learn, print the part right.")
@click.option("--json", "as_json", is_flag=True, help="The table as JSON on stdout.")
def command(
    seed: int, broken: Path | None, file: Path | None, out: Path, scan: bool, part: bool, as_json: bool
) -> None:  # fmt: skip
    """Break a twin of an Ender-5, print one test layer, learn from it, plan all layers, print again.

    No printer, slicer or network is needed. Pictures go to the folder --out, where matplotlib is installed.
    """
    import numpy as np

    from printmend.body import body_of, demo_body_gcode, load_body
    from printmend.cli.progress import progress
    from printmend.cli.table import show_table
    from printmend.corruption import read_corruption
    from printmend.demo import demo
    from printmend.extras import require
    from printmend.printer import read_printer

    demo.check_out(out)
    if part or scan:
        require(f"printmend demo --{'part' if part else 'scan'}", "cv2", "matplotlib", "PIL", "scipy")
    if part:
        _show_part(seed, broken, out)
        return
    if scan:
        from printmend.cli.demo_scan import show_scan

        show_scan(seed, broken, file, out, as_json=as_json)
        return
    printer = read_printer("ender5")
    corruption = read_corruption(broken) if broken else demo.demo_corruption(np.random.default_rng(seed))
    body = (
        load_body(file, printer, note=lambda text: click.echo(text, err=True))
        if file
        else body_of(demo_body_gcode(), printer, name="timing pulley")
    )
    if less := demo.left_out():
        click.echo(less, err=True)
    with progress("demo", demo.ticks(body)) as tick:
        done = demo.run_demo(body, corruption, printer, seed=seed, tick=tick)
        written = demo.write_demo(done, out, tick=tick)
    if as_json:
        rows = [{key: value for key, value in vars(one).items() if key != "printed_steps"} for one in done.attempts]
        click.echo(json.dumps({"rows": rows, "written": [str(path) for path in written]}))
        return
    show_table(demo.title(done), demo.HEADER, [demo.cells(attempt) for attempt in done.attempts])
    click.echo(demo.closing(done, written))


def _show_part(seed: int, broken: Path | None, out: Path) -> None:
    from printmend.corruption import read_corruption
    from printmend.demo import part
    from printmend.printer import read_printer

    corruption = read_corruption(broken) if broken else part.DAMAGE
    done = part.run_part(read_printer("ender5"), out, seed=seed, corruption=corruption)
    click.echo("\n".join([*part.lines(done), f"wrote {part.write_figure(done, out)}"]))
