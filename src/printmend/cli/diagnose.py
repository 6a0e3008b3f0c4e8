"""`printmend diagnose`: write a document about a printer's faults for its owner."""

from pathlib import Path

import click

from printmend.cli.terminal import echo, language
from printmend.messages import say


@click.command(epilog="Example: printmend diagnose trace.csv --printer ender3 --report report.html --for part.gcode")
@click.argument("trace", metavar="TRACE.csv", type=click.Path(path_type=Path))
@click.option(
    "--printer", "printer_name", required=True, metavar="NAME|FILE.toml", help="A preset or your own printer."
)
@click.option("--report", metavar="FILE.html|pdf", type=click.Path(path_type=Path, dir_okay=False),
              default=Path("report.html"), show_default=True)  # fmt: skip
@click.option("--for", "part", metavar="PART.gcode", type=click.Path(path_type=Path, dir_okay=False),
              help="Also predict the error of this part.")  # fmt: skip
@click.option("--filament", metavar="NAME", help="Filament of the measured part, as pla-black.")
def command(trace: Path, printer_name: str, report: Path, part: Path | None, filament: str | None) -> None:
    """Say what is wrong with a printer and how sure that is, what to replace or tighten, and what mending corrects."""
    import numpy as np

    from printmend.cli.terminal import spare
    from printmend.extras import require
    from printmend.filament import check_name as check_filament
    from printmend.measure import read_trace
    from printmend.printer import read_printer
    from printmend.report.examination import check_name, examine, summary

    check_name(report)
    require("printmend diagnose", "matplotlib", *(["reportlab"] if report.suffix.lower() == ".pdf" else []))
    from printmend.report.examination_file import write_examination

    spare((report,), (trace, part))
    printer = read_printer(printer_name)
    if filament is not None:
        check_filament(filament)
    rng = np.random.default_rng(0)
    examination = examine(read_trace(trace, printer), printer, part=part, filament=filament, rng=rng)
    write_examination(report, examination, language=language())
    echo(summary(examination))
    echo(say("written", report))
