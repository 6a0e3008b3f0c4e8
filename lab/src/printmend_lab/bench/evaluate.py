"""Judge learners on bodies from Python: the paper's Table I in one call, a learner of one's own beside the others."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from printmend.protocols import Learner
from printmend_lab.bench.case import Result
from printmend_lab.bench.report import failure_texts, text_table
from printmend_lab.bench.rows import OPTIMUM, Row, row
from printmend_lab.bench.table1 import HEADER, Line, cells, draw_cases, lines
from printmend_lab.bench.trial import evaluate_rows
from printmend_lab.control.registry import controller as controller_of
from printmend_lab.dataset.bodies import body_files
from printmend_lab.sampling import Severity


@dataclass(frozen=True)
class Evaluation:
    """A line for each learner over the bodies, and each learner's result on each body; printed, it is the table."""

    lines: tuple[Line, ...]
    results: tuple[Result, ...]

    def __str__(self) -> str:
        table = text_table(HEADER, [cells(line) for line in self.lines])
        return "\n".join([table, *(f"failed: {text}" for text in failure_texts(self.results))])


def evaluate(
    learners: Sequence[str | Learner],
    bodies: Iterable[str | Path],
    *,
    controller: str = "optimal",
    families: Sequence[str] = ("pulley",),
    severity: Severity = "damaged",
    protocol: Literal["paper", "heldout", "covered"] = "heldout",
    seed: int = 0,
    limit: int | None = None,
) -> Evaluation:
    """Print each body on a broken printer, let each learner learn from its largest layer, plan others, print again.

    ``learners`` are names (`naive`, `greybox`, `oracle`, or with a controller of their own: `greybox+greedy` is the
    paper's) or learners themselves, which plan with ``controller``. ``bodies`` are meshes, G-code files and folders of
    them; what is broken is drawn from ``families`` and the ``seed``, the same for every learner. Up to three layers are
    judged, with `heldout` never the one that was learned from, with `paper` any. With `covered` the
    one that is learned from shows the most of both motors' turns, and is not judged. Nothing is kept; `printmend bench
    table1` also keeps results, goes on after an interruption and uses several processes. Raises `InputError` for an
    unknown name and where there is no body; a learner that fails on a body has a result that says why.
    """
    rows = dict(_row(item, controller) for item in learners)
    cases = draw_cases(
        body_files(bodies), protocol=protocol, families=tuple(families), severity=severity, seed=seed, limit=limit
    )
    results = [result for case in cases for result in evaluate_rows(case, rows)]
    return Evaluation(tuple(lines(results, tuple(rows))), tuple(results))


def _row(item: str | Learner, controller: str) -> tuple[str, Row]:
    if not isinstance(item, str):
        return item.name, Row(item.name, controller_of(controller), own=item)
    return item, row(item if item == OPTIMUM or "+" in item else f"{item}+{controller}")
