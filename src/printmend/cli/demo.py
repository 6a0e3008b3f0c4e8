"""`printmend demo`: see a printer break, learn and print right again."""

import json
from pathlib import Path

import click

from printmend.cli.terminal import echo, spoken
from printmend.messages import say, together


@click.command(epilog="Example: printmend demo --seed 3 --out my-demo")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of what is broken.")
@click.option("--corruption", "broken", multiple=True, metavar="broken.toml|EFFECT[:KEY=VALUE,…]",
              help="What is broken: a file, or an effect (`printmend twin --list`).")  # fmt: skip
@click.option(
    "--body", "file", type=click.Path(path_type=Path), help="G-code of the part; without it, a timing pulley."
)
@click.option("-o", "--out", type=click.Path(path_type=Path), default="printmend-demo", show_default=True,
              help="Folder for the files and pictures.")  # fmt: skip
@click.option("--scan", is_flag=True, help="Measure by two scans of the test print.")
@click.option("--part", is_flag=True, help="One layer of a part instead: print, scan, learn, print the part right.")
@click.option("--json", "as_json", is_flag=True, help="The figures as JSON on stdout.")
def command(
    seed: int, broken: tuple[str, ...], file: Path | None, out: Path, scan: bool, part: bool, as_json: bool
) -> None:  # fmt: skip
    """Break a twin of an Ender-5, print a test plate, learn from it, mend a part's G-code, print the part.

    No printer or network is needed. If matplotlib is installed, a picture goes to the folder --out.
    """
    from printmend.demo.contour import check_out
    from printmend.extras import install_command, is_installed, require

    check_out(out)
    if part or scan:
        require(f"printmend demo --{'part' if part else 'scan'}", "cv2", "matplotlib", "PIL", "scipy")
    elif not is_installed("matplotlib"):
        echo(say("terminal-demo-no-picture", install_command(["matplotlib"])), err=True)
    if part:
        _show_part(seed, broken, out)
    else:
        _show_chain(seed, broken, file, out, scan=scan, as_json=as_json)


def _show_part(seed: int, broken: tuple[str, ...], out: Path) -> None:
    from printmend.corruption import corruption_of
    from printmend.demo import part
    from printmend.printer import read_printer

    corruption = corruption_of(broken, seed=seed) if broken else part.DAMAGE
    done = part.run_part(read_printer("ender5"), out, seed=seed, corruption=corruption, tell=spoken)
    picture = part.write_figure(done, out, spoken)
    echo(together("\n", [*part.lines(done), say("written", picture)]))


def _show_chain(
    seed: int, broken: tuple[str, ...], file: Path | None, out: Path, *, scan: bool, as_json: bool
) -> None:  # fmt: skip
    """Break a twin, print and measure a probe on it, learn, mend a part, print it; report the result."""
    import numpy as np

    from printmend.cli.terminal import progress
    from printmend.corruption import corruption_of
    from printmend.demo import scan as chain
    from printmend.demo.contour import demo_corruption
    from printmend.extras import is_installed
    from printmend.gcode.read import read_gcode
    from printmend.printer import read_printer

    printer = read_printer("ender5")
    corruption = corruption_of(broken, seed=seed) if broken else demo_corruption(np.random.default_rng(seed))
    part = bytes(read_gcode(file, printer=printer).text) if file else None
    with progress("demo", chain.TICKS if scan else chain.TICKS_TYPED) as tick:
        done = chain.run_chain(printer, corruption, out, seed=seed, part=part, scanned=scan, tick=tick)
        written = chain.written(out)
        if is_installed("matplotlib"):
            written.append(chain.write_picture(done, out, spoken))
        tick(say("demo-tick-pictures"))
    if as_json:
        click.echo(json.dumps({**chain.figures(done), "written": [str(path) for path in written]}))
    else:
        echo(together("\n", chain.lines(done, written)))
