"""`printmend bench prints`: which test print to make, and at how many points to measure it.

Rows: test prints. Columns: measured points and the noise of their measurement. A cell is the mean RMSE in full steps of
bodies printed with what the grey box learned, over random damaged faults, and its ratio to the optimum.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from printmend.bench.executor import executor
from printmend.bench.family_case import FamilyCase
from printmend.bench.print_case import OPTIMUM, PrintResult, evaluate_prints, failed_print, print_row
from printmend.bench.run import Table, results_folder, run
from printmend.errors import InputError

RESULTS, MARKDOWN = "prints.jsonl", "prints.md"
POINTS = (60, 250, 1000)
NOISES_MM = (0.0, 0.05, 0.1)
FAMILIES = ("pulley-play", "pulley-loose", "elastic", "frame")
LEAST_TURNS, MOST_TURNS = 0.75, 2.0  # how far the bodies are across
TABLE = Table(evaluate_prints, failed_print, PrintResult)


def draw_print_cases(families: Sequence[str], *, samples: int, seed: int) -> list[FamilyCase]:
    """Return a damaged fault of each family and sample, with a body of its own size.

    Raises `InputError` for a family that does not exist or that the twin cannot print from home.
    """
    from printmend.corruption import families as known

    for name in families:
        if name not in known() or name == "gain-table":
            raise InputError(
                "--families", wanted=f"names such as {', '.join(FAMILIES)}", came=repr(name), todo="correct it"
            )
    cases = []
    for name in families:
        for sample in range(samples):
            turns = np.random.default_rng([seed, sample]).uniform(LEAST_TURNS, MOST_TURNS)
            cases.append(FamilyCase(name, "damaged", "ender5", round(float(turns), 2), sample, seed))
    return cases


def prints_table(
    cases: Sequence[FamilyCase],
    prints: Sequence[str],
    points: Sequence[int],
    noises_mm: Sequence[float],
    out: Path,
    *,
    workers: int = 1,
    tick: Callable[[str], None] = lambda case: None,
) -> list[PrintResult]:
    """Evaluate every test print with every number of points and noise; keep results in ``out``/prints.jsonl.

    A run that was interrupted goes on where it was.
    """
    rows = [OPTIMUM, *(f"{label}@{count}@{noise:g}" for label in prints for count in points for noise in noises_mm)]
    for name in rows:
        print_row(name)
    results = results_folder(out) / RESULTS
    return run(list(cases), tuple(rows), results, executor(workers), tick=tick, table=TABLE)


def print_lines(
    results: Sequence[PrintResult], points: Sequence[int], noises_mm: Sequence[float]
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the table's header and lines.

    A cell reads "mean RMSE (its ratio to the optimum's mean)", with a star where some cases failed.
    """
    header = ("test print", *(f"{count} pts σ {noise:g}" for count in points for noise in noises_mm))
    optimum = {_place(item): item.rmse_steps for item in results if item.test_print == OPTIMUM}
    lines = []
    for label in dict.fromkeys(item.test_print for item in results if item.test_print != OPTIMUM):
        texts = []
        for count in points:
            for noise in noises_mm:
                items = [one for one in results if (one.test_print, one.points, one.noise_mm) == (label, count, noise)]
                texts.append(_text([(one.rmse_steps, optimum.get(_place(one))) for one in items]))
        lines.append((label, *texts))
    return header, lines


def _place(item: PrintResult) -> tuple[str, int, int]:
    return item.family, item.sample, item.seed


def _text(pairs: list[tuple[float | None, float | None]]) -> str:
    both = np.array([(mine, best) for mine, best in pairs if mine is not None and best is not None])
    if not len(both):
        return "–"
    mine, best = both.mean(axis=0)
    return f"{mine:.2f} ({mine / best:.2f})" + ("*" if len(both) < len(pairs) else "")
