"""`printmend demo --scan`: the owner's way, from the test plate to the mended part."""

import json
from pathlib import Path

import click


def show_scan(seed: int, broken: Path | None, file: Path | None, out: Path, *, as_json: bool) -> None:
    """Break a twin, print and scan a probe on it, learn from the scans, mend a part, print it; say what came of it."""
    import numpy as np

    from printmend.cli.progress import progress
    from printmend.corruption import read_corruption
    from printmend.demo import demo
    from printmend.demo import scan as demo_scan
    from printmend.gcode.read import read_gcode
    from printmend.printer import read_printer

    printer = read_printer("ender5")
    corruption = read_corruption(broken) if broken else demo.demo_corruption(np.random.default_rng(seed))
    part = bytes(read_gcode(file, printer=printer).text) if file else None
    with progress("demo", demo_scan.TICKS) as tick:
        done = demo_scan.run_chain(printer, corruption, out, seed=seed, part=part, tick=tick)
        written = demo_scan.write_pictures(done, out)
        tick("pictures")
    if as_json:
        click.echo(json.dumps({**demo_scan.figures(done), "written": [str(path) for path in written]}))
    else:
        click.echo("\n".join(demo_scan.lines(done, written)))
