"""Lists of bodies: files, folders and Thingi10K become files in a fixed order, each with its name and licence.

`manifest.csv` has a column `file`, a path from the list's folder, and any of `name` and `licence` (or `license`). It
may lie in a folder above. `licences.json`, {"name without suffix": "licence", …}, lies beside the bodies
(`dataset.thingi10k`). The G-code in a data set's own folder `sliced/` keeps what the set knows of its bodies.
"""

import csv
import hashlib
import io
import json
import re
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np

from printmend.errors import InputError, MeshError
from printmend.files import read_text, replacing
from printmend_lab.body.generated import generated_name, generated_solid
from printmend_lab.body.solid import Solid, stl_bytes
from printmend_lab.dataset.parquet import BODIES
from printmend_lab.path import Body

# Bodies of Thingi10K (Zhou and Jacobson, arXiv:1605.04797): by its authors' library, or from a folder of its files.
#
# The library fetches the data set from its hub once and keeps it. Without a network a folder of its files serves as any
# folder of meshes does: FILE_ID.stl, or the FILE_ID.npz that the library keeps (`vertices`, `facets`). A file
# `licences.json` beside bodies, {"name without suffix": "licence", …}, says what each may be used for.

NAME, LICENCES, UNKNOWN = "thingi10k", "licences.json", "unknown"
# What zipfile and numpy raise for a damaged npz file.
_DAMAGED = (
    OSError, EOFError, ValueError, KeyError, IndexError, SyntaxError, RuntimeError, TokenError, zipfile.BadZipFile,
    zlib.error,
)  # fmt: skip
MAX_ARRAY_BYTES = 256 * 2**20  # of a mesh's array; more is no body


def thingi10k_files(
    asked: str, made: Path, licence: str = UNKNOWN, left_out: Callable[[Path, str], None] | None = None
) -> list[Path]:
    """Return Thingi10K's bodies in the order of their numbers as STL below ``made``, their licences beside them.

    ``asked`` is `thingi10k`, or `thingi10k:N` for the first N. With a ``licence`` (other than unknown) only bodies
    whose own licence contains these words are returned. ``left_out`` is as in `unpacked`. Raises `InputError` if the
    data set cannot be had or nothing is left.
    """
    count = asked.removeprefix(NAME).removeprefix(":")
    if asked != NAME and not (count.isascii() and count.isdigit() and int(count) > 0):
        raise InputError(asked, wanted=f"{NAME} or {NAME}:N", came="another", todo="correct it")
    import thingi10k

    try:
        thingi10k.init(variant="npz")
        rows = list(thingi10k.dataset(license=None if licence == UNKNOWN else re.escape(licence)))
    except (RuntimeError, OSError, ValueError) as error:
        todo = "name a folder of its files with --bodies"
        raise InputError(NAME, wanted="the data set of its library", came=f"{error}", todo=todo) from None
    rows.sort(key=lambda row: int(row["file_id"]))
    rows = rows[: int(count)] if count else rows
    if not rows:
        raise InputError(NAME, wanted=f"bodies under “{licence}”", came="none", todo="name another licence")
    said = {Path(row["file_path"]): str(row["license"]) for row in rows}
    files = dict(unpacked(said, made, left_out))
    _note(made, {stl.stem: said[path] for path, stl in files.items()})
    return list(files.values())


def unpacked(
    paths: Iterable[Path], made: Path, left_out: Callable[[Path, str], None] | None
) -> Iterator[tuple[Path, Path]]:
    """Yield each npz file with its STL below ``made``; a damaged one goes to ``left_out``, or is raised without it."""
    for path in paths:
        try:
            yield path, as_stl(path, made)
        except MeshError as error:
            if left_out is None:
                raise
            left_out(path, str(error))


def as_stl(path: Path, made: Path) -> Path:
    """Write a mesh of Thingi10K's npz files as STL below ``made``, once. Raise `MeshError` if it holds no mesh."""
    out = made / f"{path.stem}.stl"
    if out.exists():
        return out
    try:
        with zipfile.ZipFile(path) as archive:
            if max(item.file_size for item in archive.infolist()) > MAX_ARRAY_BYTES:
                raise ValueError("arrays of more than 256 MB")
        with np.load(path, allow_pickle=False) as arrays:
            vertices, facets = np.asarray(arrays["vertices"], float), np.asarray(arrays["facets"], np.int64)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or facets.ndim != 2 or facets.shape[1] != 3:
            raise ValueError(f"vertices {vertices.shape} and facets {facets.shape}")
        data = stl_bytes(Solid(path.stem, vertices, facets))
    except _DAMAGED as error:
        wanted = "vertices [N, 3] and facets [M, 3] in an npz file of Thingi10K"
        raise MeshError(path, wanted=wanted, came=f"{error}", todo="fetch it again") from None
    made.mkdir(parents=True, exist_ok=True)
    with replacing(out, "wb") as file:
        file.write(data)
    said = licence_beside(path)
    if said is not None:
        _note(made, {path.stem: said})
    return out


def licence_beside(path: Path) -> str | None:
    """Return what `licences.json` in a body's folder says of it; None where it says nothing."""
    return _licences(path.parent, _changed_list(path.parent)).get(path.stem)


