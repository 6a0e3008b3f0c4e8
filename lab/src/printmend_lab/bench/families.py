"""`printmend bench families`: every learner and controller on every family of faults, a bad Z screw included.

Rows: families of faults, alone and composed, damaged and realistic. Columns: the turns that the test print covers and
the noise of its measurement. A cell is the mean RMSE in full steps and its ratio to the optimum: the optimal controller
on the true machine.
"""

import csv
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from printmend.errors import InputError
from printmend.files import replacing
from printmend.path import Trace
from printmend.printer import Printer, check_preset, read_printer
from printmend.twin import Twin
from printmend_lab.bench.case import (
    OPTIMUM,
    PRINTER,
    Case,
    LayerStand,
    Result,
    Row,
    check_rows,
    drawn_body,
    drawn_tower,
    row,
    row_parts,
    run,
)
from printmend_lab.bench.report import grouped, markdown_table, summary
from printmend_lab.body.layers import SpacePath, space_path
from printmend_lab.control.space import plan_space
from printmend_lab.executor import HERE, Executor
from printmend_lab.path import Body
from printmend_lab.protocols import SpaceModel
from printmend_lab.published import layer_trace
from printmend_lab.sampling import Severity, check_family, fault
from printmend_lab.space import fit_space, space_trace

# A machine of three axes in the families table: a bad Z screw, alone or with broken belts.
#
# The body is a tower as many turns of the screw high as it is turns of a motor across. Its whole print is measured;
# then another tower is planned and printed. Errors are distances in space, in full steps of X.

HOP_MM = 0.4  # by which Z hops over what was printed: only there does it turn back


@dataclass(frozen=True, eq=False)
class TowerStand:
    """The tower to learn from, as it was printed [T + 1, 3] steps, and the tower to print.

    ``noise`` makes unit noise [T + 1, 3] for a noise in mm, ``rng`` a learner's generator.
    """

    printer: Printer
    twin: Twin
    first: SpacePath
    printed: np.ndarray
    second: SpacePath
    noise: Callable[[float], np.ndarray]
    rng: Callable[[], np.random.Generator]

    def measure(self, row: Row) -> Trace:
        pitch_mm = np.array([axis.mm_per_step for axis in self.printer.axes])
        measured = self.printed + self.noise(row.noise_mm) * row.noise_mm / pitch_mm
        return space_trace(self.first.nominal_steps, measured, self.printer)

    def fit(self, measured: Trace, row: Row) -> SpaceModel:
        return fit_space(row.learner, measured, self.printer, rng=self.rng(), truth=self.twin.mechanism)

    def judge(self, model: SpaceModel, row: Row) -> dict[str, Any]:
        second = self.second
        begun = time.perf_counter()
        plan = plan_space(row.controller, model, second.nominal_steps[1:], second.start_steps)
        plan_s = time.perf_counter() - begun
        printed = self.twin.run(plan.controls, second.start_steps)
        return {"rmse_steps": self.rmse_steps(printed), "targets": len(second.controls), "plan_s": plan_s}

    def rmse_steps(self, printed: np.ndarray) -> float:
        """Return the RMSE in space of a print [T + 1, 3] of the second tower, in full steps of X."""
        pitch_mm = np.array([axis.mm_per_step for axis in self.printer.axes])
        missed = (printed - self.second.nominal_steps) * (pitch_mm / self.printer.x.mm_per_step)
        return float(np.sqrt((missed**2).sum(axis=1).mean()))


def tower_stand(
    twin: Twin,
    coverage: float,
    turn_mm: float,
    towers: Sequence[np.random.Generator],
    noise: Callable[[float, tuple[int, ...]], np.ndarray],
    rng: Callable[[], np.random.Generator],
) -> TowerStand:
    """Draw two towers, each with its generator, and print the first; jumps spoil that one only."""
    printer = twin.printer
    paths = []
    for generator in towers:
        height_mm = coverage * printer.z.mm_per_turn
        tower = drawn_tower(generator, printer, size_mm=coverage * turn_mm, height_mm=height_mm)
        paths.append(space_path(tower, printer, hop_mm=HOP_MM))
    first, second = paths
    printed = twin.run(first.controls, first.start_steps)
    return TowerStand(
        printer, Twin(twin.mechanism), first, printed, second, lambda noise_mm: noise(noise_mm, printed.shape), rng
    )


TABLE, MARKDOWN, CSV = "families", "families.md", "families.csv"
# Drawn from only for the tables in docs/results.md; develop with others, and take a new one after looking closer.
TEST_SEED = 20261121
COVERAGES = (0.5, 1.0, 2.5)  # turns of a motor that a body is across
TURN_MM = 40.0  # of the presets' motors; a body's size is a multiple of it
NAIVE = "naive+greedy"
ROWS = (NAIVE, "printmend+optimal", "greybox+greedy", "greybox+optimal", "oracle+greedy", OPTIMUM)
SEVERITIES: tuple[Severity, ...] = ("damaged", "realistic")

