"""Make the technical report: docs/report/report.typ with every figure from a results file, as PDF.

.venv/bin/python tools/report.py            # docs/report/printmend.pdf
.venv/bin/python tools/report.py --figures  # the figures by name, as JSON

docs/report/figures.toml says of each name where its figure is from: a file of results, which of its rows, which column,
and how many digits. A name without a figure, a figure without a name, and rows that are not there stop it.
"""

import argparse
import csv
import io
import json
import statistics
import tomllib
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from printmend.errors import InputError
from printmend.files import replacing

ROOT = Path(__file__).parents[1]
FOLDER = "docs/report"
_SHORT = 110  # letters of a command in the list of sources
HOW: dict[str, Callable[[Sequence[float]], float]] = {
    "max": max, "min": min, "mean": statistics.fmean, "median": statistics.median, "sum": sum, "count": len,
    "geomean": statistics.geometric_mean,
}  # fmt: skip


def figures(root: Path = ROOT) -> dict[str, Any]:
    """Return what the report reads: `figures` {name: text}, `tables` {name: rows of text}, `sources` of the files."""
    spec = tomllib.loads((root / FOLDER / "figures.toml").read_text(encoding="utf-8"))
    found = {name: figure(root, name, item) for name, item in spec["figure"].items()}
    tables = {name: table(root, name, item) for name, item in spec["table"].items()}
    items = [*spec["figure"].values(), *spec["table"].values()]
    files = sorted({name for item in items for name in files_of(item)})
    heads = {name: item["columns"] for name, item in spec["table"].items()}
    return {"figures": found, "tables": tables, "heads": heads, "sources": [source(root, name) for name in files]}


def files_of(item: dict[str, Any]) -> list[str]:
    """Return the files that a figure or a table reads; {row} in a name stands for each row of a table."""
    return [item["file"].format(row=word(row)[0]) for row in item.get("rows", [""])] if "file" in item else []


def word(row: str | list[str]) -> tuple[str, str]:
    """Return what a row is called in its file, and in the report."""
    return (row, row) if isinstance(row, str) else (row[0], row[1])


def figure(root: Path, name: str, item: dict[str, Any]) -> str:
    """Return one figure as text."""
    if "within_sd" in item:  # the share of a normal law within so many standard deviations
        return said(2 * statistics.NormalDist().cdf(item["within_sd"]) - 1, item)
    if "constant" in item:
        module, _, attribute = item["constant"].partition(":")
        value: Any = import_module(module)
        for part in attribute.split("."):
            value = value[part] if isinstance(value, dict) else getattr(value, part)
        return said(float(value), item)
    if item["file"].endswith(".json"):
        found = json.loads((root / item["file"]).read_text(encoding="utf-8"))
        for part in item["key"].split("."):
            found = found[part]
        return said(float(found), item)
    return said(combined(name, chosen(root, name, item), item), item)


def table(root: Path, name: str, item: dict[str, Any]) -> list[list[str]]:
    """Return a table's rows: one for each of ``rows``, a cell for each of ``columns``."""
    lines = []
    for row in item["rows"]:
        called, shown = word(row)
        cells = []
        for column in item["columns"]:
            one = {**item, "file": item["file"].format(row=called)}
            if "key" in item:  # a JSON file for each row
                one["key"] = item["key"].format(column=column)
            elif "column" in item:  # a pivot: what a column of the file says decides the cell
                one["where"] = {**item.get("where", {}), item["row"]: called, item["column"]: column}
            else:
                one |= {"where": {**item.get("where", {}), item["row"]: called}, "value": column}
            cells.append(figure(root, name, one))
        lines.append([shown, *cells])
    return lines


def chosen(root: Path, name: str, item: dict[str, Any]) -> list[dict[str, str]]:
    """Return the rows of a results file whose cells are those that are wanted. Raise `InputError` for none."""
    path = root / item["file"]
    where = {key: value if isinstance(value, list) else [value] for key, value in item.get("where", {}).items()}
    lines = read(path)
    needed = {*where, *(item[name] for name in ("value", "over") if name in item)}
    if missing := sorted(needed - set(lines[0])):
        raise InputError(path, wanted=f"a column {missing[0]} for {name}", came="none", todo=f"correct {FOLDER}")
    rows = [row for row in lines if all(row[key] in value for key, value in where.items())]
    if not rows or (len(rows) > 1 and "how" not in item):
        raise InputError(path, wanted=f"a row for {name}: {where}", came=f"{len(rows)}", todo=f"correct {FOLDER}")
    return rows


def read(path: Path) -> list[dict[str, str]]:
    """Return the rows of a results file."""
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return list(csv.DictReader(io.StringIO("\n".join(lines))))


def combined(name: str, rows: Sequence[dict[str, str]], item: dict[str, Any]) -> float:
    """Return what is made of a column's cells; ``over`` divides each, ``part`` takes one of several in a cell."""
    values = []
    for row in rows:
        cells = [row[item["value"]]] if "part" not in item else row[item["value"]].split(item.get("between", ","))
        wanted = cells if item.get("part") == "all" else [cells[item.get("part", 0)]]
        for cell in wanted:
            try:
                value = float(cell.strip().rstrip("%"))
            except ValueError:
                raise InputError(name, wanted="a number", came=repr(cell), todo=f"correct {FOLDER}") from None
            values.append((value / float(row[item["over"]]) if "over" in item else value) - item.get("less", 0))
    return float(HOW[item.get("how", "sum")](values))


def said(value: float, item: dict[str, Any]) -> str:
    """Return a number with its digits, times ``times``."""
    return f"{value * item.get('times', 1):.{item.get('digits', 0)}f}"


def source(root: Path, name: str) -> dict[str, str]:
    """Return a results file's first command, shortened, and the versions of the code that its figures came in with."""
    text = (root / name).read_text(encoding="utf-8")
    if name.endswith(".json"):
        record = json.loads(text)
        command = f"printmend bench suite {record['suite']} --rows {record['row']} -o results"
        return {"file": name, "command": command, "commit": record["versions"]["printmend"]}
    head = [line[2:].partition(": ") for line in text.splitlines() if line.startswith("# ")]
    command = next((rest for word, _, rest in head if word == "command"), "")
    short = command if len(command) <= _SHORT else command[:_SHORT] + " …"
    return {"file": name, "command": short, "commit": "; ".join(rest for word, _, rest in head if word == "commit")}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figures", action="store_true")
    options = parser.parse_args()
    found = figures()
    if options.figures:
        print(json.dumps(found, indent=1, ensure_ascii=False))
        return
    import typst

    place = ROOT / FOLDER
    with replacing(place / "figures.json") as file:
        file.write(json.dumps(found, ensure_ascii=False))
    with replacing(place / "printmend.pdf", "wb") as file:
        file.write(typst.compile(place / "report.typ", root=ROOT / "docs"))


if __name__ == "__main__":
    main()
