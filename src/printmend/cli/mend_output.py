"""Where `mend` writes to, and its progress bar."""

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import click

from printmend.messages import say

_LARGE_BYTES = 20_000_000  # below that it is done before a bar could be read


def output_path(source: Path, output: Path | None, *, in_place: bool) -> Path | None:
    """Return where the mended file goes; None is the standard output."""
    if in_place:
        if output is not None or str(source) == "-":
            raise click.UsageError(say("terminal-usage-in-place"))
        return source
    if output is not None:
        if str(output) == "-":
            return None
        return output / source.name if output.is_dir() else output
    if str(source) == "-":
        return None
    from printmend.mend.many import mended_path

    return mended_path(source)


@contextlib.contextmanager
def progress(source: Path) -> Iterator[Callable[[int], None] | None]:
    """Yield a function that is told of bytes read, and draws a bar on a terminal; None for small files and pipes.

    A program that starts this one sets PRINTMEND_PROGRESS=1: it reads `37 %` and so on, a line each, from the standard
    error.
    """
    size = source.stat().st_size if source.is_file() else 0
    if size and os.environ.get("PRINTMEND_PROGRESS") == "1":
        yield _percent_lines(size)
        return
    if size < _LARGE_BYTES or not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(source.name, total=size)
        yield lambda count: bar.update(task, advance=count)


def _percent_lines(size: int) -> Callable[[int], None]:
    """Return a progress that says each new percentage in a line."""
    read = said = 0

    def tick(count: int) -> None:
        nonlocal read, said
        read += count
        percent = min(100, 100 * read // size)  # what is packed in a container is longer than it
        if percent > said:
            said = percent
            click.echo(f"{percent} %", err=True)

    return tick