# The purposes for which a case's generator is seeded; part of the meaning of a seed.
_CORRUPTION, _BODY, _NOISE, _LEARNER = 1, 2, 3, 4
_SCREW = "screw"

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


def draw_family_cases(
    names: Sequence[str],
    *,
    severities: Sequence[Severity] = SEVERITIES,
    coverages: Sequence[float] = COVERAGES,
    samples: int,
    seed: int,
) -> list[Case]:
    """Return the cases of a table, every family of ``names`` (FAMILY or FAMILY@PRINTER) at every severity and coverage.

    Raises `InputError` for a family or a printer that does not exist.
    """
    cases = []
    for name in names:
        family, _, printer = name.partition("@")
        planar = family.removesuffix("+screw")
        if planar == "gain-table" or (planar == "screw" and family != planar):
            wanted = f"{', '.join((*_ALONE, *_COMPOSED, 'screw'))}, then +screw and @PRINTER where wanted"
            raise InputError("--families", wanted=wanted, came=repr(name), todo="correct it")
        check_family(planar)
        check_preset(printer or PRINTER)
        if wrong := [value for value in coverages if not 0.1 <= value <= 100]:
            raise InputError("--coverage", wanted="0.1 to 100 turns", came=f"{wrong[0]:g}", todo="correct it")
        cases += [
            drawn_case(TABLE, family, severity, coverage, number, seed, printer=printer or PRINTER)
            for severity in severities
            for coverage in coverages
            for number in range(samples)
        ]
    return cases


def drawn_case(
    table: str, family: str, severity: Severity, coverage: float, number: int, seed: int, *, printer: str = PRINTER
) -> Case:
    """Return the ``number``-th fault of a family on a preset, and a body ``coverage`` turns of a motor across.

    The fault does not depend on the coverage, nor the body on the family.
    """
    return Case(
        table, f"{coverage:g} turns", "", family, severity, "heldout", seed, printer, float(coverage), number
    )  # fmt: skip


def set_up(case: Case) -> LayerStand | TowerStand:
    """Print the case's first layer; the others are judged. With a Z screw these are two towers.

    Jumps, and effects of one print, spoil the test print only: nobody can foresee them in the next.
    """
    printer, coverage = read_printer(case.printer), coverage_of(case)
    twin = Twin.of(corruption_of(case), printer)
    if _SCREW in case.family.split("+"):
        return tower_stand(
            twin, coverage, TURN_MM, [case.rng(_BODY, coverage, place) for place in range(2)],
            lambda noise_mm, shape: case.rng(_NOISE, noise_mm).normal(0.0, 1.0, shape), lambda: case.rng(_LEARNER),
        )  # fmt: skip
    first, *others = body_of(case, printer).layers
    measured = layer_trace(first, twin.run(first.controls, first.start_steps), printer)

    def trace(row: Row) -> Trace:
        return replace(measured, measured_mm=case.noisy(measured, _NOISE, row.noise_mm))

    return LayerStand(printer, twin.again(), trace, tuple(others), lambda: case.rng(_LEARNER))


read_row = row


def corruption_of(case: Case) -> Any:
    """Draw the case's fault; FAMILY+screw has the faults of both."""
    severity: Any = case.severity
    drawn: list[Any] = [fault(name, case.rng(_CORRUPTION, name, severity), severity) for name in case.family.split("+")]
    return drawn[0] if len(drawn) == 1 else replace(drawn[0], screw=drawn[1].screw)


def body_of(case: Case, printer: Printer) -> Body:
    """Draw the case's body."""
    coverage = coverage_of(case)
    return drawn_body(case.rng(_BODY, coverage), printer, size_mm=coverage * TURN_MM)


def coverage_of(case: Case) -> float:
    """Return how many turns of a motor a drawn body is across. Raise ValueError for a body in a file."""
    if case.coverage is None:
        raise ValueError(f"{case.body} is not drawn")
    return case.coverage


def families_table(
    cases: Sequence[Case],
    rows: Sequence[str],
    noises_mm: Sequence[float],
    out: Path,
    *,
    executor: Executor = HERE,
    tick: Callable[[str], None] = lambda case: None,
) -> list[Result]:
    """Evaluate the cases for LEARNER+CONTROLLER rows and the optimum; keep results in ``out``/families.jsonl.

    A run that was interrupted continues where it left off. What does not measure (``naive``, ``oracle``) runs without
    noise.
    """
    labels = tuple(dict.fromkeys((*rows, OPTIMUM)))
    names = [f"{label}@{noise:g}" for label in labels for noise in (noises_mm if measures(label) else (0.0,))]
    check_rows(names)
    return run(cases, names, out, executor, tick=tick)


