"""A machine of three axes in the families table: a bad Z screw, alone or with broken belts.

The body is a tower as many turns of the screw high as it is turns of a motor across. Its whole print is measured; then
another tower is planned and printed. Errors are distances in space, in full steps of X.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from printmend.path import Trace
from printmend.printer import Printer
from printmend.twin import Twin
from printmend_lab.bench.drawn_body import drawn_tower
from printmend_lab.bench.rows import Row
from printmend_lab.body.space import SpacePath, space_path
from printmend_lab.control.space import plan_space
from printmend_lab.protocols import SpaceModel
from printmend_lab.space import fit_space, space_trace

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
