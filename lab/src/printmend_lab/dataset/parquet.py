"""The files of a data set: one for each body, one for each of its prints on a broken printer.

Both are Parquet with a row for each position of the nozzle on the lattice and a row group for each layer, so that row i
of a body is row i of each of its prints; `body`, `layer` and `tick` say so in each row, for those who join by keys. A
layer's first row is where it starts; every other row is one tick after the row before. The columns are in
`BODY_COLUMNS` and `PRINT_COLUMNS`. Whole numbers are stored as differences (DELTA_BINARY_PACKED), positions byte by
byte (BYTE_STREAM_SPLIT), names by a dictionary, all packed with zstd. The metadata of each file, JSON under the key
`printmend`, say what body it is, from which source, under which licence, how it was sliced, and where its layers are.

Are a data set's files those that were written?
"""

import hashlib
import io
import json
import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from printmend.errors import InputError, TraceError
from printmend.files import replacing
from printmend_lab.executor import Executor
from printmend_lab.path import Body, Layer

# Where things lie in a data set's folder, and its lists, a line of JSON a body.

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


SCHEMA = 2  # the version of the columns
READ = (1, SCHEMA)  # versions that are read; the first has neither `body` nor `tick`
KEY = b"printmend"  # of our metadata in a file
_ZSTD_LEVEL = 3  # higher ones take longer and save less than a percent
_DELTA, _SPLIT = "DELTA_BINARY_PACKED", "BYTE_STREAM_SPLIT"

# name → (type of Arrow, what it is)
_KEYS = {
    "body": ("string", "the body's name"),
    "layer": ("int32", "the layer's number, from 0"),
    "tick": ("int32", "the row's number in its layer, 0 where the layer starts"),
}
BODY_COLUMNS = {
    **_KEYS,
    "x_control": ("int8", "full steps of x commanded in the tick that leads here, −1, 0 or 1; 0 where a layer starts"),
    "y_control": ("int8", "the same of y"),
    "x_nominal": ("int32", "where a healthy printer's nozzle is, full steps of x from the lower corner of the bed"),
    "y_nominal": ("int32", "the same of y"),
    "extruding": ("bool", "whether plastic is laid down in the tick that leads here"),
}
PRINT_COLUMNS = {
    **_KEYS,
    "x_printed": ("float32", "where the broken printer's nozzle is, full steps of x"),
    "y_printed": ("float32", "the same of y"),
}

# The columns that are read back. A row group is a layer, its number and start are in the metadata, and nominal
# positions are sums.
_of_body, _of_print = ("x_control", "y_control", "extruding"), ("x_printed", "y_printed")


def write_body(path: Path, body: Body, about: dict[str, Any]) -> str:
    """Write a body and what is known ``about`` it; return the SHA-256 of the file."""
    parts = []
    for layer in body.layers:
        nominal, start = layer.nominal_steps, np.zeros((1, 2), np.int8)
        control = np.concatenate([start, layer.controls])
        extruding = np.concatenate([[False], layer.extruding])
        keys = _keys(about["body"], layer.index, len(nominal))
        parts.append([*keys, *control.T, *nominal.T.astype(np.int32), extruding])
    layers = [
        {"layer": item.index, "z_mm": item.z_mm, "rows": item.transitions + 1, "start_steps": item.start_steps.tolist()}
        for item in body.layers
    ]
    return _write(path, BODY_COLUMNS, parts, {**about, "layers": layers})


def write_print(path: Path, layers: Sequence[Layer], printed_steps: Sequence[np.ndarray], about: dict[str, Any]) -> str:
    """Write a body's printed positions [T + 1, 2] of every layer; return the SHA-256 of the file."""
    parts = [
        [*_keys(about["body"], layer.index, len(printed)), *printed.T.astype(np.float32)]
        for layer, printed in zip(layers, printed_steps, strict=True)
    ]
    return _write(path, PRINT_COLUMNS, parts, about)


def _keys(body: str, layer: int, rows: int) -> list:
    """Return the columns by which a body and its prints are joined."""
    return [np.full(rows, body, object), np.full(rows, layer, np.int32), np.arange(rows, dtype=np.int32)]


def read_columns(path: Path, rows: Sequence[int] | None = None) -> Any:
    """Return a file, or some of its row groups, as a table of Arrow. Raise `TraceError` if it is not Parquet."""
    import pyarrow as arrow
    from pyarrow import parquet

    read_about(path)
    try:
        with parquet.ParquetFile(path) as file:
            groups = range(file.num_row_groups)
            return file.read_row_groups(list(groups) if rows is None else [groups[row] for row in rows])
    except (OSError, arrow.ArrowException, IndexError) as error:
        raise _strange(path, f"{type(error).__name__}: {error}") from None


def read_body(path: Path, rows: Sequence[int] | None = None) -> Body:
    """Read a body, or only some of its row groups. Raise `TraceError` for a file that holds no body."""
    about, tables = _read(path, _of_body, rows)
    layers = []
    for group, columns in tables:
        place = about["layers"][group]
        if (start := place.get("start_steps")) is None:  # by printmend before the 22nd of November 2026
            ((_, nominal),) = _read(path, ("x_nominal", "y_nominal"), [group])[1]
            start = [nominal["x_nominal"][0], nominal["y_nominal"][0]]
        controls = _side_by_side(columns["x_control"][1:], columns["y_control"][1:])
        layers.append(Layer(place["layer"], place["z_mm"], np.array(start), controls, columns["extruding"][1:]))
    return Body(about["body"], tuple(layers))


