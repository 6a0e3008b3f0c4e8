"""Plans from the most promising states alone, ranked by what each motor still costs (physics.md eq. 25, cure 3)."""

from dataclasses import dataclass

import numpy as np

from printmend.control.check import check_plan, tables_of
from printmend.control.coupled import Breadth, plan_coupled
from printmend.control.greedy import Greedy
from printmend.path import Plan
from printmend.protocols import PlayTables, WorldModel

# States that are so far behind the best, in squared steps, hardly ever lead to the best plan.
_SLACK = 0.6


@dataclass(frozen=True)
class Beam:
    """Follow at most ``width`` states of both motors together, and never go back for more, as `Optimal` does.

    The faster one where motors couple (CoreXY: both turn for every move; a crooked frame: x depends on y). Never worse
    than `Greedy` and `Lookahead` on the model.
    """

    width: int = 32
    name: str = "beam"

    def plan(self, model: WorldModel, targets_steps: np.ndarray, start_steps: np.ndarray, *, c_max: int = 3) -> Plan:
        """Choose controls [T, 2] for targets [T, 2] from ``start_steps`` [2]. Raise `InputError` off the bed."""
        targets, start = check_plan(model.printer, targets_steps, start_steps, c_max)
        tables = tables_of(model, start, c_max)
        if not isinstance(tables, PlayTables) or len(targets) == 0:
            return Greedy().plan(model, targets, start, c_max=c_max)
        return plan_coupled(model, tables, targets, start, c_max, Breadth(_SLACK, _SLACK, self.width))


CONTROLLERS = {"beam": Beam()}
