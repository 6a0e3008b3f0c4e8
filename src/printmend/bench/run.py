"""Run cases, keep their results, resume where a run was interrupted."""

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from printmend.bench.case import Result, evaluate, failed
from printmend.bench.executor import Executor, WorkerDied
from printmend.errors import InputError


@dataclass(frozen=True)
class _Task:
    case: Any
    rows: tuple[str, ...]


@dataclass(frozen=True)
class Table:
    """What the cases of a table are: importable functions and the class of their results.

    ``evaluate(case, rows)`` returns a result a row, ``failed(case, row, reason)`` the result of what could not be
    evaluated. A case has a ``source`` and a ``key(row)``; a result is a dataclass with that ``key``.
    """

    evaluate: Callable[[Any, tuple[str, ...]], list]
    failed: Callable[[Any, str, str], Any]
    result: type


TABLE1 = Table(evaluate, failed, Result)


def results_folder(out: Path) -> Path:
    """Return the folder for results, made where it was absent. Raise `InputError` where it cannot be."""
    out = Path(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(out, wanted="a folder for the results", came=f"{error}", todo="name another --out") from None
    return out


def run(
    cases: list,
    rows: tuple[str, ...],
    results_path: Path,
    executor: Executor,
    *,
    tick: Callable[[str], None] = lambda body: None,
    table: Table = TABLE1,
) -> list:
    """Evaluate every case for every row that is not in ``results_path`` yet; append each result as it comes.

    The file has one JSON object a line and may hold other runs' results; those of these cases and rows are returned,
    in their order. A line that an interruption cut short is dropped.
    """
    known = {result.key: result for result in read_results(results_path, table.result)}
    tasks = []
    for case in cases:
        missing = tuple(row for row in rows if case.key(row) not in known)
        if missing:
            tasks.append(_Task(case, missing))
        else:
            tick(case.source)
    with results_path.open("a", encoding="utf-8") as file:
        for task, outcome in executor.map(partial(_work, table.evaluate), tasks):
            if isinstance(outcome, WorkerDied):
                results = [table.failed(task.case, row, outcome.reason) for row in task.rows]
            else:
                results = outcome
            for result in results:
                known[result.key] = result
                file.write(json.dumps(asdict(result)) + "\n")
            file.flush()
            tick(task.case.source)
    return [known[case.key(row)] for case in cases for row in rows]


def read_results(path: Path, kind: type = Result) -> list:
    """Read a results file; nothing where it does not exist. A cut last line is removed from the file.

    Raises `InputError` for a file that is something else.
    """
    if not path.exists():
        return []
    data = path.read_bytes()
    whole, cut = data.rpartition(b"\n")[0], data.rpartition(b"\n")[2]
    results = list(_parse(whole.decode("utf-8", "replace"), path, kind))
    if cut:  # only now that the file is known to be ours
        path.write_bytes(whole + b"\n" if whole else b"")
    return results


def _parse(text: str, path: Path, kind: type) -> Iterator:
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            values = json.loads(line)
            yield kind(**{name: tuple(value) if isinstance(value, list) else value for name, value in values.items()})
        except (ValueError, TypeError, AttributeError, RecursionError) as error:
            raise InputError(
                path, wanted="results of an earlier run", came=f"line {number}: {error}", todo="name another --out"
            ) from None


def _work(evaluate: Callable[[Any, tuple[str, ...]], list], task: _Task) -> list:
    return evaluate(task.case, task.rows)
