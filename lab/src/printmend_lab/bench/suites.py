"""Suites with names and versions: cases that never change, and a row's result on them as a file for the leaderboard.

A suite is frozen by a checksum over its cases and the metrics. Cases are faults and bodies that a seed draws, or
measured data and their split. What changes any of these needs a new version; a program that draws something else
refuses to run the old one.
"""

import hashlib
import importlib.metadata
import json
import math
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from printmend.errors import ConfigError, InputError
from printmend.files import read_text, replacing
from printmend.machine import Mechanism
from printmend.printer import read_printer
from printmend_lab.bench import families, measured, table1
from printmend_lab.bench.case import OPTIMUM, Case, Result, row, run
from printmend_lab.bench.report import markdown_table
from printmend_lab.body.slicer import profile_text
from printmend_lab.dataset.bodies import body_files
from printmend_lab.executor import HERE, Executor, program_version
from printmend_lab.sampling import fault

METRICS = ("mean", "median", "p95", "ratio", "failures")
MEASURED_METRICS = ("share", "median", "worst", "failures")  # of what a straight line misses; share is a geometric mean
_LIBRARIES = ("numpy", "numba", "lightgbm", "scikit-learn", "scipy")
_LEAST_SHARE = 1e-9  # of a prediction that misses nothing
# Tables are compared to this many mm, at every so manyth entry: machines differ in the last digits of a sine.
_TABLE_MM, _TABLE_STRIDE, _OFF_ROUND = 1e-3, 37, 0.3717


@dataclass(frozen=True)
class Suite:
    """``count`` cases that ``draw`` makes, with a folder for bodies; ``checksum`` is theirs when they were frozen.

    A row that measures has noise of ``noise_mm`` a coordinate. Where ``measured``, the folder holds measured data and
    a row is a learner alone: nothing is planned, and a straight line takes the place of the optimum.
    """

    name: str
    about: str
    draw: Callable[[Path], list[Case]]
    noise_mm: float
    count: int
    checksum: str
    measured: bool = False

    def label(self, name: str) -> str:
        """Return a row's name with the suite's noise, where it measures. Raise `InputError` for one that is none."""
        if self.measured:
            if "+" in name:
                todo = f"ask for {name.partition('+')[0]}: nothing is planned here"
                raise InputError(self.name, wanted="rows that are learners alone", came=repr(name), todo=todo)
            measured.read_row(name)
            return name
        label = f"{name}@{self.noise_mm:g}" if self.noise_mm and families.measures(name) else name
        row(label)
        return label

    @property
    def beside(self) -> str:
        """The row that every other is compared with."""
        return measured.NAIVE if self.measured else self.label(OPTIMUM)

    @property
    def metrics(self) -> tuple[str, ...]:
        """The names of a row's figures, the first of which ranks it."""
        return MEASURED_METRICS if self.measured else METRICS

    def figures(self, values: dict[str, list[float | None]]) -> dict[str, float | int | None]:
        """Return a row's figures over its cases {key: [its error, that of the row beside it]}; None failed."""
        return (shares if self.measured else metrics)(values)


def _table1(folder: Path) -> list[Case]:
    files = body_files(["generated:100"], made=folder / "generated", seed=0)
    return table1.draw_cases(
        files, protocol="heldout", families=("pulley",), severity="paper", seed=0, sliced=folder / "sliced"
    )


def _families(folder: Path) -> list[Case]:
    names = [name for name in families.FAMILIES if "screw" not in name.replace("set-screw", "")]
    return families.draw_family_cases(names, coverages=(1.0,), samples=2, seed=families.TEST_SEED)


def _measured(folder: Path) -> list[Case]:
    cases, absent = measured.measured_cases(folder, _MEASURED)
    if absent:
        one = absent[0]
        raise InputError(
            folder, wanted=f"the measured set {one.name} at {one.place} ({one.licence})", came="none",
            todo=f"in that folder: {one.fetch}",
        )  # fmt: skip
    return [case for case in cases if case.body not in _UNSEALED]


_MEASURED = ("pulleys", "encoder")
_UNSEALED = {f"{shape} {speed}" for shape in ("rec", "tri") for speed in (40, 80, 120)}  # in a clone of the pulleys

SUITES = {
    suite.name: suite
    for suite in (
        Suite(
            "printmend/TableI-v1",
            "The paper's Table I: 100 bodies made from seed 0, pulleys of the paper's severity, held-out layers.",
            _table1, 0.0, 100, "f5140e6141be379d0e89702c1c2859ea018856136699d9d9077453673057c22a",
        ),
        Suite(
            "printmend/Families-v1",
            "Every planar family, damaged and realistic, two faults of each, a body one turn across, 0.05 mm of noise.",
            _families, 0.05, 104, "a348de9ae1b61aff9db1819408b946e42f602c3a4576347173fb3a4c47c20990",
        ),
        Suite(
            "printmend/Measured-v1",
            "Nine runs of a belt printer with printed pulleys, and a stepper's encoder. Each figure is a learner's"
            " error on the part that it did not see, divided by that of a straight line.",
            _measured, 0.0, 10, "7773f89cc7e7e4545b4edb687f11270fc750d99d053a90a8e54a5673cba0c83e", measured=True,
        ),
    )
}  # fmt: skip


def suite(name: str) -> Suite:
    """Return the suite of that name. Raise `ConfigError` where there is none."""
    if name not in SUITES:
        raise ConfigError("suite", wanted=f"one of {', '.join(SUITES)}", came=repr(name), todo="correct the name")
    return SUITES[name]


