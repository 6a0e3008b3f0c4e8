"""Run cases, keep their results, resume where a run was interrupted."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from printmend.errors import InputError
from printmend_lab.bench.case import Case, Result
from printmend_lab.bench.trial import evaluate, failed
from printmend_lab.executor import Executor, WorkerDied

Evaluate = Callable[[Case, tuple[str, ...]], list[Result]]


@dataclass(frozen=True)
class _Task:
    case: Case
    rows: tuple[str, ...]
    evaluate: Evaluate


def results_folder(out: Path) -> Path:
    """Return the folder for results, made where it was absent. Raise `InputError` where it cannot be."""
    out = Path(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(out, wanted="a folder for the results", came=f"{error}", todo="name another --out") from None
    return out


def run(
    cases: Sequence[Case],
    rows: Sequence[str],
    out: Path,
    executor: Executor,
    *,
    tick: Callable[[str], None] = lambda case: None,
    evaluate: Evaluate = evaluate,
) -> list[Result]:
    """Evaluate every case, all of one table, for every row that is not in ``out``/TABLE.jsonl yet.

    Each result is appended as it comes: one JSON object a line, which says the version of the code that made it. The
    file may hold other runs' results; those of these cases and rows are returned, in their order. A line that an
    interruption cut short is dropped.
    """
    if not cases:
        raise InputError("the table", wanted="at least one case", came="none", todo="ask for more")
    path = results_folder(out) / f"{cases[0].table}.jsonl"
    known = {result.key: result for result in read_results(path)}
    keys = {(case, row): case.key(row) for case in cases for row in rows}  # a plug-in may be edited meanwhile
    tasks = []
    for case in cases:
        missing = tuple(row for row in rows if keys[case, row] not in known)
        if missing:
            tasks.append(_Task(case, missing, evaluate))
        else:
            tick(str(case))
    with path.open("a", encoding="utf-8") as file:
        for task, outcome in executor.map(_work, tasks):
            if isinstance(outcome, WorkerDied):
                results = [failed(task.case, row, outcome.reason) for row in task.rows]
            else:
                results = outcome
            for made in results:
                result = replace(made, kept=keys[made.case, made.row])
                known[result.key] = result
                file.write(json.dumps(result.flat()) + "\n")
            file.flush()
            tick(str(task.case))
    return [known[keys[case, row]] for case in cases for row in rows]


def read_results(path: Path) -> list[Result]:
    """Read a results file; nothing where it does not exist. A cut last line is removed from the file.

    Raises `InputError` for a file that is something else.
    """
    if not path.exists():
        return []
    data = path.read_bytes()
    whole, cut = data.rpartition(b"\n")[0], data.rpartition(b"\n")[2]
    results = list(_parse(whole.decode("utf-8", "replace"), path))
    if cut:  # only now that the file is known to be ours
        path.write_bytes(whole + b"\n" if whole else b"")
    return results


def _parse(text: str, path: Path) -> Iterator[Result]:
    """Yield the results that the lines of a file hold."""
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            yield Result.of(json.loads(line))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            came = f"line {number}: {type(error).__name__} {error}"
            raise InputError(path, wanted="results of an earlier run", came=came, todo="name another --out") from None


def _work(task: _Task) -> list[Result]:
    """Evaluate a task: what a worker is sent."""
    return task.evaluate(task.case, task.rows)
