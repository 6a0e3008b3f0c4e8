"""What is known of a body's file from beside it: its name and licence, by a list in its folder or above.

`manifest.csv` has a column `file`, a path from the list's folder, and any of `name` and `licence` (or `license`). It
may lie in a folder above. `licences.json`, {"name without suffix": "licence", …}, lies beside the bodies
(`dataset.thingi10k`). The G-code in a data set's own folder `sliced/` keeps what the set knows of its bodies.
"""

import csv
import io
import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from printmend.errors import InputError
from printmend.files import read_text
from printmend_lab.dataset.places import BODIES
from printmend_lab.dataset.thingi10k import licence_beside

MANIFEST, SLICED = "manifest.csv", "sliced"
_ABOVE = 4  # folders above a body's in which its manifest is looked for


@dataclass(frozen=True)
class Known:
    """A body's name, and its licence where one is known."""

    name: str
    licence: str | None = None


def known_of(path: Path) -> Known:
    """Return what is known of a body's file; without a list it is called as its file.

    Raises `InputError` for a list that cannot be read.
    """
    path = path.absolute()
    if path.parent.name == SLICED and (path.parent.parent / BODIES).is_file():
        line = _sliced(path.parent.parent / BODIES, _changed(path.parent.parent / BODIES)).get(path.name)
        if line is not None:
            return Known(Path(str(line["source"])).stem, str(line["licence"]))
    said = licence_beside(path)
    for folder in list(path.parents)[: _ABOVE + 1]:
        if not (folder / MANIFEST).is_file():
            continue
        row = _rows(folder / MANIFEST, _changed(folder / MANIFEST)).get(path.relative_to(folder).as_posix())
        if row is not None:
            licence = row.get("licence") or row.get("license")
            return Known(row.get("name") or path.stem, said or licence or None)
    return Known(path.stem, said)


def _changed(path: Path) -> int:
    return path.stat().st_mtime_ns


@lru_cache(maxsize=16)
def _rows(path: Path, changed: int) -> dict[str, dict[str, str]]:
    todo = "write a table with the columns file, name and licence, or remove it"
    try:
        table = csv.DictReader(io.StringIO(read_text(path, wanted="a manifest", todo=todo)), strict=True)
        rows = [{(key or "").strip().lower(): (value or "").strip() for key, value in row.items()} for row in table]
    except (csv.Error, AttributeError) as error:  # a row that is longer than the head holds a list
        raise InputError(path, wanted="a manifest", came=f"{error}", todo=todo) from None
    if rows and "file" not in rows[0]:
        raise InputError(path, wanted="a column `file`", came=", ".join(rows[0]), todo=todo)
    return {Path(row["file"]).as_posix(): row for row in rows}


@lru_cache(maxsize=4)
def _sliced(path: Path, changed: int) -> dict[str, dict[str, Any]]:
    """Return the lines of a data set's list by the names of their G-code."""
    found = {}
    for text in read_text(path, wanted="a list of bodies", todo="name another folder").splitlines():
        try:
            line = json.loads(text)
            found[str(line["gcode"])] = {"source": line["source"], "licence": line["licence"]}
        except (ValueError, KeyError, TypeError):  # cut short, or a list of before
            continue
    return found
