"""Are a data set's files those that were written?"""

from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from printmend.errors import InputError
from printmend.executor import Executor
from printmend_lab.dataset.parquet import digest_of
from printmend_lab.dataset.places import BODIES, body_files_of, read_lines


def files_of(line: dict[str, Any], subject: object) -> dict[str, str]:
    """Return a body's files and their checksums by its line in the list.

    Raises `InputError` for a line without them, and for a name that leads out of the folder.
    """
    todo = "ask its publisher, or build it again"
    files = line.get("files")
    if not isinstance(files, dict):
        raise InputError(subject, wanted="the files of each body", came="a line without them", todo=todo)
    for name in files:
        parts = PurePosixPath(name).parts
        if not parts or parts[0] not in ("bodies", "prints") or ".." in parts or not name.endswith(".parquet"):
            raise InputError(subject, wanted="files below bodies/ and prints/", came=name, todo=todo)
    return dict(files)


def faults_of(root: Path, files: dict[str, str], wanted: list[str]) -> list[str]:
    """Return the faults of a body's files in words: missing, changed, or ``wanted`` and not in the list."""
    wrong = [f"{name}: not in the list" for name in wanted if name not in files]
    for name, digest in files.items():
        path = root / name
        if not path.is_file():
            wrong.append(f"{name}: missing")
        elif digest_of(path) != digest:
            wrong.append(f"{name}: not the file that was written")
    return wrong


def damaged_bodies(root: Path, corruptions: int, executor: Executor) -> dict[str, str]:
    """Return the bodies of the list whose files are not as written: their names by their identities."""
    looks = [_Look(str(root), line, corruptions) for line in read_lines(root / BODIES)]
    found = executor.map(_is_damaged, looks) if looks else iter(())
    return {look.line["identity"]: look.line["body"] for look, wrong in found if wrong is True}


@dataclass(frozen=True)
class _Look:
    root: str
    line: dict[str, Any]
    corruptions: int


def _is_damaged(look: _Look) -> bool:
    root = Path(look.root)
    wanted = body_files_of(root, look.line["body"], look.corruptions)
    return bool(faults_of(root, files_of(look.line, BODIES), wanted))
