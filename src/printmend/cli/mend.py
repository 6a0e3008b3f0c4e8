"""`printmend mend`: rewrite G-code for a broken printer."""

from pathlib import Path

import click


@click.command(epilog="Example: printmend mend part.gcode -m printer.mend.json --report part.html")
@click.argument("source", metavar="PART.gcode|-", type=click.Path(path_type=Path, dir_okay=False, allow_dash=True))
@click.option(
    "-m", "--model", "model_path", required=True, metavar="printer.mend.json", type=click.Path(path_type=Path),
    help="What `printmend learn` wrote about this printer.",
)  # fmt: skip
@click.option("-o", "--output", metavar="FILE|-", type=click.Path(path_type=Path, dir_okay=False, allow_dash=True),
              help="Default PART.mended.gcode; - is the standard output.")  # fmt: skip
@click.option("--in-place", is_flag=True, help="Replace PART.gcode: for slicers' post-processing.")
@click.option("--report", metavar="FILE.html|json", type=click.Path(path_type=Path, dir_okay=False),
              help="Write the prediction, layer by layer.")  # fmt: skip
@click.option("--force", is_flag=True, help="Write even where the prediction is not better.")
def command(
    source: Path, model_path: Path, output: Path | None, in_place: bool, report: Path | None, force: bool
) -> None:
    """Rewrite PART.gcode so that this printer prints it right, and predict the error before and after.

    .bgcode and .gcode.3mf work too. Writes nothing and ends with 3 where the prediction is not better.
    """
    from printmend.cli.mend_output import output_path, progress
    from printmend.cli.outputs import spare
    from printmend.repair import mend_gcode
    from printmend.repair.report import check_report_name, write_report
    from printmend.saved.model import read_model

    check_report_name(report)
    target = output_path(source, output, in_place=in_place)
    spare((target, report), (model_path, None if in_place else source))
    model = read_model(model_path)
    with progress(source) as tick:
        done = mend_gcode(source, model, target, force=force, progress=tick)
    if report is not None:
        write_report(report, str(source), model, done.prediction)
    click.echo(done.prediction.summary(), err=target is None)
    click.echo(f"written: {target or 'standard output'}", err=target is None)
