"""The rows of a table: how each makes its world model, and which controller plans with it.

A row is named LEARNER, LEARNER+CONTROLLER or LEARNER+CONTROLLER@SIGMA: `lightgbm`, `greybox+lookahead`,
`my_module:MINE+optimal@0.05`; SIGMA is the noise of the measurement in mm. The learner `oracle` is given the true
mechanism. Without a controller it is the paper's greedy Algorithm 1. `optimum` is `oracle+optimal`: the lower bound.
"""

from collections.abc import Hashable, Iterable
from dataclasses import dataclass

import numpy as np

from printmend.errors import InputError
from printmend.extras import require
from printmend.learn.registry import check_model_name, fit, fitted
from printmend.path import Trace
from printmend.printer import Printer
from printmend.protocols import Learner, WorldModel
from printmend.twin import Twin
from printmend_lab.control.registry import controller
from printmend_lab.protocols import Controller

OPTIMUM = "optimum"
PAPER_ROWS = ("naive", "lightgbm", "lightgbm-axis", "forest", "forest-axis", "greybox", "oracle", OPTIMUM)
_LIBRARIES = {"lightgbm": "lightgbm", "forest": "sklearn", "knn": "sklearn", "linear": "sklearn"}  # by learner's name
MAX_NOISE_MM = 10.0  # of a coordinate, standard deviation


@dataclass(frozen=True)
class Row:
    """One row of a table: a learner's name, the controller, the noise of the measurement, and, where test prints are
    compared, which is printed and at how many points it is measured. ``own`` is a learner that has no name here."""

    learner: str
    controller: Controller
    own: Learner | None = None
    noise_mm: float = 0.0
    test_print: str = ""
    points: int = 0

    @property
    def lesson(self) -> Hashable:
        """What decides the model: rows that share it learn once."""
        return self.learner, self.test_print, self.points, self.noise_mm

    def model(self, trace: Trace, printer: Printer, twin: Twin, rng: np.random.Generator) -> WorldModel:
        """Learn from the trace; the oracle looks at the twin instead."""
        if self.own is not None:
            return fitted(self.own, trace, printer, rng=rng)
        return fit(self.learner, trace, printer, rng=rng, truth=twin.mechanism)


def row(name: str) -> Row:
    """Return the row of that name. Raise `ConfigError` or `InputError` where a part of it does not exist."""
    label, noise_mm = row_parts(name)
    model, _, planner = ("oracle+optimal" if label == OPTIMUM else label).partition("+")
    check_model_name(model)
    return Row(model, controller(planner or "greedy"), noise_mm=noise_mm)


def libraries(names: Iterable[str]) -> tuple[str, ...]:
    """Return the libraries of extras that these rows learn with. Raise `InputError` for a row that does not exist."""
    learners = {row(name).learner.partition("-")[0] for name in names}
    return tuple(sorted({library for name, library in _LIBRARIES.items() if name in learners}))


def check_rows(names: Iterable[str]) -> None:
    """Raise `InputError` for a row that does not exist, `MissingToolError` where its library is missing."""
    require("the rows of this table", *libraries(names))


def row_parts(name: str) -> tuple[str, float]:
    """Split ROW@SIGMA. Raise `InputError` for a noise that is no length."""
    label, _, noise = name.partition("@")
    return label, read_noise(noise)


def read_noise(text: str) -> float:
    """Read a noise in mm, none where nothing is said. Raise `InputError` for one that is no length."""
    try:
        noise_mm = float(text or 0.0)
    except ValueError:
        noise_mm = -1.0
    if not 0.0 <= noise_mm <= MAX_NOISE_MM:
        raise InputError("noise", wanted=f"0 to {MAX_NOISE_MM:g} mm", came=repr(text), todo="correct it")
    return noise_mm


def planned_for(name: str, objective: str) -> str:
    """Return the name of a row that plans as well as possible for ``objective``: rmse or area.

    The naive row, which shows what was broken, and the optimum of the RMSE stay as they are.
    """
    if name in ("naive", OPTIMUM):
        return name
    return name.partition("+")[0] + "+optimal" + ("" if objective == "rmse" else f"-{objective}")
