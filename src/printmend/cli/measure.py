"""`printmend measure`: scans of the probe become a trace."""

from pathlib import Path

import click


@click.command(
    epilog="Example: printmend measure scan.png turned.png --probe probe.json -o trace.csv --overlay seen.png"
)
@click.argument("scans", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="SCAN...")
@click.option(
    "--probe", "plan_path", required=True, type=click.Path(path_type=Path), help="The plan that `probe` wrote."
)
@click.option("--dpi", type=click.FloatRange(min=50, max=9600), help="Resolution; default what the file says, or 600.")
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("trace.csv"), show_default=True)
@click.option("--overlay", type=click.Path(path_type=Path), help="Draw what was found over the first scan.")
def command(scans: tuple[Path, ...], plan_path: Path, dpi: float | None, output: Path, overlay: Path | None) -> None:
    """Find the marks of the printed probe in SCANs and write where they are.

    A second scan of the same plate, turned by a quarter, removes the errors of the scanner itself. A photo needs
    the reference sheet (`printmend probe --sheet sheet.pdf`) around the print.
    """
    from printmend.measure import read_plan, write_trace
    from printmend.measure.measurement import measure_scans

    measurement = measure_scans(scans, read_plan(plan_path), dpi=dpi, overlay=overlay)
    write_trace(output, measurement.trace)
    for note in measurement.notes:
        click.echo(note)
    if len(missing := measurement.missing):
        click.echo(f"not found: {', '.join(map(str, missing.tolist()))} (numbers of the marks in {plan_path})")
    click.echo(f"{output}: {len(measurement.plan) - len(missing)} measured marks")