def frozen_cases(chosen: Suite, folder: Path) -> dict[str, Case]:
    """Return a suite's cases by their keys. Raise `InputError` where they are not those that were frozen."""
    cases = chosen.draw(folder)
    if (found := checksum(cases, measured=chosen.measured)) != chosen.checksum:
        raise InputError(
            chosen.name, wanted=f"cases with the checksum {chosen.checksum[:16]}", came=found[:16],
            todo="use the printmend, numpy and manifold3d of its results, or a newer version of the suite",
        )  # fmt: skip
    return {case.key("case"): case for case in cases}


def checksum(cases: Sequence[Case], *, measured: bool = False) -> str:
    """Return a SHA-256 over cases, the faults and bodies that are drawn for them, and the metrics.

    The key of a measured case is over its data and the words of its split already.
    """
    total = hashlib.sha256(json.dumps(MEASURED_METRICS if measured else METRICS).encode())
    for case in cases:
        total.update(case.key("case").encode())
        for part in () if measured else _drawn(case):
            total.update(part)
    return total.hexdigest()


def _drawn(case: Case) -> list[bytes]:
    """Return what the seed draws for a case, as bytes that are alike on every machine."""
    printer: Any = read_printer(case.printer)
    if case.table == families.TABLE:
        drawn, body = families.corruption_of(case), families.body_of(case, printer)
        parts = [layer.controls.tobytes() for layer in body.layers]
    else:
        drawn = fault(case.family, case.rng(table1.CORRUPTION), case.severity)  # type: ignore[arg-type]
        parts = [profile_text().encode()]  # a body in a file is known by its digest, its layers by how it is sliced
    mechanism = drawn.lower(printer)
    if isinstance(mechanism, Mechanism):
        for table in mechanism.transmissions:
            for branch in (table.lower_mm, table.upper_mm):
                values = np.floor(branch[::_TABLE_STRIDE] / _TABLE_MM + _OFF_ROUND).astype(np.int64)
                parts.append(values.tobytes())
    return parts


def run_suite(
    chosen: Suite, name: str, folder: Path, *, data: Path | None = None, executor: Executor = HERE,
    tick: Callable[[str], None] = lambda case: None,
) -> dict[str, Any]:  # fmt: skip
    """Run a row on a suite; return what `submission.check_submission` wants: figures, cost, versions, every case.

    ``folder`` keeps results and bodies; ``data`` holds measured sets, where the suite wants them.
    """
    names = [chosen.label(name), chosen.beside]
    cases = frozen_cases(chosen, folder if data is None else data)
    results = run(list(cases.values()), names, folder, executor, tick=tick)
    found = {(item.case, item.row): item for item in results}
    mine = {key: found[case, names[0]] for key, case in cases.items()}
    best = {key: found[case, names[1]] for key, case in cases.items()}
    values = {key: [_error(mine[key]), _error(best[key])] for key in cases}
    why = {key: result.error for key, result in mine.items() if result.error is not None}
    return {
        "suite": chosen.name,
        "checksum": chosen.checksum,
        "row": name,
        "metrics": chosen.figures(values),
        "cost": {"learn_s": _median(mine, "learn_s"), "plan_s": _median(mine, "plan_s")},
        "versions": versions(),
        "cases": values,
        **({"failures": why} if why else {}),
    }


def metrics(values: dict[str, list[float | None]]) -> dict[str, float | int | None]:
    """Return the figures of a row over its cases {key: [RMSE, the optimum's]} in full steps; None failed."""
    pairs = [(mine, best) for mine, best in values.values() if mine is not None]
    failures = len(values) - len(pairs)
    if not pairs:
        return dict.fromkeys(METRICS[:-1]) | {"failures": failures}
    errors = np.array([mine for mine, _ in pairs])
    both = np.array([(mine, best) for mine, best in pairs if best is not None])
    ratio = float(both[:, 0].mean() / both[:, 1].mean()) if len(both) and both[:, 1].mean() > 0 else None
    numbers = (float(errors.mean()), float(np.median(errors)), float(np.percentile(errors, 95)), ratio, failures)
    return dict(zip(METRICS, numbers, strict=True))


def shares(values: dict[str, list[float | None]]) -> dict[str, float | int | None]:
    """Return the figures of a row over measured sets {key: [missed, missed by a straight line]}; None failed."""
    pairs = [(mine, line) for mine, line in values.values() if mine is not None and line]
    failures = len(values) - len(pairs)
    if not pairs:
        return dict.fromkeys(MEASURED_METRICS[:-1]) | {"failures": failures}
    found = np.array([mine / line for mine, line in pairs])
    mean = float(np.exp(np.log(np.maximum(found, _LEAST_SHARE)).mean()))
    numbers = (mean, float(np.median(found)), float(found.max()), failures)
    return dict(zip(MEASURED_METRICS, numbers, strict=True))


def versions() -> dict[str, str]:
    """Return what made a result: the program, Python, libraries that are installed, and the machine."""
    found = {"printmend": program_version(), "python": platform.python_version(), "machine": platform.machine()}
    for name in _LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def _error(result: Result) -> float | None:
    name = "missed" if result.case.table == measured.TABLE else "rmse_steps"
    return None if result.error is not None else float(result.values[name])


def _median(results: dict[str, Result], name: str) -> float | None:
    values = [item.values[name] for item in results.values() if item.error is None and name in item.values]
    return float(np.median(values)) if values else None


# A row's result on a suite as a file, its check, and the leaderboard made of such files.

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

These rows compare learners on suites that do not change. On simulated printers, the figure is the RMSE in full steps of
0.2 mm; on measured data, it is the error divided by that of a straight line. A row is LEARNER or LEARNER+CONTROLLER, as
in [the tables](researchers.md). `printmend bench suite` writes a row's file, `printmend bench submit-check` checks it.
This page is generated from the files in `docs/leaderboard`, which have the versions and every case. Rows with a failed
case come last.

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
