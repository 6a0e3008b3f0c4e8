"""Report each file that was mended or refused: one line for people, or one line of JSON for programs."""

import json
from typing import TYPE_CHECKING

import click

from printmend.cli.terminal import echo
from printmend.messages import together

if TYPE_CHECKING:
    from printmend.mend.many import FileOutcome


def tell(outcome: "FileOutcome", *, as_json: bool, quiet: bool) -> None:
    """Say what became of a file, on stderr where it was not mended; ``quiet`` leaves out what went well."""
    if as_json:
        click.echo(json.dumps(outcome.json(), ensure_ascii=False))
    elif outcome.code:
        echo(together("", ["printmend: ", outcome.words]), err=True)
    elif not quiet:
        echo(outcome.words)
