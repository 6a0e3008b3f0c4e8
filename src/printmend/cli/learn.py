"""`printmend learn`: learn a machine's faults from a measured print."""

import json
import shlex
from datetime import UTC, datetime
from pathlib import Path

import click

from printmend.cli.model import SUFFIX, ModelType, models_folder
from printmend.cli.terminal import echo
from printmend.messages import say


# Long, with many parameters, because of its options, and because each kind of result has its own words.
@click.command(epilog="Example: printmend learn trace.csv --printer ender3 -o printer.mend.json")
@click.argument("trace", metavar="TRACE.csv", required=False, type=click.Path(path_type=Path))
@click.option(
    "--printer", "printer_name", metavar="NAME|FILE.toml", help="A preset or your own printer [with --update: the old]"
)
@click.option("--learner", default="auto", show_default=True, metavar="auto|lightgbm-axis|…",
              help="auto: the simplest machine that explains the trace.")  # fmt: skip
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, dir_okay=False),
    help="[default: printer.mend.json; with --update: the old model's file]",
)  # fmt: skip
@click.option("--name", help="Keep the model in the user's folder under this name, for -m NAME.")
@click.option("--update", "old", metavar="NAME|OLD.mend.json", type=ModelType(),
              help="Bring this model up to date with a second, smaller print, and say what changed.")  # fmt: skip
@click.option("--phase", "moved", metavar="NAME|OLD.mend.json", type=ModelType(),
              help="After work on the belts: find this model's motors again from a `probe --phase`.")  # fmt: skip
@click.option(
    "--filament", metavar="NAME", help="Filament of a measured part, as pla-black; none for dots on a plate or paper."
)
@click.option("--travel", "travels", metavar="AXIS=SENT:WENT", multiple=True,
              help="Travel of the head by a steel rule, in mm, as x=200:199.6. With --update, TRACE is optional.",
              )  # fmt: skip
@click.option("--date", "when", type=click.DateTime(["%Y-%m-%d"]), metavar="YYYY-MM-DD",
              help="When the print was made, for `printmend history` [default: today]")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print the diagnosis as JSON.")
def command(
    trace: Path | None,
    printer_name: str | None,
    learner: str,
    output: Path | None,
    name: str | None,
    old: Path | None,
    moved: Path | None,
    filament: str | None,
    travels: tuple[str, ...],
    when: datetime | None,
    as_json: bool,
) -> None:
    """Learn what is wrong with a printer from one measured print, and say so in plain words.

    TRACE.csv has a row for each commanded way-point: x_mm, y_mm, x_measured_mm, y_measured_mm, and z_mm, z_measured_mm
    for the Z screw; measured cells may be empty.

    With --filament, the scale errors of machine and filament are separated as far as the measurements allow.
    """
    import numpy as np

    from printmend.cli.terminal import spare
    from printmend.errors import of_file
    from printmend.filament import check_name
    from printmend.learn.learned import known_digests, report
    from printmend.measure import read_trace
    from printmend.mend.filament import filament_words, learn_in, parse_travel, printed_in, update_in
    from printmend.mend.history import ageing_of, carry_on, has_measurement, remember_learned
    from printmend.mend.mend import is_healthy
    from printmend.model.model import read_model, refusals, write_model
    from printmend.printer import read_printer

    if old is not None and moved is not None:
        raise click.UsageError(say("terminal-usage-phase-or-update"))
    old = old or moved
    if printer_name is None and old is None:
        raise click.UsageError(say("terminal-usage-learn-printer"))
    if moved is not None and (filament is not None or travels):
        raise click.UsageError(say("terminal-usage-phase-filament"))
    if trace is None and not (old is not None and travels):
        raise click.UsageError(say("terminal-usage-trace"))
    rules = [parse_travel(each) for each in travels]
    if filament is not None:
        check_name(filament)
    if name is not None:
        if output is not None or Path(name).name != name or name.startswith("."):
            raise click.UsageError(say("terminal-usage-plain-name"))
        output = models_folder() / f"{name}{SUFFIX}"
        output.parent.mkdir(parents=True, exist_ok=True)
    past = None if old is None else read_model(old)  # else what is no model would seem to be one to write over
    output = output or old or Path("printer.mend.json")
    written = say("written-over" if output.exists() else "written", output)
    spare((output,), (trace or Path("-"), Path(printer_name or "-")))
    rng = np.random.default_rng(0)
    dated = None if when is None else when.replace(tzinfo=UTC)
    updated = None
    if past is None:
        printer = read_printer(printer_name or "")
        assert trace is not None
        with of_file(trace):
            model = learn_in(read_trace(trace, printer), printer, filament, rules, model=learner, rng=rng)
    else:
        from printmend.mend.update import learn_phase, same_machine

        assert old is not None
        if printer_name is not None:
            same_machine(past, read_printer(printer_name))
        ageing = None if moved is not None else ageing_of(old, dated)
        with of_file(trace or old):
            again = None if trace is None else read_trace(trace, past.printer)
            if moved is not None:
                assert again is not None
                updated = learn_phase(past, again, rng=rng)
            else:
                updated = update_in(past, again, filament, rules, rng=rng, ageing=ageing)
        model = updated.model
        if ageing is not None and ageing.words:
            echo(ageing.words, err=as_json)
        echo(updated.words, err=as_json)
    write_model(output, model)
    if output.is_file() and old is not None:
        carry_on(old, output)
    if output.is_file() and not (updated is not None and updated.is_known):
        measurement = None if trace is None else next(iter(reversed(known_digests(model))), None)
        if has_measurement(output, measurement):
            echo(say("history-has-measurement"), err=as_json)
        remember_learned(
            output, model, "steel rule" if trace is None else trace.name, measurement=measurement,
            updated=old is not None, when=dated,
        )  # fmt: skip
    if as_json:
        click.echo(json.dumps({"output": str(output), "digest": model.digest, **model.summary}, ensure_ascii=False))
    else:
        in_it = "" if filament is None else f" --filament {filament}"
        comes = say("terminal-next-mend", f"{shlex.quote(str(name or output))}{in_it}")
        if refusals(model.document):
            comes = say("terminal-next-learn-again")
        elif is_healthy(printed_in(model, filament)):
            comes = say("nothing-to-mend")
        for line in (report(model), *filament_words(model), written, comes):
            echo(line)
