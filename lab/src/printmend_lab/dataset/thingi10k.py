"""Bodies of Thingi10K (Zhou and Jacobson, arXiv:1605.04797): by its authors' library, or from a folder of its files.

The library fetches the data set from its hub once and keeps it. Without a network a folder of its files serves as any
folder of meshes does: FILE_ID.stl, or the FILE_ID.npz that the library keeps (`vertices`, `facets`). A file
`licences.json` beside bodies, {"name without suffix": "licence", …}, says what each may be used for.
"""

import json
import re
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from pathlib import Path
from tokenize import TokenError

import numpy as np

from printmend.errors import InputError, MeshError
from printmend.files import read_text, replacing
from printmend_lab.body.solid import Solid, stl_bytes

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
    return _licences(path.parent, _changed(path.parent)).get(path.stem)


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


def _changed(folder: Path) -> int:
    path = folder / LICENCES
    return path.stat().st_mtime_ns if path.is_file() else 0


def _note(folder: Path, licences: dict[str, str]) -> None:
    _licences.cache_clear()  # clocks of file systems are coarse: what was written last may seem no newer
    known = _licences(folder, _changed(folder))
    with replacing(folder / LICENCES) as file:
        file.write(json.dumps({**known, **licences}, indent=1) + "\n")
    _licences.cache_clear()
