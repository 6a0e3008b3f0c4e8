"""A planar machine, what is learned from, and the layers that are planned, printed and judged."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from printmend.metrics import rmse
from printmend.path import Trace
from printmend.printer import Printer
from printmend.protocols import WorldModel
from printmend.twin import Twin
from printmend_lab.bench.rows import Row
from printmend_lab.path import Body, Layer

Figures = Callable[[Sequence[Layer], Sequence[np.ndarray], Printer], dict[str, Any]]


def errors(layers: Sequence[Layer], prints: Sequence[np.ndarray], printer: Printer) -> dict[str, Any]:
    """Return the RMSE over all targets of all layers, in full steps and mm, and the number of targets."""
    targets, printed = np.concatenate([layer.nominal_steps for layer in layers]), np.concatenate(prints)
    pitch_mm = np.array(printer.mm_per_step)
    return {
        "rmse_steps": rmse(targets, printed),
        "rmse_mm": rmse(targets * pitch_mm, printed * pitch_mm),
        "targets": sum(layer.transitions for layer in layers),
    }


def covering_layer(body: Body, printer: Printer) -> Layer:
    """Return the layer that shows the most of a turn of the motor of which it shows less; of equals the longest.

    The paper learns from the longest (`Body.training_layer`), which may be a long infill on a short span.
    """

    def shown(layer: Layer) -> tuple[float, int]:
        spans = np.ptp(printer.to_motor(layer.nominal_steps), axis=0)
        turns = [min(span / printer.axes[k].steps_per_turn, 1.0) for k, span in enumerate(spans)]
        return min(turns), layer.transitions

    return max(body.layers, key=shown)


@dataclass(frozen=True, eq=False)
class LayerStand:
    """A case of planar layers: ``trace`` makes what a row's learner is shown, ``layers`` are planned and printed.

    ``rng`` makes a learner's generator, ``figures`` judge the prints, ``facts`` are said of every result.
    """

    printer: Printer
    twin: Twin
    trace: Callable[[Row], Trace]
    layers: tuple[Layer, ...]
    rng: Callable[[], np.random.Generator]
    figures: Figures = errors
    facts: Mapping[str, Any] = field(default_factory=dict)

    def measure(self, row: Row) -> Trace:
        return self.trace(row)

    def fit(self, measured: Trace, row: Row) -> WorldModel:
        return row.model(measured, self.printer, self.twin, self.rng())

    def judge(self, model: WorldModel, row: Row) -> dict[str, Any]:
        begun = time.perf_counter()
        plans = [row.controller.plan(model, layer.nominal_steps[1:], layer.start_steps) for layer in self.layers]
        plan_s = time.perf_counter() - begun
        prints = [
            self.twin.run(plan.controls, layer.start_steps) for plan, layer in zip(plans, self.layers, strict=True)
        ]
        left_to = {"left_to": plans[0].planner} if plans and plans[0].planner else {}
        return {**self.facts, **self.figures(self.layers, prints, self.printer), "plan_s": plan_s, **left_to}
