"""`printmend history`: show a printer's measurements, and the trend of its wear."""

import json
from pathlib import Path

import click

from printmend.cli.model import ModelType
from printmend.cli.terminal import echo, spoken
from printmend.messages import say


@click.command(epilog="Example: printmend history printer.mend.json --picture wear.png")
@click.argument("model_path", metavar="NAME|printer.mend.json", type=ModelType())
@click.option("--picture", type=click.Path(path_type=Path, dir_okay=False), metavar="WEAR.png",
              help="Draw every fault over time, with its range and its trend.")  # fmt: skip
@click.option("--refitted", multiple=True, metavar="MOTOR", help="Note that the belt or pulley of this motor (x, y; on "
              "a CoreXY a, b) was worked on: nothing is mended until it is measured again.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="For programs.")
def command(model_path: Path, picture: Path | None, refitted: tuple[str, ...], as_json: bool) -> None:
    """Show the measurements of a printer in order, and when a fault will matter.

    The history lies beside the model, printer.mend.history.jsonl: `learn`, `learn --update` and `verify` add to it.
    """
    from printmend.cli.terminal import spare
    from printmend.extras import require
    from printmend.mend.history import history_of, read_history, rows_of, trends_of

    if picture is not None:
        require("printmend history --picture", "matplotlib")
    spare((picture,), (model_path, history_of(model_path)))
    if refitted:
        from printmend.mend.history import remember
        from printmend.mend.update import refitted as worked_on
        from printmend.model.model import read_model, write_model

        model = worked_on(read_model(model_path), refitted)
        write_model(model_path, model)
        remember(model_path, model, "refitted", {"motors": [name.lower() for name in refitted]})
    events = read_history(model_path)
    trends = trends_of(events)
    if picture is not None:
        from printmend.mend.history import draw_history

        draw_history(picture, trends, spoken)
    if as_json:
        click.echo(json.dumps({"events": events, "trends": [trend.json() for trend in trends]}, ensure_ascii=False))
        return
    for date, event, said in rows_of(events):
        echo(say("history-row", date, event, said))
    for trend in trends:
        echo(say("history-trend", trend.name, trend.words))
    if picture is not None:
        echo(say("written", picture))
