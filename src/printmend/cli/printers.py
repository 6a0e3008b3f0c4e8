"""`printmend printers`: list the printers that have a model here."""

import json
from typing import Any

import click

from printmend.cli.model import models, models_folder
from printmend.cli.terminal import echo
from printmend.messages import say


@click.command(epilog="Examples: printmend printers; printmend mend part.gcode -m e3-07")
@click.option("--json", "as_json", is_flag=True, help="A line of JSON for each.")
def command(as_json: bool) -> None:
    """List the models here and in the user's folder by the names that -m takes, with what was found.

    `printmend learn --name NAME` puts a model there.
    """
    from printmend.errors import PrintmendError
    from printmend.model import read_model

    found = False
    for name, path in models():
        found = True
        said: dict[str, Any] = {"name": name, "file": str(path)}
        try:
            model = read_model(path)
            finding = next(iter(model.findings), say("not-learned"))
            said |= {"printer": model.printer.name, "digest": model.digest, "finding": finding}
        except PrintmendError as error:
            said["error"] = error.message
        if as_json:
            click.echo(json.dumps(said, ensure_ascii=False))
        else:
            echo(say("model-listed", name, said.get("printer", path), said.get("finding") or said["error"]))
    if not found and not as_json:
        echo(say("terminal-no-models", models_folder()), err=True)
