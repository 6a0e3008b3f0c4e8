"""Read a body's commanded positions and where a broken printer put them, side by side."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from printmend.errors import InputError
from printmend_lab.dataset.build import read_recipe
from printmend_lab.dataset.parquet import BODIES, body_file, print_file, read_columns, read_lines

if TYPE_CHECKING:
    import pyarrow


def joined(root: Path | str, body: str, corruption: int, *, layers: Sequence[int] | None = None) -> "pyarrow.Table":
    """Return one body on one broken printer: a row for each position of its nozzle, in all layers or only the nth ones.

    The columns are those of a body and then those of its print (`BODY_COLUMNS`, `PRINT_COLUMNS`), with the keys `body`,
    `layer` and `tick` once. `table.to_pandas()` and `polars.from_arrow(table)` convert it. No key is compared: row i of
    a body is row i of each of its prints. Raises `InputError` for a printer that is not in the set, `TraceError` for
    damaged files.
    """
    root = Path(root)
    count = read_recipe(root).corruptions
    if not 0 <= corruption < count:
        raise InputError("corruption", wanted=f"0 to {count - 1}", came=f"{corruption}", todo="choose another")
    table, printed = (
        read_columns(path, layers) for path in (body_file(root, body), print_file(root, body, corruption))
    )
    if len(table) != len(printed) or not table["layer"].equals(printed["layer"]):
        came, todo = "others", "run `printmend dataset verify`"
        raise InputError(root, wanted=f"a print with the rows of {body}", came=came, todo=todo)
    for name in printed.column_names:
        if name not in table.column_names:
            table = table.append_column(printed.schema.field(name), printed[name])
    return table


def names(root: Path | str) -> Iterator[str]:
    """Yield the names of a data set's bodies, in the order of its list."""
    for line in read_lines(Path(root) / BODIES):
        yield line["body"]