def read_print(path: Path, rows: Sequence[int] | None = None) -> list[np.ndarray]:
    """Read the printed positions [T + 1, 2] of every layer, or of some row groups."""
    _, tables = _read(path, _of_print, rows)
    return [_side_by_side(columns["x_printed"], columns["y_printed"]) for _, columns in tables]


def _side_by_side(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return two columns [N] as one read-only array [N, 2], so that a `Layer` need not copy it."""
    both = np.empty((len(x), 2), x.dtype)
    both[:, 0], both[:, 1] = x, y
    both.setflags(write=False)
    return both


def read_about(path: Path) -> dict[str, Any]:
    """Return a file's metadata. Raise `TraceError` for a file that is not of this schema."""
    import pyarrow as arrow
    from pyarrow import parquet

    try:
        return _about(path, parquet.read_metadata(path).metadata)
    except (OSError, arrow.ArrowException) as error:
        raise _strange(path, f"{type(error).__name__}: {error}") from None


def _about(path: Path, metadata: dict[bytes, bytes] | None) -> dict[str, Any]:
    try:
        about = json.loads((metadata or {})[KEY])
        version = about["schema"]
    except (KeyError, ValueError, TypeError) as error:
        raise _strange(path, f"{type(error).__name__}: {error}") from None
    if version not in READ:
        raise TraceError(path, wanted=f"schema {SCHEMA}", came=f"schema {version}", todo="build or fetch it again")
    return dict(about)


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _write(path: Path, columns: dict[str, tuple[str, str]], parts: Sequence[list], about: dict[str, Any]) -> str:
    import pyarrow as arrow
    from pyarrow import parquet

    fields = [
        arrow.field(name, getattr(arrow, kind if kind != "bool" else "bool_")(), nullable=False, metadata={"is": text})
        for name, (kind, text) in columns.items()
    ]
    schema = arrow.schema(fields)
    encodings = {
        name: _SPLIT if kind == "float32" else _DELTA
        for name, (kind, _) in columns.items()
        if kind not in ("bool", "string")
    }
    words = [name for name, (kind, _) in columns.items() if kind == "string"]
    buffer = io.BytesIO()
    with parquet.ParquetWriter(
        buffer, schema, compression="zstd", compression_level=_ZSTD_LEVEL, use_dictionary=words,
        column_encoding=encodings, write_page_checksum=True, write_statistics=["layer"],
    ) as writer:  # fmt: skip
        for part in parts:
            arrays = [arrow.array(values, field.type) for values, field in zip(part, fields, strict=True)]
            writer.write_table(arrow.Table.from_arrays(arrays, schema=schema), row_group_size=max(len(part[0]), 1))
        # Not in Arrow's schema, all of which is decoded each time that the file is opened.
        writer.add_key_value_metadata({KEY: json.dumps({"schema": SCHEMA, **about})})
    data = buffer.getvalue()
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path, "wb") as file:
        file.write(data)
    return hashlib.sha256(data).hexdigest()


def _read(
    path: Path, columns: Sequence[str], rows: Sequence[int] | None
) -> tuple[dict[str, Any], list[tuple[int, dict[str, np.ndarray]]]]:
    """Return a file's metadata, and its row groups, or those of ``rows``, with their columns."""
    import pyarrow as arrow

    try:
        status = path.stat()
        file, about, sizes = _opened(path, status.st_mtime_ns, status.st_size, threading.get_ident())
        wanted = range(len(sizes)) if rows is None else [range(len(sizes))[row] for row in rows]
        table = file.read_row_groups(wanted, columns=list(columns), use_threads=False)
        values = {name: _array(table.column(name)) for name in columns}
    except (OSError, arrow.ArrowException, KeyError, IndexError) as error:
        raise _strange(path, f"{type(error).__name__}: {error}") from None
    ends = np.cumsum([0, *(sizes[group] for group in wanted)]).tolist()
    return about, [
        (group, {name: column[low:high] for name, column in values.items()})
        for group, low, high in zip(wanted, ends[:-1], ends[1:], strict=True)
    ]


def _array(column: Any) -> np.ndarray:
    """Return a column of Arrow as an array. Bits are unpacked by numpy, which does it several times faster."""
    if str(column.type) != "bool":
        return np.asarray(column.to_numpy())
    parts = []
    for chunk in filter(len, column.chunks):
        bits = np.frombuffer(chunk.buffers()[1], np.uint8)
        parts.append(np.unpackbits(bits, count=chunk.offset + len(chunk), bitorder="little")[chunk.offset :])
    return (parts[0] if len(parts) == 1 else np.concatenate([np.empty(0, np.uint8), *parts])).view(bool)


# Kept open, because the next layer that is read is mostly of the same body; each thread has its own reader.
@lru_cache(maxsize=8)
def _opened(path: Path, changed: int, size: int, thread: int) -> tuple[Any, dict[str, Any], list[int]]:
    """Return an open file, its metadata, and the rows of each of its row groups."""
    import pyarrow as arrow
    from pyarrow import parquet

    # A file in memory needs no read-ahead buffer, which further threads would fill.
    file = parquet.ParquetFile(arrow.memory_map(str(path)), pre_buffer=False)
    head = file.metadata
    return file, _about(path, head.metadata), [head.row_group(group).num_rows for group in range(head.num_row_groups)]


def _strange(path: Path, came: str) -> TraceError:
    return TraceError(path, wanted="a Parquet file of this data set", came=came, todo="build or fetch it again")


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