@lru_cache(maxsize=16)
def _licences(folder: Path, changed: int) -> dict[str, str]:
    path = folder / LICENCES
    if not changed:
        return {}
    todo = 'write {"name without suffix": "licence", …}'
    try:
        found = json.loads(read_text(path, wanted="licences by name", todo=todo))
        return {str(name): str(said) for name, said in found.items()}
    except (ValueError, AttributeError, RecursionError) as error:
        raise InputError(path, wanted="licences by name", came=f"{error}", todo=todo) from None


def _changed_list(folder: Path) -> int:
    path = folder / LICENCES
    return path.stat().st_mtime_ns if path.is_file() else 0


def _note(folder: Path, licences: dict[str, str]) -> None:
    _licences.cache_clear()  # clocks of file systems are coarse: what was written last may seem no newer
    known = _licences(folder, _changed_list(folder))
    with replacing(folder / LICENCES) as file:
        file.write(json.dumps({**known, **licences}, indent=1) + "\n")
    _licences.cache_clear()


MANIFEST, SLICED = "manifest.csv", "sliced"
_ABOVE = 4  # folders above a body's in which its manifest is looked for


@dataclass(frozen=True)
class Known:
    """A body's name, and its licence where one is known."""

    name: str
    licence: str | None = None


def known_of(path: Path) -> Known:
    """Return what is known of a body's file; without a list its name is the file's.

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


GENERATED, MAX_GENERATED = "generated:", 100_000
SUFFIXES = (
    ".stl", ".obj", ".3mf", ".ply",
    ".gcode", ".gco", ".g", ".nc", ".ngc", ".bgcode",
)  # fmt: skip


def body_files(
    paths: Iterable[str | Path],
    *,
    made: Path | None = None,
    seed: int = 0,
    licence: str = UNKNOWN,
    left_out: Callable[[Path, str], None] | None = None,
) -> list[Path]:
    """Return the meshes and G-code files given and those below the folders given, each once, sorted within a folder.

    With a folder ``made``, `generated:N` stands for the first N bodies that are made from a ``seed``
    (`body.generated`), and `thingi10k` or `thingi10k:N` for those of Thingi10K under a ``licence``. These, and
    Thingi10K's npz files in the folders given, are written to ``made`` as STL. ``left_out`` is called with each damaged
    npz file and the reason; without it such a file is a `MeshError`. With a ``licence``, bodies for which a
    `licences.json` beside them states another are left out. Raises `InputError` for a path that does not exist, and if
    nothing is found.
    """
    found: dict[Path, None] = {}
    damaged: list[str] = []

    def leave(path: Path, why: str) -> None:
        damaged.append(why)
        if left_out is not None:
            left_out(path, why)

    told = leave if left_out is not None else None
    asked = [Path(path) for path in paths]
    for path in asked:
        if made is not None and str(path).startswith(GENERATED):
            found.update(dict.fromkeys(_generated(str(path), made, seed)))
        elif made is not None and str(path).partition(":")[0] == NAME and not path.exists():
            found.update(dict.fromkeys(thingi10k_files(str(path), made, licence, told)))
        elif path.is_dir():
            inside = (item for item in path.rglob("*") if item.suffix.lower() in SUFFIXES and item.is_file())
            found.update(dict.fromkeys(sorted(inside)))
            if made is not None:
                packed = sorted(item for item in path.rglob("*.npz") if item.stem.isdigit())
                found.update(dict.fromkeys(stl for _, stl in unpacked(packed, made, told)))
        elif path.is_file():
            found[path] = None
        else:
            raise InputError(path, wanted="a body's file or a folder of them", came="no such path", todo="check it")
    if licence != UNKNOWN:
        found = {path: None for path in found if licence.lower() in (licence_beside(path) or licence).lower()}
    if not found:
        raise InputError(
            ", ".join(map(str, asked)) or "bodies",
            wanted=f"at least one body ({' '.join(SUFFIXES)})" + f" under “{licence}”" * (licence != UNKNOWN),
            came=f"{len(damaged)} damaged: {damaged[0]}" if damaged else "none",
            todo="name files or folders that hold some",
        )
    return list(found)


def _generated(text: str, folder: Path, seed: int) -> list[Path]:
    """Write the bodies that `generated:N` stands for, where they are not there yet."""
    count = text.removeprefix(GENERATED)
    if not (count.isascii() and count.isdigit() and 1 <= int(count) <= MAX_GENERATED):
        raise InputError(text, wanted=f"{GENERATED}1 to {GENERATED}{MAX_GENERATED}", came="another", todo="correct it")
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{generated_name(seed, number)}.stl" for number in range(int(count))]
    for number, path in enumerate(files):
        if not path.exists():
            solid = generated_solid(seed, number)
            with replacing(path, "wb") as file:
                file.write(stl_bytes(solid))
    return files


def digest(path: Path) -> str:
    """Return the first 16 hex digits of the SHA-256 of a file: a body's identity, whatever it is called."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:16]


def body_rng(seed: int, identity: str, purpose: int) -> np.random.Generator:
    """Return the random generator of one body: it depends on the seed, the body and the purpose, on no other body."""
    return np.random.default_rng([seed, int(identity, 16), purpose])


def thinned(body: Body, layers: int | None) -> Body:
    """Return the body with ``layers`` evenly spaced layers, the first and the last included; None keeps all."""
    if layers is None or layers >= len(body.layers):
        return body
    at = np.unique(np.rint(np.linspace(0, len(body.layers) - 1, layers)).astype(int))
    return Body(body.name, tuple(body.layers[i] for i in at))
