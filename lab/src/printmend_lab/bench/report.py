"""What all tables are made of in the end: means against a reference, and rows of text."""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from printmend.files import replacing
from printmend_lab.bench.case import Case, Result

Group = TypeVar("Group", bound=Hashable)
_NO_ERROR_STEPS = 1e-9  # a lower RMSE is none: that of a machine that only jumps, where it does not


@dataclass(frozen=True)
class Summary:
    """A figure over results: how many there are and failed; mean, median and 95th percentile of the others.

    ``reference`` is the mean of a reference row over the cases that both have, ``ratio`` the mean over these divided by
    it; ``median_ratio`` and ``worst_ratio`` are of the cases' own ratios. None where nothing succeeded, or where the
    reference is no error at all and this is one.
    """

    results: int
    failures: int
    mean: float | None = None
    median: float | None = None
    p95: float | None = None
    reference: float | None = None
    ratio: float | None = None
    median_ratio: float | None = None
    worst_ratio: float | None = None


def summary(results: Sequence[Result], reference: Sequence[Result] = ()) -> Summary:
    """Summarise the RMSE [steps] of ``results`` and compare it with ``reference``'s, case by case."""
    known: dict[Case, float] = {item.case: item.values["rmse_steps"] for item in reference if item.error is None}
    good = [item for item in results if item.error is None]
    failures = len(results) - len(good)
    if not good:
        return Summary(len(results), failures)
    values = np.array([item.values["rmse_steps"] for item in good], float)
    found = {"mean": values.mean(), "median": np.median(values), "p95": np.percentile(values, 95)}
    both = [(value, known[item.case]) for item, value in zip(good, values, strict=True) if item.case in known]
    if both:
        mine, best = np.array(both).T
        perfect = best < _NO_ERROR_STEPS
        matched = perfect & (mine < _NO_ERROR_STEPS)
        ratios = np.where(matched, 1.0, mine / np.where(perfect, 1.0, best))[matched | ~perfect]
        found["reference"] = best.mean()
        if best.mean() >= _NO_ERROR_STEPS:
            found["ratio"] = mine.mean() / best.mean()
        elif matched.all():
            found["ratio"] = 1.0
        if len(ratios):
            found |= {"median_ratio": np.median(ratios), "worst_ratio": ratios.max()}
    return Summary(len(results), failures, **{key: float(value) for key, value in found.items()})


def grouped(results: Sequence[Result], group: Callable[[Result], Group]) -> dict[Group, list[Result]]:
    """Return the results of each group, in the order in which the groups first come."""
    found: dict[Group, list[Result]] = {}
    for item in results:
        found.setdefault(group(item), []).append(item)
    return found


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
    bodies = list(dict.fromkeys(result.case.body for result in results))
    value = {(result.case.body, result.row): result.value("rmse_steps") for result in results}

    def shown(body: str, row: str) -> str:
        number = value.get((body, row))
        return "–" if number is None else f"{number:.6f}"

    return text_table(("body", *rows), [(body, *(shown(body, row) for row in rows)) for body in bodies])


def left_texts(results: Sequence[Result]) -> list[str]:
    """Return a text for each controller that left rows' models to another one, as they have no tables of play."""
    found: dict[tuple[str, str], list[str]] = {}
    for result in results:
        if (planner := result.value("left_to")) is not None:
            asked = result.row.partition("+")[2].partition("@")[0]
            found.setdefault((asked, str(planner)), []).append(result.row)
    return [
        f"{', '.join(dict.fromkeys(rows))}: planned by {planner}, to which {asked} leaves models without tables of play"
        for (asked, planner), rows in found.items()
    ]


_NAMED_CASES = 3  # of those that failed alike


def failure_texts(results: Sequence[Result]) -> list[str]:
    """Return one text for each reason for which the same rows failed: the first cases that it befell, and how many."""
    found: dict[tuple[str, str], list[str]] = {}
    for result in results:
        if result.error is not None:
            what = result.case.body if result.case.coverage is None else str(result.case)
            found.setdefault((what, result.error), []).append(result.row)
    alike: dict[tuple[str, str], list[str]] = {}
    for (what, reason), rows in found.items():
        alike.setdefault((", ".join(rows), reason), []).append(what)
    texts = []
    for (names, reason), cases in alike.items():
        more = f" and {len(cases) - _NAMED_CASES} more" if len(cases) > _NAMED_CASES else ""
        texts.append(f"{', '.join(cases[:_NAMED_CASES])}{more} ({names}): {reason}")
    return texts
