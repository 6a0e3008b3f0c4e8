"""Plans for what one sees of a print instead of the paper's RMSE: the optimal plan, improved by local search."""

from dataclasses import dataclass

import numpy as np

from printmend.machine import PlayTables
from printmend.protocols import WorldModel
from printmend_lab.control.check import tables_of
from printmend_lab.control.coupled import followed
from printmend_lab.control.kernels import refine as kernels
from printmend_lab.control.optimal import Optimal
from printmend_lab.path import Plan

_APART_TICKS = np.array([1, 2, 3, 4, 6, 9])  # between the two ends of an edit
_ROUNDS, _PASSES_A_ROUND = 8, 4  # over a plan, at most
_LEAST_SAVING = 1e-6  # of the area, as a share: a round that saves less is the last


@dataclass(frozen=True)
class LeastArea:
    """Plan as `Optimal` does, then make the area between print and target smaller by small edits on the model.

    An edit makes one step earlier or later: being early or late along the way costs little. Such an area is no sum that
    dynamic programming an axis could take. Never worse than `Optimal` by `area_cost`. Models without play tables are
    left to `Optimal`.
    """

    name: str = "optimal-area"

    def plan(self, model: WorldModel, targets_steps: np.ndarray, start_steps: np.ndarray, *, c_max: int = 3) -> Plan:
        """Choose controls [T, 2] for targets [T, 2] from ``start_steps`` [2]. Raise `InputError` off the bed."""
        plan = Optimal().plan(model, targets_steps, start_steps, c_max=c_max)
        tables = tables_of(model, np.asarray(start_steps, np.int64), c_max)
        if not isinstance(tables, PlayTables) or len(plan.controls) == 0:
            return plan
        wanted = np.concatenate([np.asarray(start_steps, float)[None], np.asarray(targets_steps, float)])
        best, least = plan, area_cost(wanted, plan.imagined_steps)
        print_ = planned_print(tables, plan, model.printer.to_motor(plan.controls.astype(np.int64)))
        for _ in range(_ROUNDS):
            for _ in range(_PASSES_A_ROUND):
                if kernels.refine(kernels.AREA, wanted, tables.arrays, print_, c_max, _APART_TICKS) == 0:
                    break
            value = area_cost(wanted, print_.bed)
            if value >= least * (1 - _LEAST_SAVING):
                break
            best, least = Plan(print_.controls[1:].astype(np.int8), print_.bed.copy()), value
        return best


def area_cost(wanted: np.ndarray, printed: np.ndarray) -> float:
    """Return the area between a print [T + 1, 2] and where it was wanted [T + 1, 2], in the square of their unit.

    It is counted tick by tick, so that a way gone twice counts twice, with a share of the squared distances;
    `shape` measures figures.
    """
    return float(kernels.total(kernels.AREA, wanted, printed))


def planned_print(tables: PlayTables, plan: Plan, moves: np.ndarray) -> kernels.Print:
    """Return a plan, whose motors make the ``moves`` [T, 2], as the kernels change it."""
    controls = np.concatenate([np.zeros((1, 2), np.int64), plan.controls])
    return kernels.Print(controls, *followed(tables, moves), plan.imagined_steps.copy())


CONTROLLERS = {"optimal-area": LeastArea()}
