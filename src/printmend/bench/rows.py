"""The rows of Table I: how each makes its world model, and which controller plans with it.

A row is named LEARNER or LEARNER+CONTROLLER: `lightgbm`, `greybox+lookahead`, `my_module:MINE+optimal`. The learner
`oracle` is given the true mechanism. Without a controller it is the paper's greedy Algorithm 1. `optimum` is
`oracle+optimal`: the lower bound.
"""

from dataclasses import dataclass

import numpy as np

from printmend.control.registry import controller
from printmend.learn.registry import check_model_name, fit, fitted
from printmend.path import Trace
from printmend.printer import Printer
from printmend.protocols import Controller, Learner, WorldModel
from printmend.twin import Twin

OPTIMUM = "optimum"
PAPER_ROWS = ("naive", "lightgbm", "lightgbm-axis", "forest", "forest-axis", "greybox", "oracle", OPTIMUM)


@dataclass(frozen=True)
class Row:
    """One row of a table: a learner's name and the controller."""

    learner: str
    controller: Controller

    def model(self, trace: Trace, printer: Printer, twin: Twin, rng: np.random.Generator) -> WorldModel:
        """Learn from the trace; the oracle looks at the twin instead."""
        return fit(self.learner, trace, printer, rng=rng, truth=twin.mechanism)


@dataclass(frozen=True)
class OwnRow:
    """A row whose learner has no name here."""

    learner: Learner
    controller: Controller

    def model(self, trace: Trace, printer: Printer, twin: Twin, rng: np.random.Generator) -> WorldModel:
        """Learn from the trace."""
        return fitted(self.learner, trace, printer, rng=rng)


def row(name: str) -> Row:
    """Return the row of that name. Raise `ConfigError` where its learner or its controller does not exist."""
    model, _, planner = ("oracle+optimal" if name == OPTIMUM else name).partition("+")
    check_model_name(model)
    return Row(model, controller(planner or "greedy"))


def planned_for(name: str, objective: str) -> str:
    """Return the name of a row that plans as well as possible for ``objective``: rmse, p95, area or frechet.

    The naive row, which shows what was broken, and the optimum of the RMSE stay as they are.
    """
    if name in ("naive", OPTIMUM):
        return name
    return name.partition("+")[0] + "+optimal" + ("" if objective == "rmse" else f"-{objective}")
