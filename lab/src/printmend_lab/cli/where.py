"""Where a command's work runs: the options --workers and --cluster become an executor."""

import functools
from collections.abc import Callable
from typing import Any

import click


def with_executor(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options --workers and --cluster; it is called with the ``executor`` that they name.

    A cluster that does not answer ends the command before it makes anything.
    """

    @click.option("--workers", type=click.IntRange(0), default=1, show_default=True, help="Processes; 0 is one a core.")
    @click.option("--cluster", help="Dask workers that see the same files instead: tcp://HOST:PORT, or local:N.")
    @functools.wraps(command)
    def called(*arguments: Any, workers: int, cluster: str | None, **options: Any) -> Any:
        from printmend.executor import Cluster, executor

        place = executor(workers, cluster)
        if isinstance(place, Cluster) and place.check() == 0:
            click.echo(f"{cluster}: no workers yet, so this waits for the first (`dask worker {cluster}`)", err=True)
        return command(*arguments, executor=place, **options)

    return called
