"""A table on stdout: drawn on a terminal, plain text in a pipe."""

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from printmend_lab.bench.case import Result


def show_failures(results: "Sequence[Result]") -> None:
    """Say on stderr what failed, and what was kept from other versions of the code.

    Raise `InputError` where there is nothing but failures: then there is no table.
    """
    from printmend.errors import InputError
    from printmend.executor import program_version
    from printmend_lab.bench.report import failure_texts

    for text in failure_texts(results):
        click.echo(f"failed: {text}", err=True)
    mine = program_version()
    others = [item.code for item in results if item.code != mine]
    if others:
        versions = ", ".join(sorted(set(others)))
        click.echo(
            f"{len(others)} of {len(results)} results were kept from printmend {versions}; this is {mine}. "
            "Another --out makes all anew.",
            err=True,
        )
    if all(item.error for item in results):
        raise InputError("the table", wanted="a result", came="failures only", todo="see the reasons above")


def show_table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table whose first column is a name and whose others are numbers."""
    if not sys.stdout.isatty():
        from printmend_lab.bench.report import text_table

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
