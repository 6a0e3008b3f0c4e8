"""The paper's Table I and Fig. 6 over real bodies: draw the cases, run them, report them."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from printmend.bench.case import Case, Result
from printmend.bench.executor import executor
from printmend.bench.report import Line, lines
from printmend.bench.rows import row
from printmend.bench.run import results_folder, run
from printmend.errors import InputError

RESULTS = "table1.jsonl"


def table1(
    cases: Sequence[Case],
    rows: Sequence[str],
    out: Path,
    *,
    workers: int = 1,
    tick: Callable[[str], None] = lambda body: None,
) -> tuple[list[Line], list[Result]]:
    """Evaluate the cases for the rows; keep results in ``out``/table1.jsonl and draw Fig. 6 beside them.

    Raises `InputError`, before anything is written, for a row that does not exist.
    """
    rows = tuple(dict.fromkeys(rows))
    for name in rows:
        row(name)
    if not cases:
        raise InputError("bodies", wanted="at least one", came="none", todo="check --bodies, --reference and --limit")
    out = results_folder(out)
    results = run(list(cases), rows, out / RESULTS, executor(workers), tick=tick)
    drawn = sorted({case.family for case in cases})
    world = drawn[0] if len(drawn) == 1 else "mixed"
    draw_figure6(results, rows, out / f"figure6-{world}-{cases[0].protocol}.png")
    return lines(results, rows), results


def draw_figure6(results: Sequence[Result], rows: Sequence[str], path: Path) -> None:
    """Draw the paper's Fig. 6 (clipped at 100 steps) beside every model's unclipped errors over a logarithmic axis."""
    values = {
        name: np.array([result.rmse_steps for result in results if result.row == name and result.error is None], float)
        for name in rows
    }
    values = {name: errors for name, errors in values.items() if len(errors)}
    if not values:
        return
    from printmend.draw import draw_histogram, draw_log_histogram, new_figure, save

    shown = next((name for name in ("lightgbm", *rows) if name in values), rows[0])
    figure, axes = new_figure(2, width_in=6.0, height_in=4.2)
    draw_histogram(axes[0], values[shown], name=f"{shown}: {len(values[shown])} bodies")
    draw_log_histogram(axes[1], values)
    figure.subplots_adjust(left=0.06, right=0.95, top=0.92, bottom=0.13, wspace=0.22)
    save(figure, path, dpi=110)
