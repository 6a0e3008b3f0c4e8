"""`printmend bench objectives`: does it pay to plan for what one sees instead of for the paper's RMSE?

One body, one fault a family: learn from the training layer, plan held-out layers for each objective on the learned
model, print them on the twin, and measure every print by every metric.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from printmend.errors import InputError
from printmend.path import Body, Layer
from printmend.printer import Printer

BEAD_MM = 0.4
HEADER = ("fault", "planned for", "RMSE mm", "p95 mm", "area mm²", "Fréchet mm", "plan s")


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


def objective_lines(
    body: Body,
    printer: Printer,
    *,
    families: Sequence[str],
    objectives: Sequence[str],
    learner: str = "greybox",
    severity: Literal["damaged", "realistic"] = "damaged",
    layers: int = 2,
    seed: int = 0,
    tick: Callable[[str], None] = lambda what: None,
) -> list[ObjectiveLine]:
    """Return a line a family and objective; the layers and the faults are drawn from the seed.

    Raises `InputError` for a name that does not exist or a body without a layer to hold out.
    """
    import time

    from printmend.bench.rows import row
    from printmend.corruption import families as known
    from printmend.corruption import sample
    from printmend.learn.published.transitions import layer_trace
    from printmend.twin import Twin

    if unknown := [family for family in families if family not in known() or family == "gain-table"]:
        raise InputError(
            "--families", wanted=f"names out of {', '.join(known())}", came=repr(unknown[0]), todo="correct it"
        )
    rows = [(name, row(f"{learner}+optimal" + ("" if name == "rmse" else f"-{name}"))) for name in objectives]
    training = body.training_layer
    others = [layer for layer in body.layers if layer is not training]
    if not others:
        raise InputError(body.name, wanted="a layer besides the training layer", came="one", todo="take another body")
    drawn = np.random.default_rng(seed).choice(len(others), min(layers, len(others)), replace=False)
    lines = []
    for family in families:
        twin = Twin.of(sample(family, np.random.default_rng([seed, 1]), severity), printer)
        trace = layer_trace(training, twin.run(training.controls, training.start_steps), printer)
        model = rows[0][1].model(trace, printer, twin, np.random.default_rng([seed, 2]))
        for objective, chosen in rows:
            measured, plan_s = [], 0.0
            for layer in [others[index] for index in sorted(drawn)]:
                begun = time.perf_counter()
                plan = chosen.controller.plan(model, layer.nominal_steps[1:], layer.start_steps)
                plan_s += time.perf_counter() - begun
                printed = twin.run(plan.controls, layer.start_steps)
                measured.append(_measured(layer, printed, np.array(printer.mm_per_step)))
            rmse_mm, p95_mm, area_mm2, frechet_mm = map(float, np.mean(measured, axis=0))
            lines.append(ObjectiveLine(family, objective, rmse_mm, p95_mm, area_mm2, frechet_mm, plan_s))
            tick(f"{family} {objective}")
    return lines


def _measured(layer: Layer, printed: np.ndarray, pitch_mm: np.ndarray) -> tuple[float, float, float, float]:
    from printmend.metrics import rmse
    from printmend.metrics.shape import bead_difference_area, frechet

    wanted_mm, printed_mm = layer.nominal_steps * pitch_mm, printed * pitch_mm
    distances = np.hypot(*(printed_mm - wanted_mm).T)
    area = bead_difference_area(_strokes(layer, wanted_mm), _strokes(layer, printed_mm), BEAD_MM)
    return rmse(wanted_mm, printed_mm), float(np.percentile(distances, 95)), area, frechet(wanted_mm, printed_mm)


def _strokes(layer: Layer, points_mm: np.ndarray) -> list[np.ndarray]:
    """Return the points [N, 2] of each run of extruding ticks."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], layer.extruding.astype(np.int8), [0]])))
    return [points_mm[begin : end + 1] for begin, end in edges.reshape(-1, 2)]


def cells(line: ObjectiveLine) -> tuple[str, ...]:
    """Return a line as the table's texts, in the order of `HEADER`."""
    numbers = (line.rmse_mm, line.p95_mm, line.area_mm2, line.frechet_mm)
    return (line.family, line.objective, *(f"{number:.4f}" for number in numbers), f"{line.plan_s:.2f}")
