"""`printmend donate`: pack measurements into one file, to give away."""

from pathlib import Path

import click

from printmend.cli.model import ModelType
from printmend.cli.terminal import echo
from printmend.messages import say, together


@click.command(
    epilog="Example: printmend donate --probe probe.json --scan scan.png -m printer.mend.json -o donation.zip"
)
@click.option("--probe", "plan", type=click.Path(path_type=Path), metavar="PROBE.json", help="The test print's plan.")
@click.option("--scan", "scans", multiple=True, type=click.Path(path_type=Path), metavar="SCAN",
              help="A scan or photo of the test print; repeat.")  # fmt: skip
@click.option("--trace", type=click.Path(path_type=Path), metavar="TRACE.csv", help="What was measured.")
@click.option("-m", "--model", metavar="NAME|printer.mend.json", type=ModelType(),
              help="What was learned and promised; its history comes with it.")  # fmt: skip
@click.option("--check", "checks", multiple=True, type=click.Path(path_type=Path), metavar="SCAN|TRACE.csv",
              help="A scan or a table of the check print; repeat.")  # fmt: skip
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), default=Path("donation.zip"),
              show_default=True)  # fmt: skip
def command(
    plan: Path | None, scans: tuple[Path, ...], trace: Path | None, model: Path | None, checks: tuple[Path, ...],
    output: Path,
) -> None:  # fmt: skip
    """Pack a test print, the model learned from it and its check print into one zip file that helps to improve
    printmend.

    Nothing is sent. Numbers and pixels are packed; names, places, dates, notes and the metadata of pictures are not.
    manifest.json in it says what each file is.
    """
    from printmend.cli.terminal import spare
    from printmend.extras import require
    from printmend.mend.donation import donation, write_donation

    if any(path.suffix.lower() != ".csv" for path in (*scans, *checks)):
        require("printmend donate", "cv2", "PIL")
    if not any((plan, scans, trace, model, checks)):
        raise click.UsageError(say("terminal-usage-donate"))
    spare((output,), (plan, *scans, trace, model, *checks))
    parts = donation(plan=plan, scans=scans, trace=trace, model=model, checks=checks)
    write_donation(output, parts)
    echo(say("donation-holds", output, f"{output.stat().st_size / 1e6:.1f}"))
    for part in parts:
        words = say("donation-part", f"{part.name:<19}", part.what)
        echo(say("donation-less", words, together("; ", part.left_out)) if part.left_out else words)
    echo(say("donation-without"))
    echo(say("donation-not-sent"))
