"""`printmend curiosity`: which print next, and when to stop."""

import json
from dataclasses import asdict
from pathlib import Path

import click

from printmend.cli.terminal import Finite


@click.command(epilog="Example: printmend curiosity --seed 3 --promise 0.05 -o curious")
@click.option("--corruption", "broken_words", multiple=True, metavar="broken.toml|EFFECT[:KEY=VALUE,…]",
              help="What is broken: a file, or an effect (`printmend twin --list`).")  # fmt: skip
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Draws what is broken, and noise.")
@click.option("--promise", "promise_mm", type=Finite(min=0.001), default=0.05, show_default=True,
              help="Stop where no more than this typical error [mm] is to be expected on the bed.")  # fmt: skip
@click.option("--rounds", type=click.IntRange(1, 50), default=6, show_default=True, help="Prints at most, each way.")
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Folder for the figure.")
@click.option("--json", "as_json", is_flag=True, help="The table as JSON on stdout.")
def command(
    broken_words: tuple[str, ...], seed: int, promise_mm: float, rounds: int, out: Path, as_json: bool
) -> None:  # fmt: skip
    """Let a broken twin choose its own test prints: print, learn, choose the next shortest, stop at the promise.

    Beside it the same printer with the fixed pattern, random marks, and the paper's longest layer.
    """
    import numpy as np

    from printmend.cli.terminal import progress
    from printmend.corruption import corruption_of
    from printmend.demo.contour import check_out
    from printmend.extras import require
    from printmend.printer import read_printer
    from printmend_lab.cli.table import show_table
    from printmend_lab.demo import curiosity
    from printmend_lab.sampling import sample

    require("printmend curiosity", "matplotlib")
    check_out(out)
    printer = read_printer("ender5")
    rng = np.random.default_rng(seed)
    broken = corruption_of(broken_words, seed=seed) if broken_words else sample("pulley-loose", rng)
    with progress("curiosity", len(curiosity.WAYS) * rounds) as tick:
        found = {
            way: curiosity.run_way(way, printer, broken, promise_mm=promise_mm, rounds=rounds, seed=seed, tick=tick)
            for way in curiosity.WAYS
        }
    out.mkdir(parents=True, exist_ok=True)
    picture = curiosity.draw(found, out / "curiosity.png", promise_mm=promise_mm)
    if as_json:
        ways = {way: [asdict(one) for one in rounds_] for way, rounds_ in found.items()}
        click.echo(json.dumps({"ways": ways, "written": [str(picture)]}))
        return
    show_table(f"until {promise_mm:g} mm can be promised", curiosity.HEADER, curiosity.rows(found))
    for text in (*curiosity.closing(found, promise_mm), f"written: {picture}"):
        click.echo(text)
