"""A row's result on a suite as a file, its check, and the leaderboard made of such files."""

import json
import math
from pathlib import Path
from typing import Any

from printmend.errors import InputError
from printmend.files import read_text, replacing
from printmend_lab.bench.report import markdown_table
from printmend_lab.bench.suites import SUITES, Suite, suite

_FIELDS = {
    "suite": str, "checksum": str, "row": str, "metrics": dict, "cost": dict, "versions": dict, "cases": dict,
}  # fmt: skip
_ALIKE = 1e-9  # of figures that are made again from the cases, as a share
_MOST_BYTES = 8_000_000
_WRONG = "a result of `printmend bench suite`"


def write_result(record: dict[str, Any], folder: Path) -> Path:
    """Write a row's result to FOLDER/SUITE/ROW.json and return its path."""
    place = "".join(mark if mark.isalnum() or mark in "+-." else "_" for mark in record["row"])
    path = Path(folder) / record["suite"].rpartition("/")[2] / f"{place}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as file:
        file.write(json.dumps(record, indent=1, sort_keys=True) + "\n")
    return path


def check_submission(path: Path) -> dict[str, Any]:
    """Read a row's result and check it: fields, suite and checksum, a number a case, figures that follow from them.

    Raises `InputError` with the first thing that is wrong. No number is made again here: `printmend bench suite` does.
    """
    todo = "write it again with `printmend bench suite`"
    text = read_text(path, wanted=_WRONG, todo=todo)
    if len(text) > _MOST_BYTES:
        raise InputError(path, wanted=_WRONG, came=f"{len(text)} characters", todo=todo)
    try:
        record = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(path, wanted=_WRONG, came=f"{error}", todo=todo) from None
    if not isinstance(record, dict):
        raise InputError(path, wanted=_WRONG, came="something else", todo=todo)
    for name, kind in _FIELDS.items():
        if not isinstance(record.get(name), kind):
            raise InputError(path, wanted=f"a field {name!r}", came=f"{type(record.get(name)).__name__}", todo=todo)
    chosen = suite(record["suite"])
    if record["checksum"] != chosen.checksum:
        came = record["checksum"][:16]
        raise InputError(path, wanted=f"the checksum {chosen.checksum[:16]} of {chosen.name}", came=came, todo=todo)
    if len(record["cases"]) != chosen.count:
        came = str(len(record["cases"]))
        raise InputError(path, wanted=f"all {chosen.count} cases of {chosen.name}", came=came, todo=todo)
    for key, pair in record["cases"].items():
        if not (isinstance(pair, list) and len(pair) == 2 and all(_is_error(value) for value in pair)):
            raise InputError(path, wanted=f"two errors of case {key}", came=repr(pair)[:60], todo=todo)
    if not all(isinstance(record["versions"].get(name), str) for name in ("printmend", "python", "numpy")):
        raise InputError(path, wanted="versions of printmend, python and numpy", came="fewer", todo=todo)
    if not all(value is None or _is_number(value) for value in record["cost"].values()):
        raise InputError(path, wanted="costs in seconds", came=repr(record["cost"])[:60], todo=todo)
    for name, value in chosen.figures(record["cases"]).items():
        said = record["metrics"].get(name)
        if value != said and (value is None or not _is_number(said) or abs(value - said) > _ALIKE * abs(value)):
            raise InputError(path, wanted=f"a {name} of {value}, as its cases say", came=f"{said}", todo=todo)
    return record


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_error(value: object) -> bool:
    return value is None or (_is_number(value) and value >= 0)  # type: ignore[operator]


def leaderboard(folder: Path) -> str:
    """Return the page of all results below a folder, best row first in each suite. Raise `InputError` for a bad one."""
    records = [check_submission(path) for path in sorted(Path(folder).glob("*/*.json"))]
    texts = [_HEAD]
    for chosen in SUITES.values():
        mine = [record for record in records if record["suite"] == chosen.name]
        mine.sort(key=lambda record: _rank(record, chosen.metrics[0]))
        texts.append(f"## {chosen.name}\n\n{chosen.about} {chosen.count} cases, checksum `{chosen.checksum[:16]}`.\n")
        columns = ("row", *(_TITLES.get(name, name) for name in chosen.metrics), "learn s", "plan s", "printmend")
        texts.append(markdown_table(columns, [_line(record, chosen) for record in mine]) if mine else "No row yet.\n")
    return "\n".join(texts)


def _rank(record: dict[str, Any], name: str) -> tuple[bool, float, str]:
    figure = record["metrics"][name]
    return figure is None or record["metrics"]["failures"] > 0, figure or 0.0, record["row"]


_TITLES = {"mean": "mean, steps", "ratio": "÷ optimum", "failures": "failed"}
_HEAD = """# Leaderboard

Rows on suites that do not change: RMSE in full steps of 0.2 mm on simulated printers, and on measured data the error
that is left of a straight line's. A row is LEARNER or LEARNER+CONTROLLER, as in [the tables](researchers.md).
`printmend bench suite` writes a row's file, `printmend bench submit-check` checks it. This page is made of the files in
`docs/leaderboard`, each with its versions and every case. Rows with a failed case stand last.

```sh
printmend bench suite printmend/Families-v1 --rows greybox+optimal -o results
printmend bench submit-check results/Families-v1/greybox+optimal.json
```
"""


def _line(record: dict[str, Any], chosen: Suite) -> tuple[str, ...]:
    def text(value: float | None, digits: int = 3) -> str:
        return "–" if value is None else f"{value:.{digits}f}"

    figures, cost = record["metrics"], record["cost"]
    numbers = [text(figures[name]) for name in chosen.metrics[:-1]]
    return (
        f"`{record['row'].replace('|', ' ')}`", *numbers, str(figures["failures"]), text(cost.get("learn_s")),
        text(cost.get("plan_s")), record["versions"]["printmend"].replace("|", " "),
    )  # fmt: skip
