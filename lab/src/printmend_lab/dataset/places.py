"""Where things lie in a data set's folder, and its lists, a line of JSON a body."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from printmend.errors import InputError
from printmend.files import replacing

RECIPE, BODIES, FAILURES = "dataset.json", "bodies.jsonl", "failures.jsonl"


def corruption_file(root: Path, number: int) -> Path:
    """Return where the description of a broken printer lies."""
    return Path(root) / "corruptions" / f"{number:04d}.toml"


def body_file(root: Path, name: str) -> Path:
    """Return where the body of that name lies in a data set."""
    return Path(root) / "bodies" / f"{name}.parquet"


def print_file(root: Path, name: str, number: int) -> Path:
    """Return where the print of a body by the broken printer of that number lies in a data set."""
    before = Path(root) / "prints" / f"corruption={number:04d}"  # schema 1, whose keys are no whole numbers to all
    folder = before if number < 1000 and before.is_dir() else Path(root) / "prints" / f"corruption={number}"
    return folder / f"{name}.parquet"


def body_files_of(root: Path, name: str, corruptions: int) -> list[str]:
    """Return the names of all files of a body in a data set."""
    files = [body_file(root, name), *(print_file(root, name, number) for number in range(corruptions))]
    return [path.relative_to(root).as_posix() for path in files]


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Read JSON lines, none where there is no file. A last line that was cut short is removed from the file."""
    if not path.exists():
        return []
    data = path.read_bytes()
    whole, _, cut = data.rpartition(b"\n")
    try:
        lines = [json.loads(line) for line in whole.decode().splitlines()]
    except (UnicodeDecodeError, ValueError) as error:
        raise InputError(path, wanted="lines of JSON", came=f"{error}", todo="name another folder") from None
    if cut:
        path.write_bytes(whole + b"\n" if whole else b"")
    return lines


def rewrite_lines(path: Path, lines: Iterable[dict[str, Any]]) -> None:
    """Replace a list by these lines."""
    with replacing(path) as file:
        file.writelines(json.dumps(line) + "\n" for line in lines)
