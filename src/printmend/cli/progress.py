"""A progress bar on stderr."""

import contextlib
from collections.abc import Callable, Iterator

from printmend.cli.terminal import spoken


@contextlib.contextmanager
def progress(what: str, total: int) -> Iterator[Callable[[str], None]]:
    """Yield a function that advances a bar by one and shows the name it is given; nothing is drawn when piped."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, TextColumn("{task.fields[name]}"), console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=total, name="")

        def tick(name: str) -> None:
            bar.update(task, advance=1, name=spoken(name)[:40])

        yield tick
