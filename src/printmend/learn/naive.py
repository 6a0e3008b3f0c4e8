"""The naive model: the printer is as designed."""

from dataclasses import dataclass

import numpy as np

from printmend.machine import Mechanism, healthy_mechanism
from printmend.path import Trace
from printmend.printer import Printer
from printmend.protocols import IncrementTables, State


@dataclass(frozen=True, eq=False)
class NaiveModel:
    """Imagine that every control moves the carriage by itself: the published Naive row (physics.md §8.1)."""

    printer: Printer

    @property
    def mechanism(self) -> Mechanism:
        """The machine as designed."""
        return healthy_mechanism(self.printer)

    def start(self, start_steps: np.ndarray) -> State:
        """Return the state [1] at the lattice point ``start_steps`` [2]."""
        return State.at(start_steps)

    def advance(self, state: State, controls: np.ndarray) -> State:
        """Return the states [K] after the controls [K, 2]."""
        controls = np.asarray(controls, np.int64)
        nominal = np.clip(state.nominal_steps + controls, 0, self.printer.bed_steps)
        return State(nominal, state.position_steps + controls)

    def tabulate(self, start_steps: np.ndarray, *, c_max: int = 3) -> IncrementTables:
        """Return displacement = control at every nominal position."""
        row = np.arange(-c_max, c_max + 1, dtype=float)
        x, y = (np.tile(row, (bed + 1, 1)) for bed in self.printer.bed_steps)
        return IncrementTables((x, y), c_max)


@dataclass(frozen=True)
class NaiveLearner:
    """Learn nothing."""

    name: str = "naive"

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> NaiveModel:
        """Return the printer as designed, whatever the trace says."""
        return NaiveModel(printer)


LEARNERS = {"naive": NaiveLearner()}
