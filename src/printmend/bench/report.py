"""Table I and Fig. 6 from results."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from printmend.bench.case import Result
from printmend.files import replacing
from printmend.metrics import abrmse


@dataclass(frozen=True)
class Line:
    """One row of Table I over its bodies. Errors in full steps unless named; None where nothing succeeded."""

    row: str
    bodies: int
    failures: int
    abrmse_steps: float | None
    abrmse_mm: float | None
    median_steps: float | None
    p95_steps: float | None
    ratio_to_oracle: float | None
    learn_s: float | None
    targets_s: float | None


HEADER = ("model", "bodies", "ABRMSE steps", "mm", "median", "p95", "÷ oracle", "learn s", "targets/s")


def lines(results: Sequence[Result], rows: Sequence[str]) -> list[Line]:
    """Return one line a row: ABRMSE is the mean over bodies, the ratio to the oracle is over the bodies that both have.

    ``learn s`` and ``targets/s`` are medians over bodies, so that compiling in a worker's first body does not show.
    """
    oracle = {result.source: result.rmse_steps for result in results if result.row == "oracle" and result.error is None}
    return [_line(row, [result for result in results if result.row == row], oracle) for row in rows]


def _line(row: str, results: list[Result], oracle: dict[str, float | None]) -> Line:
    good = [result for result in results if result.error is None]
    failures = len(results) - len(good)
    if not good:
        return Line(row, 0, failures, None, None, None, None, None, None, None)
    steps = np.array([result.rmse_steps for result in good], float)
    both = [(result.rmse_steps, oracle[result.source]) for result in good if result.source in oracle]
    mine, truth = (np.mean(column) for column in zip(*both, strict=True)) if both else (np.nan, 0.0)
    speeds = [result.targets / result.plan_s for result in good if result.plan_s]
    return Line(
        row=row,
        bodies=len(good),
        failures=failures,
        abrmse_steps=abrmse(steps),
        abrmse_mm=abrmse(result.rmse_mm or 0.0 for result in good),
        median_steps=float(np.median(steps)),
        p95_steps=float(np.percentile(steps, 95)),
        ratio_to_oracle=float(mine / truth) if truth else None,
        learn_s=float(np.median([result.learn_s or 0.0 for result in good])),
        targets_s=float(np.median(speeds)) if speeds else None,
    )


def cells(line: Line) -> tuple[str, ...]:
    """Return a line as the table's texts, in the order of `HEADER`."""
    numbers = (line.abrmse_steps, line.abrmse_mm, line.median_steps, line.p95_steps, line.ratio_to_oracle)
    texts = ["–" if number is None else f"{number:.3f}" for number in numbers]
    learn = "–" if line.learn_s is None else f"{line.learn_s:.3f}"
    speed = "–" if line.targets_s is None else f"{line.targets_s:,.0f}".replace(",", " ")
    return (line.row, str(line.bodies), *texts, learn, speed)


def text_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a plain table: the first column to the left, numbers to the right, two blanks between."""
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    texts = []
    for row in (header, *rows):
        name, *numbers = (cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        texts.append("  ".join([name.strip().ljust(widths[0]), *numbers]).rstrip())
    return "\n".join(texts)


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table: the first column to the left, numbers to the right."""
    rule = ("---", *("---:" for _ in header[1:]))
    return "\n".join("| " + " | ".join(row) + " |" for row in (header, rule, *rows)) + "\n"


def write_markdown(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Write a table as Markdown, for the docs."""
    with replacing(path) as file:
        file.write(markdown_table(header, rows))


def body_table(results: Sequence[Result], rows: Sequence[str]) -> str:
    """Return the RMSE [steps] of every body and row, for comparisons body by body."""
    bodies = list(dict.fromkeys(result.body for result in results))
    value = {(result.body, result.row): result.rmse_steps for result in results}

    def shown(body: str, row: str) -> str:
        number = value.get((body, row))
        return "–" if number is None else f"{number:.6f}"

    return text_table(("body", *rows), [(body, *(shown(body, row) for row in rows)) for body in bodies])


def failure_texts(results: Sequence[Result]) -> list[str]:
    """Return one text for each body and reason that failed, with the rows concerned."""
    found: dict[tuple[str, str], list[str]] = {}
    for result in results:
        if result.error is not None:
            found.setdefault((result.body, result.error), []).append(result.row)
    return [f"{body} ({', '.join(rows)}): {reason}" for (body, reason), rows in found.items()]
