"""`printmend verify`: measure a mended check print, and state the result against the promise."""

import json
from pathlib import Path

import click

from printmend.cli.model import ModelType
from printmend.cli.terminal import Finite, echo
from printmend.messages import say


# Long because click passes every option as a parameter of its own, and what was printed decides what is read.
@click.command(
    epilog="Examples: printmend probe --printer ender3 -o check.gcode; printmend mend check.gcode -m "
    "printer.mend.json; printmend verify scan.png --probe check.json -m printer.mend.json"
)
@click.argument("measured", nargs=-1, required=True, metavar="TRACE.csv|SCAN...", type=click.Path(path_type=Path))
@click.option(
    "-m", "--model", "model_path", required=True, metavar="NAME|printer.mend.json", type=ModelType(),
    help="The model that the check print was mended with.",
)  # fmt: skip
@click.option("--probe", "plan_path", type=click.Path(path_type=Path), help="The plan of the check print, for SCANs.")
@click.option("--gcode", "part_path", metavar="PART.gcode", type=click.Path(path_type=Path),
              help="SCAN shows the underside of this part, printed mended. Give the unmended file.")  # fmt: skip
@click.option("--dpi", type=Finite(min=50, max=9600), help="Resolution of the scans, if the files do not say it.")
@click.option("--distance", "distances_mm", metavar="MM", type=Finite(min=1, max=1000), multiple=True,
              help="As in `measure`.")  # fmt: skip
@click.option("--filament", metavar="NAME", help="Filament of the check print, as pla-black: its shrinkage is no "
              "error of the machine.")  # fmt: skip
@click.option("-o", "--output", metavar="NEW.mend.json", type=click.Path(path_type=Path, dir_okay=False),
              help="Write the model, brought up to date with this measurement.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="For programs.")
def command(
    measured: tuple[Path, ...], model_path: Path, plan_path: Path | None, part_path: Path | None, dpi: float | None,
    distances_mm: tuple[float, ...], filament: str | None, output: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Compare a check print with what was promised, and note the result in the model's history.

    The check print is the G-code of a probe, mended with the model and printed. TRACE.csv has the intended and the
    measured positions. The history is beside the model, printer.mend.history.jsonl. A broken promise ends with exit
    code 3, a measurement too coarse to tell with 0. With --filament, mend the check print with it if the model knows
    it, and without it if not.
    """
    from printmend.cli.terminal import spare
    from printmend.errors import RefusedError, of_file
    from printmend.extras import require
    from printmend.filament import check_name
    from printmend.measure import read_plan, read_trace
    from printmend.mend.filament import updated_in, verify_in
    from printmend.mend.history import carry_on, history_of
    from printmend.mend.verify import BROKEN, remember_verdict, update_words
    from printmend.model import read_model, write_model

    is_table = len(measured) == 1 and measured[0].suffix.lower() == ".csv"
    is_part = part_path is not None
    if not is_table and ((plan_path is not None) == is_part or (is_part and len(measured) > 1)):
        raise click.UsageError(say("terminal-usage-verify", measured[0]))
    if not is_table:
        require("printmend verify", "cv2", "PIL", "scipy")
    spare((output,), (*measured, plan_path, part_path, history_of(model_path)))
    if filament is not None:
        check_name(filament)
    model = read_model(model_path)
    if is_table:
        trace = read_trace(measured[0], model.printer)
    elif part_path is not None:
        from printmend.mend.part import measure_part

        trace = measure_part(measured[0], part_path, model.printer, dpi=dpi, distances_mm=distances_mm).trace
    else:
        from printmend.measure.measurement import measure_scans

        assert plan_path is not None
        if len(distances_mm) > 1:
            raise click.UsageError(say("terminal-usage-one-distance"))
        distance_mm = distances_mm[0] if distances_mm else None
        trace = measure_scans(measured, read_plan(plan_path), dpi=dpi, distance_mm=distance_mm).trace
    with of_file(measured[0]):
        verdict = verify_in(model, trace, filament)
        newer = None if output is None else updated_in(model, trace, filament)
    history = remember_verdict(model_path, model, verdict)
    if output is not None and newer is not None:
        write_model(output, newer.model)
        if output.is_file():
            carry_on(model_path, output)
    if as_json:
        click.echo(json.dumps({**verdict.json(), "history": str(history)}))
    else:
        echo(verdict.words_beside(output))
        echo(say("distances-on-bed"))
        if newer is not None:
            echo(update_words(verdict, newer))
            echo(say("written", output))
        echo(say("noted-in", history))
    if verdict.result == BROKEN:
        click.get_current_context().exit(RefusedError.exit_code)
