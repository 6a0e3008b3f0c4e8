"""What a command writes and shows: outputs that spare its inputs, progress bars, and the outcome of each file."""

import contextlib
import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from printmend.cli.terminal import echo, spoken
from printmend.errors import InputError
from printmend.files import check_place
from printmend.messages import say, together

if TYPE_CHECKING:
    from printmend.mend.many import FileOutcome

_LARGE_BYTES = 20_000_000  # below that it is done before a bar could be read


def spare(outputs: tuple[Path | None, ...], inputs: tuple[Path | None, ...]) -> None:
    """Raise `InputError` where an output is one of the inputs, or another output, or has no folder; None and `-` are no
    files."""
    wanted = [path for path in outputs if path is not None and str(path) != "-"]
    for i, path in enumerate(wanted):
        check_place(path)
        for other in (*wanted[:i], *(item for item in inputs if item is not None and str(item) != "-")):
            if _same(path, other):
                raise InputError(
                    path, wanted=say("file-own-write"), came=say("command-reads-writes-already"),
                    todo=say("choose-another-name"),
                )  # fmt: skip


def _same(one: Path, other: Path) -> bool:
    """Say whether two paths are one file."""
    try:
        return os.path.samefile(one, other)
    except (OSError, ValueError):
        return os.path.abspath(one) == os.path.abspath(other)


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
def file_progress(source: Path) -> Iterator[Callable[[int], None] | None]:
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


def tell(outcome: "FileOutcome", *, as_json: bool, quiet: bool) -> None:
    """Say what became of a file, on stderr where it was not mended; ``quiet`` leaves out what went well."""
    if as_json:
        click.echo(json.dumps(outcome.json(), ensure_ascii=False))
    elif outcome.code:
        echo(together("", ["printmend: ", outcome.words]), err=True)
    elif not quiet:
        echo(outcome.words)
