"""Inspect an existing data set: its contents, whether it is whole, and a copy of a published one."""

import http.client
import shutil
import urllib.parse
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from printmend.errors import InputError, TraceError
from printmend.files import replacing
from printmend_lab.dataset.build import Recipe, changed_corruptions, read_checksums, read_recipe
from printmend_lab.dataset.parquet import (
    BODIES,
    BODY_COLUMNS,
    FAILURES,
    PRINT_COLUMNS,
    RECIPE,
    body_file,
    body_files_of,
    corruption_file,
    digest_of,
    faults_of,
    files_of,
    print_file,
    read_body,
    read_lines,
    read_print,
)

REPLAYED = 8  # prints that `verify_dataset` makes again on the twin


@dataclass(frozen=True)
class Contents:
    """What a data set holds; ``bytes_a_value`` is the size of the files that are there over rows and columns."""

    recipe: Recipe
    bodies: int
    failures: int
    layers: int
    points: int
    prints: int
    size_bytes: int
    bytes_a_value: float
    licences: tuple[str, ...]


def contents(root: Path) -> Contents:
    """Return what a data set holds. Raise `InputError` for a folder that holds none."""
    recipe, lines = read_recipe(root), read_lines(Path(root) / BODIES)
    points = sum(line["points"] for line in lines)
    size = sum(
        (Path(root) / name).stat().st_size
        for line in lines
        for name in files_of(line, BODIES)
        if (Path(root) / name).is_file()
    )
    columns = len(BODY_COLUMNS) + len(PRINT_COLUMNS) * recipe.corruptions
    values = points * columns
    return Contents(
        recipe=recipe,
        bodies=len(lines),
        failures=len(read_lines(Path(root) / FAILURES)),
        layers=sum(line["layer_count"] for line in lines),
        points=points,
        prints=len(lines) * recipe.corruptions,
        size_bytes=size,
        bytes_a_value=size / values if values else 0.0,
        licences=tuple(sorted({line["licence"] for line in lines})),
    )


def verify_dataset(root: Path, *, tick: Callable[[str], None] = lambda name: None) -> list[str]:
    """Check every file's checksum, and print a sample again on the twin; return what is wrong, in words."""
    from printmend.corruption import read_corruption
    from printmend.printer import read_printer
    from printmend.twin import Twin

    root, recipe = Path(root), read_recipe(root)
    lines, wrong, whole = read_lines(root / BODIES), changed_corruptions(root), []
    for line in lines:
        try:
            found = faults_of(root, files_of(line, BODIES), body_files_of(root, line["body"], recipe.corruptions))
        except (InputError, KeyError) as error:
            found = [str(error) if isinstance(error, InputError) else f"{BODIES}: a line without {error}"]
        wrong += found
        if not found:
            whole.append(line["body"])
        tick(str(line.get("body")))
    rng = np.random.default_rng(recipe.seed)
    for at in rng.permutation(len(whole))[:REPLAYED]:
        name, number = whole[at], int(rng.integers(recipe.corruptions))
        try:
            body, printed = read_body(body_file(root, name)), read_print(print_file(root, name, number))
            corruption = read_corruption(corruption_file(root, number))
        except InputError as error:  # a corruption that is missing is in the list already
            wrong += [str(error)] if isinstance(error, TraceError) else []
            continue
        twin = Twin.of(corruption, read_printer(recipe.printer))
        again = [twin.run(layer.controls, layer.start_steps).astype(np.float32) for layer in body.layers]
        if len(again) != len(printed) or not all(map(np.array_equal, again, printed)):
            wrong.append(f"{print_file(root, name, number).relative_to(root)}: the twin prints something else")
    return wrong


def fetch_list(source: str, root: Path) -> int:
    """Copy the lists of a published data set from a folder or an http(s) address; return its number of bodies.

    Raises `InputError` if there is none, or if ``root`` holds something else.
    """
    root = Path(root)
    if root.exists() and (not root.is_dir() or (any(root.iterdir()) and not (root / BODIES).exists())):
        raise InputError(root, wanted="a new or empty folder", came="one that holds something", todo="name another")
    for name in (BODIES, RECIPE):  # the list first: a folder that holds it can be continued
        _fetch(source, root, name)
    return len(read_lines(root / BODIES))


def fetch_dataset(source: str, root: Path, *, tick: Callable[[str], None] = lambda name: None) -> int:
    """Copy a published data set from a folder or an http(s) address, checking every file; return how many came.

    Files that are there already with the right checksum stay, so that an interrupted fetch goes on. Raises `InputError`
    for a file that is missing or is not the one in the list.
    """
    root = Path(root)
    fetch_list(source, root)
    known, came = read_checksums(root), 0
    for number in range(read_recipe(root).corruptions):
        name = corruption_file(Path(), number).as_posix()
        came += _fetch_checked(source, root, name, known.get(name))
    for line in read_lines(root / BODIES):
        came += sum(_fetch_checked(source, root, name, digest) for name, digest in files_of(line, BODIES).items())
        tick(line["body"])
    return came


def _fetch_checked(source: str, root: Path, name: str, digest: str | None) -> bool:
    """Copy a file unless the one with this checksum is there; say whether one of a known checksum came."""
    path = root / name
    if path.is_file() and digest_of(path) == digest:
        return False
    _fetch(source, root, name)
    if digest is not None and digest_of(path) != digest:
        path.unlink()
        raise InputError(name, wanted="the file in the list", came="another", todo="ask its publisher")
    return digest is not None


def _fetch(source: str, root: Path, name: str) -> None:
    try:
        with _opened(source, name) as stream:
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            with replacing(root / name, "wb") as file:
                shutil.copyfileobj(stream, file)
    except (OSError, ValueError, http.client.HTTPException) as error:
        raise InputError(f"{source} {name}", wanted="a published data set", came=f"{error}", todo="check it") from None


def _opened(source: str, name: str) -> Any:
    if urllib.parse.urlparse(source).scheme in ("http", "https"):
        address = source.rstrip("/") + "/" + urllib.parse.quote(name)
        return urllib.request.urlopen(address, timeout=60)  # noqa: S310 (http only)
    return (Path(source) / name).open("rb")
