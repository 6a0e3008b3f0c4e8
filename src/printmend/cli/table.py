"""A table on stdout: drawn on a terminal, plain text in a pipe."""

import sys
from collections.abc import Sequence

import click


def show_failures(texts: Sequence[str], *, all_failed: bool) -> None:
    """Say on stderr what failed. Raise `InputError` where nothing else is left: then there is no table."""
    from printmend.errors import InputError

    for text in texts:
        click.echo(f"failed: {text}", err=True)
    if all_failed:
        raise InputError("the table", wanted="a result", came="failures only", todo="see the reasons above")


def show_table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table whose first column is a name and whose others are numbers."""
    if not sys.stdout.isatty():
        from printmend.bench.report import text_table

        click.echo(title + "\n" + text_table(header, rows))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for i, name in enumerate(header):
        table.add_column(name, justify="left" if i == 0 else "right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    Console().print(table)
