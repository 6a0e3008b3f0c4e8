"""`printmend mend`: rewrite G-code for a broken printer."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from printmend.cli.model import ModelType, read_model_in
from printmend.cli.terminal import Finite, Percent, echo, language, tell
from printmend.messages import say

if TYPE_CHECKING:
    from printmend.model import SavedModel
    from printmend.plan.inverse import Fineness


# Its many parameters are its options.
@click.command(epilog="Example: printmend mend part.gcode -m printer.mend.json --report part.html")
@click.argument("sources", metavar="FILE|FOLDER|-...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "-m", "--model", "model_path", required=True, metavar="NAME|printer.mend.json", type=ModelType(),
    help="What `printmend learn` wrote about this printer.",
)  # fmt: skip
@click.option("--filament", metavar="NAME",
              help="Also correct the shrinkage of this filament [default: left to the slicer].")  # fmt: skip
@click.option("-o", "--output", metavar="FILE|FOLDER|-", type=click.Path(path_type=Path),
              help="Default PART.mended.gcode; - is the standard output. For several files, a folder.")  # fmt: skip
@click.option("--in-place", is_flag=True, help="Replace PART.gcode: for slicers' post-processing.")
@click.option("--overwrite", is_flag=True, help="Overwrite an existing output.")
@click.option("--report", metavar="FILE.html|json", type=click.Path(path_type=Path, dir_okay=False),
              help="Write the prediction: a page with pictures of the part, or all numbers.")  # fmt: skip
@click.option("--force", is_flag=True,
              help="Write even if the prediction is not better, or a file names another printer; "
              "but not beyond the bed.")  # fmt: skip
@click.option("--tolerance", "tolerance_mm", type=Finite(0.002, 0.2), default=0.01, show_default=True,
              metavar="MM", help="Largest error of outer walls; a larger one needs fewer moves and stops. Where the "
              "printer bends lines sharply, hidden lines may be off by more.")  # fmt: skip
@click.option("--firmware", type=click.Choice(["marlin8", "marlin32", "klipper", "rrf", "prusa", "bambu"]),
              help="Firmware of the printer, which limits moves per second [default: as the file says].")  # fmt: skip
@click.option("--slower", type=Percent(0, 1000), metavar="5%",
              help="Largest increase of printing time: infill loses accuracy first, outer walls last.")  # fmt: skip
@click.option("--crossing", "crossing_mm_s2", type=Finite(10, 1e6), metavar="MM_S2",
              help="Acceleration of a motor while it crosses its slack and drives nothing "
              "[default: what the file's M201 or machine limits allow].")  # fmt: skip
@click.option("--jobs", type=click.IntRange(1, 64), default=1, show_default=True, help="Files at a time.")
@click.option("--json", "as_json", is_flag=True, help="A line of JSON for each file.")
@click.option("--quiet", is_flag=True, help="Print only errors.")
@click.pass_context
def command(
    ctx: click.Context, sources: tuple[Path, ...], model_path: Path, filament: str | None, output: Path | None,
    in_place: bool, overwrite: bool, report: Path | None, force: bool, tolerance_mm: float, firmware: str | None,
    slower: float | None, crossing_mm_s2: float | None, jobs: int, as_json: bool, quiet: bool,
) -> None:  # fmt: skip
    """Rewrite G-code so that this printer prints it right, and predict the error before and after.

    .bgcode and .gcode.3mf work, too. For a FOLDER, all G-code in it and below that is not mended yet is mended. In
    another folder (-o), each file keeps its place. An output that exists is replaced only with --overwrite.

    \b
    Exit code 0  written
              1  a bug in printmend
              2  a file, a model or a printer is wrong; nothing written
              3  mending is not sure to help, or takes too long; nothing written

    If one of several files fails, the others are written all the same. The exit code is the worst: 1, then 2, then 3.
    """
    from printmend.plan.inverse import Fineness

    fineness = Fineness(tolerance_mm, firmware, slower, crossing_mm_s2)
    if len(sources) > 1 or sources[0].is_dir() or as_json:
        if str(output) == "-" or any(str(source) == "-" for source in sources) or report is not None:
            raise click.UsageError(say("terminal-usage-one-file"))
        model = read_model_in(model_path, filament)
        _mend_many(ctx, sources, model, output, in_place, overwrite, force, fineness, jobs, as_json, quiet)
        return
    _mend_one(sources[0], model_path, filament, output, in_place, overwrite, report, force, fineness, quiet)


# Its many parameters are the command's options.
def _mend_one(
    source: Path, model_path: Path, filament: str | None, output: Path | None, in_place: bool, overwrite: bool,
    report: Path | None, force: bool, fineness: "Fineness", quiet: bool,
) -> None:  # fmt: skip
    """Mend one file and print the outcome."""
    from printmend.cli.terminal import file_progress, output_path, spare
    from printmend.mend import mend_gcode
    from printmend.mend.many import refuse_overwriting
    from printmend.report.part import check_report_name, write_report

    check_report_name(report)
    target = output_path(source, output, in_place=in_place)
    spare((target, report), (model_path, None if in_place else source))
    if not overwrite:
        refuse_overwriting(target, source)
    model = read_model_in(model_path, filament)
    with file_progress(source) as tick:
        done = mend_gcode(source, model, target, force=force, fineness=fineness, progress=tick)
    if report is not None:
        write_report(
            report, str(source), model, done.prediction, output=None if in_place else target, language=language()
        )
    if not quiet:
        echo(done.prediction.summary(), err=target is None)
        echo(say("written", target or say("standard-output")), err=target is None)


# Its many parameters are the command's options.
def _mend_many(
    ctx: click.Context, sources: tuple[Path, ...], model: "SavedModel", output: Path | None, in_place: bool,
    overwrite: bool, force: bool, fineness: "Fineness", jobs: int, as_json: bool, quiet: bool,
) -> None:  # fmt: skip
    """Mend files and folders and print the outcome for each."""
    from printmend.diagnosis.advice import work_words
    from printmend.errors import InputError
    from printmend.mend.many import gcode_files, mend_files, mended_path

    if in_place and output is not None:
        raise click.UsageError(say("terminal-usage-in-place"))
    files = gcode_files(sources)
    single = len(files) == 1 and not sources[0].is_dir()
    if output is not None and not (single and not output.is_dir()):
        if output.is_file():
            raise InputError(output, wanted=say("folder-several-files"), came=say("file"), todo=say("name-folder"))
        targets = [output / place for place in files.values()]
        for target in targets:
            target.parent.mkdir(parents=True, exist_ok=True)
    else:
        targets = [file if in_place else output or mended_path(file) for file in files]
    codes = []
    for outcome in mend_files(
        list(files), targets, model, force=force, fineness=fineness, overwrite=overwrite or in_place,
        spare_done=() if overwrite else {*files} - {*sources}, jobs=jobs,
    ):  # fmt: skip
        codes.append(outcome.code)
        tell(outcome, as_json=as_json, quiet=quiet)
    for words in () if as_json or quiet else work_words(model):
        echo(words)
    if worst := [code for code in codes if code]:
        ctx.exit(min(worst))
