"""`printmend twin`: print G-code on a virtual broken printer."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from printmend.cli.terminal import Finite, echo, spoken
from printmend.files import all_or_none
from printmend.messages import say

if TYPE_CHECKING:
    import numpy as np

    from printmend.gcode.read import Program
    from printmend.measure import ProbePlan
    from printmend.twin import Twin


def _show_effects(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    """Show the effects that `--corruption` takes by name, and exit."""
    if not wanted or ctx.resilient_parsing:
        return
    from printmend.corruption.cause import listing

    for name, said, example in listing():
        click.echo(f"{name}: {spoken(said)}\n    --corruption {example}")
    echo(say("terminal-twin-examples"))
    ctx.exit()


# Its many parameters are its options.
@click.command(epilog="Example: printmend twin probe.gcode --printer ender3 --corruption broken.toml -o trace.csv")
@click.argument("source", metavar="FILE.gcode", type=click.Path(path_type=Path))
@click.option(
    "--printer", "printer_name", required=True, metavar="NAME|FILE.toml", help="A preset or your own printer."
)
@click.option("--corruption", "broken", required=True, multiple=True, metavar="broken.toml|EFFECT[:KEY=VALUE,…]",
              help="The fault: a file (docs/corruptions.md) or an effect. May be repeated.")  # fmt: skip
@click.option("--list", is_flag=True, is_eager=True, expose_value=False, callback=_show_effects,
              help="List every effect, with an example.")  # fmt: skip
@click.option("--noise-mm", type=Finite(min=0, max=10), default=0.05, show_default=True,
              help="Standard deviation of each measured coordinate.")  # fmt: skip
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    help="Seed of noise, dirt, scanner, and whatever an effect leaves open.",
)
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, dir_okay=False), default=Path("trace.csv"), show_default=True
)
@click.option("--scan", type=click.Path(path_type=Path, dir_okay=False), metavar="SCAN.png",
              help="Also draw the scan of a printed probe, mended or not, or of any part's underside.")  # fmt: skip
@click.option("--top", type=click.Path(path_type=Path, dir_okay=False), metavar="TOP.png",
              help="Also draw the scan of a part's top side, by the same scanner.")  # fmt: skip
@click.option("--probe", "plan_path", type=click.Path(path_type=Path), help="The probe's plan [default: FILE.json]")
@click.option("--dpi", type=Finite(min=50, max=2400), default=600, show_default=True,
              help="Resolution of the scan.")  # fmt: skip
@click.option(
    "--turn", type=click.Choice(["0", "90", "180", "270"]), default="0", help="How the plate lies on the glass."
)
@click.option("--dirt", type=click.Choice(["clean", "default", "heavy"]), default="default", show_default=True,
              help="How bad the scan is.")  # fmt: skip
@all_or_none()
def command(
    source: Path, printer_name: str, broken: tuple[str, ...], noise_mm: float, seed: int, output: Path,
    scan: Path | None, top: Path | None, plan_path: Path | None, dpi: float, turn: str, dirt: str,
) -> None:  # fmt: skip
    """Print FILE.gcode on a twin with this fault, measure what came out, write it as a trace.csv."""
    import numpy as np

    from printmend.cli.terminal import spare
    from printmend.corruption import corruption_of
    from printmend.extras import require
    from printmend.gcode.container import HINT_BYTES
    from printmend.gcode.read import read_gcode
    from printmend.measure import read_plan
    from printmend.measure.table import write_trace
    from printmend.printer import read_printer
    from printmend.twin import Twin
    from printmend.twin.gcode import print_gcode

    if scan is not None or top is not None:
        require("printmend twin --scan", "cv2", "PIL", "scipy")
    spare((output, scan, top), (source, *map(Path, broken), plan_path, Path(printer_name)))
    printer = read_printer(printer_name)
    twin = Twin.of(corruption_of(broken, seed=seed), printer)
    program = read_gcode(source, printer=printer)
    plan = None
    if scan is not None and (plan_path is not None or b"; printmend probe: " in program.text[:HINT_BYTES].tobytes()):
        plan = read_plan(plan_path or source.with_suffix(".json"))
    trace = print_gcode(program, twin, noise_mm=noise_mm, rng=np.random.default_rng(seed))
    scanned = []
    if scan is not None and plan is not None:
        scanned.append((scan, "twin-dots", _dots(program, twin, plan, dpi, dirt, seed, int(turn) // 90)))
    elif scan is not None:
        scanned.append((scan, "twin-underside", _side(program, twin, dpi, dirt, seed, int(turn) // 90, is_top=False)))
    if top is not None:
        scanned.append((top, "twin-top", _side(program, twin, dpi, dirt, seed, int(turn) // 90, is_top=True)))
    write_trace(output, trace)
    echo(say("twin-measured", output, len(trace), f"{noise_mm:g}"))
    for path, what, image in scanned:
        from printmend.measure.image import write_image

        write_image(path, image, dpi=dpi)
        echo(say("twin-scanned", path, say(what), image.shape[1], image.shape[0], f"{dpi:g}"))


def _dots(
    program: "Program", twin: "Twin", plan: "ProbePlan", dpi: float, dirt: str, seed: int, quarter_turns: int
) -> "np.ndarray":
    """Return the scan of a probe's dots."""
    import numpy as np

    from printmend.twin.gcode import print_dots, print_line
    from printmend.twin.scanner import DEGRADATIONS, render_scan

    return render_scan(
        print_dots(program, twin, plan), plan, dpi=dpi, degradations=DEGRADATIONS[dirt],
        rng=np.random.default_rng(seed), quarter_turns=quarter_turns, line_mm=print_line(program, twin, plan),
    ).image  # fmt: skip


def _side(
    program: "Program", twin: "Twin", dpi: float, dirt: str, seed: int, quarter_turns: int, *, is_top: bool
) -> "np.ndarray":
    """Return the scan of a part's first layer from below, or of its last layer from above."""
    import numpy as np

    from printmend.twin.beads import print_beads
    from printmend.twin.scanner import DEGRADATIONS, render_layer

    first = print_beads(program, twin)
    layers = len(np.unique(program.moves.layer[program.moves.extruding & (program.moves.layer >= 0)]))
    beads = print_beads(program, twin, layer=layers) if is_top else first
    return render_layer(
        [points for points, _ in beads], bead_mm=[widths for _, widths in beads], dpi=dpi,
        degradations=DEGRADATIONS[dirt], rng=np.random.default_rng(seed), quarter_turns=quarter_turns,
        beneath=first if is_top else None,
    )  # fmt: skip
