"""What the lab's commands share: a table on stdout, and the executor of the options --workers and --cluster."""

import functools
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from printmend_lab.bench.case import Result


def show_failures(results: "Sequence[Result]") -> None:
    """Say on stderr what failed, and what was kept from other versions of the code.

    Raise `InputError` where there is nothing but failures: then there is no table.
    """
    from printmend.errors import InputError
    from printmend_lab.bench.report import failure_texts
    from printmend_lab.executor import program_version

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


def with_executor(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options --workers and --cluster; it is called with the ``executor`` that they name.

    A cluster that does not answer ends the command before it makes anything.
    """

    @click.option("--workers", type=click.IntRange(0), default=1, show_default=True, help="Processes; 0 is one a core.")
    @click.option("--cluster", help="Dask workers that see the same files instead: tcp://HOST:PORT, or local:N.")
    @functools.wraps(command)
    def called(*arguments: Any, workers: int, cluster: str | None, **options: Any) -> Any:
        from printmend_lab.executor import Workers, executor

        place = executor(workers, cluster)
        if isinstance(place, Workers) and place.check() == 0:
            click.echo(f"{cluster}: no workers yet, so this waits for the first (`dask worker {cluster}`)", err=True)
        return command(*arguments, executor=place, **options)

    return called
