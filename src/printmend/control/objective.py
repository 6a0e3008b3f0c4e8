"""Plans for what one sees of a print instead of the paper's RMSE: the optimal plan, improved by local search."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from printmend.control.check import tables_of
from printmend.control.greedy import first_motors, frame_arrays
from printmend.control.kernels import refine as kernels
from printmend.control.optimal import Optimal
from printmend.control.window import followed
from printmend.path import Plan
from printmend.protocols import PlayTables, WorldModel

Objective = Literal["p95", "area", "frechet"]
OBJECTIVES: tuple[Objective, ...] = ("p95", "area", "frechet")
_KINDS = {"p95": kernels.P95, "area": kernels.AREA, "frechet": kernels.FRECHET}
# Ticks between the two ends of an edit.
_APART = np.array([1, 2, 3, 4, 6, 9])
# Rounds, each with a threshold a little below what has been reached; passes over the plan in each.
_ROUNDS, _PASSES = 8, 4
_BELOW = 0.9


@dataclass(frozen=True)
class Refined:
    """`Optimal`, then small edits that make an objective smaller on the model: a step earlier or later here and there.

    ``p95``: the 95th percentile of the distances from the targets. ``area``: what lies between the nozzle's way and
    the target's; being early or late along the way costs little. ``frechet``: the longest leash of two walkers along
    both (discrete Fréchet). None of them is a sum that dynamic programming an axis could take. Never worse than
    `Optimal` by its objective. Models without play tables are left to `Optimal`.
    """

    objective: Objective

    @property
    def name(self) -> str:
        """The name in the registry."""
        return f"optimal-{self.objective}"

    def plan(self, model: WorldModel, targets_steps: np.ndarray, start_steps: np.ndarray, *, c_max: int = 3) -> Plan:
        """Choose controls [T, 2] for targets [T, 2] from ``start_steps`` [2]. Raise `InputError` off the bed."""
        plan = Optimal().plan(model, targets_steps, start_steps, c_max=c_max)
        start = np.asarray(start_steps, np.int64)
        tables = tables_of(model, start, c_max)
        if not isinstance(tables, PlayTables) or len(plan.controls) == 0:
            return plan
        wanted = np.concatenate([start[None], np.asarray(targets_steps, float)])
        best, least = plan, objective_value(self.objective, wanted, plan.imagined_steps)
        state = _Search.of(model, tables, plan, start)
        for _ in range(_ROUNDS):
            threshold = _BELOW * objective_value(self.objective, wanted, state.bed)
            for _ in range(_PASSES):
                if state.go(_KINDS[self.objective], wanted, tables, threshold, c_max) == 0:
                    break
            value = objective_value(self.objective, wanted, state.bed)
            if value >= least * (1 - 1e-6):
                break
            best, least = Plan(state.controls[1:].astype(np.int8), state.bed.copy()), value
        return best


def objective_value(objective: Objective, wanted: np.ndarray, printed: np.ndarray) -> float:
    """Return an objective of a print [T + 1, 2] that was to be at ``wanted`` [T + 1, 2], in the units of both.

    ``area`` is counted tick by tick, so that a way gone twice counts twice, with a share of the squared distances;
    `metrics.shape` measures figures. The leash
    of ``frechet`` may be a few ticks long at most.
    """
    if objective == "area":
        return float(kernels.total(kernels.AREA, wanted, printed, 0.0))
    if objective == "frechet":
        return float(kernels.leash(wanted, printed))
    return float(np.percentile(np.hypot(*(printed - wanted).T), 95))


@dataclass(frozen=True, eq=False)
class _Search:
    """A plan as the kernels change it: every array has a row [T + 1] a tick, the start first."""

    controls: np.ndarray
    motors: np.ndarray
    belts: np.ndarray
    bed: np.ndarray

    @classmethod
    def of(cls, model: WorldModel, tables: PlayTables, plan: Plan, start: np.ndarray) -> "_Search":
        controls = np.concatenate([np.zeros((1, 2), np.int64), plan.controls])
        origin = model.printer.to_motor(start)
        motors, belts = followed(tables, first_motors(model.printer, tables, start), origin, plan.controls)
        return cls(controls, motors, belts, plan.imagined_steps.copy())

    def go(self, kind: int, wanted: np.ndarray, tables: PlayTables, threshold: float, c_max: int) -> int:
        """Pass over the plan once; return how many edits were kept."""
        (lower_a, lower_b), (upper_a, upper_b) = tables.lower_steps, tables.upper_steps
        return int(
            kernels.refine(
                kind, wanted, self.controls, self.motors, self.belts, self.bed, lower_a, upper_a, lower_b, upper_b,
                tables.corexy, *frame_arrays(tables), threshold, c_max, _APART,
            )
        )  # fmt: skip


CONTROLLERS = {refined.name: refined for refined in map(Refined, OBJECTIVES)}
