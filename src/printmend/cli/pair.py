"""`printmend pair`: fetch a printer's model from a studio, and each update of it."""

import socket
from pathlib import Path

import click

from printmend.cli.terminal import echo
from printmend.errors import InputError
from printmend.messages import say


@click.command(epilog="Example: printmend pair http://workshop:8765 123456 -m printer.mend.json")
@click.argument("address", required=False)
@click.argument("code", required=False)
@click.option("-m", "--model", "model", required=True, metavar="printer.mend.json", help="Where the model goes.",
              type=click.Path(path_type=Path, dir_okay=False))  # fmt: skip
@click.option("--name", default=socket.gethostname, help="Its name in the studio [default: this computer's name]")
@click.option("--update", "newer", is_flag=True, help="Fetch a newer model, if there is one, and end.")
def command(address: str | None, code: str | None, model: Path, name: str, newer: bool) -> None:
    """Pair this computer with a printer of a studio: fetch its model, and later each newer one.

    The studio shows ADDRESS and CODE (six digits) under the printer. The plug-ins of Moonraker and OctoPrint look for
    a newer model every ten minutes; --update does it by hand.
    """
    from printmend.client import pair, update

    if newer:
        if address is not None:
            raise click.UsageError(say("terminal-usage-pair-update"))
        echo(say("pair-updated" if update(model) else "pair-newest", model))
        return
    if address is None or code is None:
        raise click.UsageError(say("terminal-usage-pair"))
    if len(code) != 6 or not code.isascii() or not code.isdigit():
        raise InputError(code, wanted=say("six-digits"), came=say("something-else"), todo=say("copy-code-studio-shows"))
    echo(say("pair-done", model, repr(pair(model, address, code, name[:60])), address))
