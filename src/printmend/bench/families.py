"""`printmend bench families`: how well every learner and controller prints on every family of faults.

Rows: families of faults, alone and composed, damaged and realistic. Columns: the turns that the test print covers and
the noise of its measurement. A cell is the mean RMSE in full steps and its ratio to the optimum: the optimal controller
on the true machine.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from printmend.bench.executor import executor
from printmend.bench.family_case import FamilyCase, FamilyResult, evaluate_family, failed_family, row_parts
from printmend.bench.run import Table, results_folder, run
from printmend.errors import InputError

RESULTS = "families.jsonl"
OPTIMUM = "optimum"  # a row by itself, see rows.py
# Drawn from only for the tables in docs/results.md; develop with others, and take a new one after looking closer.
TEST_SEED = 20261121
NOISES_MM = (0.0, 0.05, 0.1)
COVERAGES = (0.5, 1.0, 2.5)
ROWS = ("naive+greedy", "greybox+greedy", "greybox+optimal", "oracle+greedy", OPTIMUM)
_NOTHING_STEPS = 1e-9
SEVERITIES: tuple[Literal["damaged", "realistic"], ...] = ("damaged", "realistic")

# Everything that two axes show; a gain table is the published simulator's own world.
_ALONE = (
    "radius", "eccentric", "ellipse", "polygon", "flat", "fourier", "tabulated", "published",
    "play", "loose", "set-screw", "elastic", "friction", "ripple", "frame", "jumps", "smooth",
)  # fmt: skip
_COMPOSED = ("pulley-play", "pulley-loose", "pulley-set-screw", "everything")
_COREXY = ("pulley", "pulley-play", "pulley-loose", "frame", "everything")
# Of three axes.
_SPACE = ("screw", "pulley-loose+screw", "everything+screw")
# A name is FAMILY or FAMILY@PRINTER; without a printer it is the paper's.
FAMILIES = (*_ALONE, *_COMPOSED, *_SPACE, *(f"{name}@corexy" for name in (*_COREXY, "pulley-loose+screw")))

TABLE = Table(evaluate_family, failed_family, FamilyResult)


def draw_family_cases(
    names: Sequence[str],
    *,
    severities: Sequence[Literal["damaged", "realistic"]] = SEVERITIES,
    coverages: Sequence[float] = COVERAGES,
    samples: int,
    seed: int,
) -> list[FamilyCase]:
    """Return the cases of a table, every family of ``names`` (FAMILY or FAMILY@PRINTER) at every severity and coverage.

    Raises `InputError` for a family or a printer that does not exist.
    """
    from printmend.corruption.sample import check_family
    from printmend.printer import preset_names

    cases = []
    for name in names:
        family, _, printer = name.partition("@")
        planar = family.removesuffix("+screw")
        if planar == "gain-table" or (planar == "screw" and family != planar):
            raise InputError(
                "--families",
                wanted=f"{', '.join((*_ALONE, *_COMPOSED, 'screw'))}, then +screw and @PRINTER where wanted",
                came=repr(name),
                todo="correct it",
            )
        check_family(planar)
        if printer and printer not in preset_names():
            raise InputError(
                "--families",
                wanted=f"printers out of {', '.join(preset_names())}",
                came=repr(printer),
                todo="correct it",
            )
        if wrong := [value for value in coverages if not 0.1 <= value <= 100]:
            raise InputError("--coverage", wanted="0.1 to 100 turns", came=f"{wrong[0]:g}", todo="correct it")
        cases += [
            FamilyCase(family, severity, printer or "ender5", float(coverage), sample, seed)
            for severity in severities
            for coverage in coverages
            for sample in range(samples)
        ]
    return cases


def families_table(
    cases: Sequence[FamilyCase],
    rows: Sequence[str],
    noises_mm: Sequence[float],
    out: Path,
    *,
    workers: int = 1,
    tick: Callable[[str], None] = lambda case: None,
) -> list[FamilyResult]:
    """Evaluate the cases for LEARNER+CONTROLLER rows and the optimum; keep results in ``out``/families.jsonl.

    A run that was interrupted goes on where it was. What does not measure (``naive``, ``oracle``) runs without noise.
    """
    from printmend.bench.rows import row

    labels = tuple(dict.fromkeys((*rows, OPTIMUM)))
    for label in labels:
        row(label)
    names = tuple(f"{label}@{noise:g}" for label in labels for noise in (noises_mm if measures(label) else (0.0,)))
    for name in names:
        row_parts(name)
    results = results_folder(out) / RESULTS
    return run(list(cases), names, results, executor(workers), tick=tick, table=TABLE)


def measures(label: str) -> bool:
    """Tell whether a row learns from the measurement, so that its noise matters."""
    return label.partition("+")[0] not in ("naive", "oracle", OPTIMUM)


@dataclass(frozen=True)
class Cell:
    """A row's errors over a family's samples: the mean RMSE [steps] and its ratio to the optimum's mean; the median
    and the worst of the samples' own ratios. None where nothing succeeded, or the optimum is no error at all.
    """

    label: str
    family: str
    severity: str
    printer: str
    coverage: float
    noise_mm: float
    samples: int = 0
    failures: int = 0
    rmse_steps: float | None = None
    optimum_steps: float | None = None
    ratio: float | None = None
    median_ratio: float | None = None
    worst_ratio: float | None = None


def family_cells(results: Sequence[FamilyResult], noises_mm: Sequence[float]) -> list[Cell]:
    """Return the cells of every row, family, severity, coverage and noise, in the order of the results."""
    best = {_place(item): item.rmse_steps for item in results if item.row == OPTIMUM}
    groups: dict[Cell, list[FamilyResult]] = {}
    for item in results:
        for noise_mm in [item.noise_mm] if measures(item.row) else noises_mm:
            place = (item.row, item.family, item.severity, item.printer, item.coverage, float(noise_mm))
            groups.setdefault(Cell(*place), []).append(item)
    return [_filled(cell, items, best) for cell, items in groups.items()]


def _place(item: FamilyResult) -> tuple[str, str, str, float, int, int]:
    return (item.family, item.severity, item.printer, item.coverage, item.sample, item.seed)


def _filled(cell: Cell, items: list[FamilyResult], best: dict) -> Cell:
    pairs = [(item.rmse_steps, best.get(_place(item))) for item in items]
    both = [(mine, optimum) for mine, optimum in pairs if mine is not None and optimum is not None]
    if not both:
        return replace(cell, samples=len(items), failures=len(items))
    mine, optimum = np.array(both).T
    # A machine that only jumps is healthy when it does not: there the optimum is no error at all.
    perfect = optimum < _NOTHING_STEPS
    matched = perfect & (mine < _NOTHING_STEPS)
    ratios = np.where(matched, 1.0, mine / np.where(perfect, 1.0, optimum))[matched | ~perfect]
    together = float(optimum.mean())
    ratio = float(mine.mean()) / together if together >= _NOTHING_STEPS else (1.0 if matched.all() else None)
    return replace(
        cell,
        samples=len(items),
        failures=len(items) - len(both),
        rmse_steps=float(mine.mean()),
        optimum_steps=float(optimum.mean()),
        ratio=ratio,
        median_ratio=float(np.median(ratios)) if len(ratios) else None,
        worst_ratio=float(ratios.max()) if len(ratios) else None,
    )


def family_tables(
    cells: Sequence[Cell], coverages: Sequence[float], noises_mm: Sequence[float]
) -> list[tuple[str, tuple[str, ...], list[tuple[str, ...]]]]:
    """Return a table for each row of `families_table`: its title, header and lines.

    A cell reads "RMSE (ratio)", the RMSE in full steps.
    """
    header = ("family", *(f"{turns:g} turn σ {noise:g}" for turns in coverages for noise in noises_mm))
    found = {(c.label, c.family, c.severity, c.printer, c.coverage, c.noise_mm): c for c in cells}
    tables = []
    for label in dict.fromkeys(cell.label for cell in cells):
        lines = []
        for family, severity, printer in dict.fromkeys((c.family, c.severity, c.printer) for c in cells):
            name = f"{family}{'' if printer == 'ender5' else '@' + printer} {severity}"
            texts = [
                _text(found.get((label, family, severity, printer, float(turns), float(noise))))
                for turns in coverages
                for noise in noises_mm
            ]
            lines.append((name, *texts))
        tables.append((label, header, lines))
    return tables


def _text(cell: Cell | None) -> str:
    if cell is None or cell.rmse_steps is None:
        return "–"
    ratio = "–" if cell.ratio is None else f"{cell.ratio:.2f}"
    return f"{cell.rmse_steps:.3f} ({ratio})" + ("*" if cell.failures else "")
