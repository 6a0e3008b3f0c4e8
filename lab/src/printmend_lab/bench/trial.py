"""Try the rows of a table on one case: set it up, then measure, learn, plan, print and judge. The tables share this."""

import importlib
import math
import time
from collections.abc import Hashable, Mapping
from typing import Any, Protocol

from printmend.errors import PrintmendError
from printmend.extras import missing_extra
from printmend_lab.bench.case import Case, Result
from printmend_lab.executor import program_version

# The module of each table has ``set_up(case) -> Stand`` and ``read_row(name)``; both may raise `PrintmendError`.
TABLES = {
    "table1": "printmend_lab.bench.table1",
    "families": "printmend_lab.bench.families",
    "prints": "printmend_lab.bench.prints",
    "objectives": "printmend_lab.bench.objectives",
    "real": "printmend_lab.bench.real.real",
    "measured": "printmend_lab.bench.measured.measured",
}


class TableRow(Protocol):
    """What a row's name says; rows of one ``lesson`` share what was learned."""

    @property
    def lesson(self) -> Hashable: ...


class Stand(Protocol):
    """A case that is set up for trial."""

    def measure(self, row: Any) -> Any:
        """Return what the row's learner is shown."""
        ...

    def fit(self, measured: Any, row: Any) -> Any:
        """Return the model that the row's learner makes of it; this is timed."""
        ...

    def judge(self, model: Any, row: Any) -> dict[str, Any]:
        """Print with the model and return the figures."""
        ...


def evaluate(case: Case, rows: tuple[str, ...]) -> list[Result]:
    """Return a result for each row. What fails is a result that says why, not an exception."""
    read_row = importlib.import_module(TABLES[case.table]).read_row
    return evaluate_rows(case, {name: read_row(name) for name in rows})


def evaluate_rows(case: Case, rows: Mapping[str, TableRow]) -> list[Result]:
    """Do so for rows that need not be registered, by name."""
    try:
        stand: Stand = importlib.import_module(TABLES[case.table]).set_up(case)
    except Exception as error:  # a fault of another package may raise anything
        return [failed(case, name, _reason(error)) for name in rows]
    learned: dict[Hashable, tuple[Any, float]] = {}
    return [_evaluate_row(stand, case, name, row, learned) for name, row in rows.items()]


def failed(case: Case, row: str, reason: str) -> Result:
    """Return the result of what could not be evaluated."""
    return Result(case, row, error=reason, code=program_version())


def _reason(error: Exception) -> str:
    """Return in one line why a row failed."""
    if isinstance(error, ImportError):
        error = missing_extra(error) or error
    said = str(error) if isinstance(error, PrintmendError) else f"{type(error).__name__}: {error}"
    return " ".join(said.split())  # one line, whatever a plug-in says


def _evaluate_row(
    stand: Stand, case: Case, name: str, row: TableRow, learned: dict[Hashable, tuple[Any, float]]
) -> Result:
    try:
        if row.lesson not in learned:
            measured = stand.measure(row)
            begun = time.perf_counter()
            learned[row.lesson] = stand.fit(measured, row), time.perf_counter() - begun
        model, learn_s = learned[row.lesson]
        values = {**stand.judge(model, row), "learn_s": learn_s}
    except Exception as error:  # one learner's trouble with one body must not end a run of days
        return failed(case, name, _reason(error))
    wrong = [what for what, value in values.items() if isinstance(value, float) and not math.isfinite(value)]
    if wrong:
        return failed(case, name, f"{wrong[0]} is not finite")
    return Result(case, name, values, code=program_version())