def measures(label: str) -> bool:
    """Say whether a row learns from the measurement, so that its noise matters."""
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


def family_cells(results: Sequence[Result], noises_mm: Sequence[float]) -> list[Cell]:
    """Return the cells of every row, family, severity, coverage and noise, in the order of the results."""
    best = [item for item in results if row_parts(item.row)[0] == OPTIMUM]
    cells = []
    groups = grouped(results, lambda item: (item.row, replace(item.case, sample=0)))
    for (name, case), items in groups.items():
        label, noise = row_parts(name)
        found = summary(items, best)
        for noise_mm in [noise] if measures(label) else noises_mm:
            cells.append(
                Cell(
                    label, case.family, case.severity, case.printer, coverage_of(case), float(noise_mm), found.results,
                    found.failures, found.mean, found.reference, found.ratio, found.median_ratio, found.worst_ratio,
                )
            )  # fmt: skip
    return cells


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
            name = f"{family}{'' if printer == PRINTER else '@' + printer} {severity}"
            texts = [
                _text(found.get((label, family, severity, printer, float(turns), float(noise))))
                for turns in coverages
                for noise in noises_mm
            ]
            lines.append((name, *texts))
        tables.append((label, header, lines))
    return tables


def _text(cell: Cell | None) -> str:
    """Return a cell as text: RMSE and ratio, with a star where some cases failed."""
    if cell is None or cell.rmse_steps is None:
        return "–"
    ratio = "–" if cell.ratio is None else f"{cell.ratio:.2f}"
    return f"{cell.rmse_steps:.3f} ({ratio})" + ("*" if cell.failures else "")


def family_markdown(cells: Sequence[Cell], coverages: Sequence[float], noises_mm: Sequence[float]) -> str:
    """Return a Markdown table for each row: families down, ratios to the optimum across, "damaged / realistic".

    Two more columns give the size of the errors: the optimum's and naive's RMSE in full steps, over all coverages.
    """
    found = {(c.label, c.family, c.severity, c.printer, c.coverage, c.noise_mm): c for c in cells}
    header = (
        "family", "optimum", "naive", *(f"{turns:g} turn σ {noise:g}" for turns in coverages for noise in noises_mm)
    )  # fmt: skip
    families = list(dict.fromkeys((cell.family, cell.printer) for cell in cells))
    texts = []
    for label in dict.fromkeys(cell.label for cell in cells if cell.label != OPTIMUM):
        lines = []
        for family, printer in families:

            def across(row: str, coverage: float, noise: float, place: tuple[str, str] = (family, printer)) -> str:
                pair = [found.get((row, place[0], severity, place[1], coverage, noise)) for severity in SEVERITIES]
                return " / ".join(_ratio(cell) for cell in pair if cell is not None) or "–"

            name = family + ("" if printer == PRINTER else f" @{printer}")
            sizes = [_size(cells, row, family, printer) for row in (OPTIMUM, NAIVE)]
            ratios = [across(label, float(turns), float(noise)) for turns in coverages for noise in noises_mm]
            lines.append((name, *sizes, *ratios))
        texts.append(f"**{label}**\n\n" + markdown_table(header, lines))
    return "\n".join(texts)


def write_families(folder: Path, cells: Sequence[Cell], coverages: Sequence[float], noises_mm: Sequence[float]) -> None:
    """Write families.md, compact enough to read, and families.csv, every number, into ``folder``."""
    with replacing(folder / MARKDOWN) as file:
        file.write(family_markdown(cells, coverages, noises_mm))
    with replacing(folder / CSV) as file:
        table = csv.DictWriter(file, [field.name for field in fields(Cell)], lineterminator="\n")
        table.writeheader()
        table.writerows(asdict(cell) for cell in cells)


def _ratio(cell: Cell) -> str:
    """Return a cell's ratio as text, with a star where some cases failed."""
    star = "*" if cell.failures else ""
    return ("–" if cell.ratio is None else f"{cell.ratio:.2f}" if cell.ratio < 99.5 else f"{cell.ratio:.0f}") + star


def _size(cells: Sequence[Cell], label: str, family: str, printer: str) -> str:
    """Return a row's mean RMSE for a family at each severity, over all coverages, as text."""
    means = []
    for severity in SEVERITIES:
        wanted = (label, family, severity, printer)
        values = [
            cell.rmse_steps
            for cell in cells
            if (cell.label, cell.family, cell.severity, cell.printer) == wanted and cell.rmse_steps is not None
        ]
        if values:
            mean = sum(values) / len(values)
            means.append(f"{mean:.2f}" if mean < 99.5 else f"{mean:.0f}")
    return " / ".join(means) or "–"
