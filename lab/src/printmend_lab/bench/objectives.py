"""`printmend bench objectives`: does it pay to plan for what one sees instead of for the paper's RMSE?

One body, one fault a family: learn from the training layer, plan held-out layers for each objective on the learned
model, print them on the twin, and measure every print by every metric.
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from printmend.errors import InputError
from printmend.metrics import rmse
from printmend.printer import Printer, read_printer
from printmend.twin import Twin
from printmend_lab.bench.case import Case, LayerStand, Result, check_rows, row, run
from printmend_lab.bench.table1 import drawn_layers
from printmend_lab.body import body_of, demo_body_gcode, load_body
from printmend_lab.dataset.bodies import digest
from printmend_lab.executor import HERE, Executor
from printmend_lab.path import Layer
from printmend_lab.published import layer_trace
from printmend_lab.sampling import Severity, sample
from printmend_lab.sampling import families as known_families
from printmend_lab.shape import bead_difference_area, frechet

TABLE, PULLEY = "objectives", "timing pulley"
BEAD_MM = 0.4  # a bead's width
HEADER = ("fault", "planned for", "RMSE mm", "p95 mm", "area mm²", "Fréchet mm", "plan s")


def objective_cases(
    source: Path | None,
    *,
    families: Sequence[str],
    severity: Severity,
    layers: int,
    seed: int,
    printer: str,
) -> list[Case]:
    """Return a case a family, on the body of a file or on a timing pulley. Raise `InputError` for unknown families."""
    if unknown := [family for family in families if family not in known_families() or family == "gain-table"]:
        raise InputError(
            "--families", wanted=f"names out of {', '.join(known_families())}", came=repr(unknown[0]), todo="correct it"
        )
    pulley = hashlib.sha256(demo_body_gcode()).hexdigest()[:16]
    name, identity = (PULLEY, pulley) if source is None else (source.stem, digest(source))
    place = "" if source is None else str(source.absolute())
    return [
        Case(TABLE, name, identity, family, severity, "heldout", seed, printer, layers=layers, source=place)
        for family in families
    ]


def set_up(case: Case) -> LayerStand:
    """Print the training layer, and draw others to hold out; the layers and the faults are drawn from the seed."""
    printer = read_printer(case.printer)
    body = load_body(case.source, printer) if case.source else body_of(demo_body_gcode(), printer, name=case.body)
    training, severity = body.training_layer, "realistic" if case.severity == "realistic" else "damaged"
    layers = drawn_layers(
        body.layers, training, case.protocol, case.layers, np.random.default_rng(case.seed), subject=body.name
    )
    twin = Twin.of(sample(case.family, np.random.default_rng([case.seed, 1]), severity), printer)  # type: ignore[arg-type]
    trace = layer_trace(training, twin.run(training.controls, training.start_steps), printer)
    return LayerStand(
        printer, twin, lambda row: trace, layers, lambda: np.random.default_rng([case.seed, 2]), figures=_figures
    )


read_row = row


@dataclass(frozen=True)
class ObjectiveLine:
    """A fault's held-out layers planned for one objective, then measured: means over the layers.

    ``area_mm2`` a layer is what only one of print and target covers, in beads of `BEAD_MM`; ``frechet_mm`` is the
    discrete Fréchet distance.
    """

    family: str
    objective: str
    rmse_mm: float
    p95_mm: float
    area_mm2: float
    frechet_mm: float
    plan_s: float


def objectives_table(
    cases: Sequence[Case],
    objectives: Sequence[str],
    out: Path,
    *,
    learner: str = "greybox",
    executor: Executor = HERE,
    tick: Callable[[str], None] = lambda what: None,
) -> tuple[list[ObjectiveLine], list[Result]]:
    """Return a line a family and objective; keep results in ``out``/objectives.jsonl."""
    names = {f"{learner}+optimal" + ("" if name == "rmse" else f"-{name}"): name for name in objectives}
    check_rows(names)
    results = run(cases, tuple(names), out, executor, tick=tick)
    figures = ("rmse_mm", "p95_mm", "area_mm2", "frechet_mm", "plan_s")
    lines = [
        ObjectiveLine(item.case.family, names[item.row], *(item.values[name] for name in figures))
        for item in results
        if item.error is None
    ]
    return lines, results


def cells(line: ObjectiveLine) -> tuple[str, ...]:
    """Return a line as the table's texts, in the order of `HEADER`."""
    numbers = (line.rmse_mm, line.p95_mm, line.area_mm2, line.frechet_mm)
    return (line.family, line.objective, *(f"{number:.4f}" for number in numbers), f"{line.plan_s:.2f}")


def _figures(layers: Sequence[Layer], prints: Sequence[np.ndarray], printer: Printer) -> dict[str, Any]:
    pitch_mm = np.array(printer.mm_per_step)
    measured = [_measured(layer, printed, pitch_mm) for layer, printed in zip(layers, prints, strict=True)]
    names = ("rmse_mm", "p95_mm", "area_mm2", "frechet_mm")
    return dict(zip(names, map(float, np.mean(measured, axis=0)), strict=True))


def _measured(layer: Layer, printed: np.ndarray, pitch_mm: np.ndarray) -> tuple[float, float, float, float]:
    wanted_mm, printed_mm = layer.nominal_steps * pitch_mm, printed * pitch_mm
    distances = np.hypot(*(printed_mm - wanted_mm).T)
    area = bead_difference_area(_strokes(layer, wanted_mm), _strokes(layer, printed_mm), BEAD_MM)
    return rmse(wanted_mm, printed_mm), float(np.percentile(distances, 95)), area, frechet(wanted_mm, printed_mm)


def _strokes(layer: Layer, points_mm: np.ndarray) -> list[np.ndarray]:
    """Return the points [N, 2] of each run of extruding ticks."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], layer.extruding.astype(np.int8), [0]])))
    return [points_mm[begin : end + 1] for begin, end in edges.reshape(-1, 2)]
