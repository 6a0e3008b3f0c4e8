"""Check a command's outputs before it works: inputs are never overwritten, and each place must be writable."""

import os
from pathlib import Path

from printmend.errors import InputError
from printmend.files import check_place
from printmend.messages import say


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
