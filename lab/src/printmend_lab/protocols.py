"""The protocol of a controller, and the machines that it plans for: a learned one, and one of three axes."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from printmend.learn.mechanism_model import MechanismModel
from printmend.machine import GainMechanism, Mechanism, ScrewDrive
from printmend.printer import Printer
from printmend.protocols import State, Tables, WorldModel
from printmend_lab.path import Plan


class MachineLearned(ABC):
    """What a learner found, as a world model: it imagines with a machine of it, `imagined`."""

    @property
    @abstractmethod
    def imagined(self) -> Mechanism | GainMechanism:
        """The machine to imagine with."""

    @cached_property
    def _model(self) -> MechanismModel:
        return MechanismModel(self.imagined)

    @property
    def printer(self) -> Printer:
        return self.imagined.printer

    def start(self, start_steps: np.ndarray) -> State:
        """Return the state [1] of a layer that starts at the lattice point ``start_steps`` [2]."""
        return self._model.start(start_steps)

    def advance(self, state: State, controls: np.ndarray) -> State:
        """Return the states [K] after the controls [K, 2]."""
        return self._model.advance(state, controls)

    def tabulate(self, start_steps: np.ndarray, *, c_max: int = 3) -> Tables | None:
        """Return the machine as play tables, or as the published increments."""
        return self._model.tabulate(start_steps, c_max=c_max)


@dataclass(frozen=True, eq=False)
class SpaceModel:
    """A machine of three axes as a planner sees it; without a ``screw`` Z is as commanded and pushes nothing."""

    planar: WorldModel
    screw: ScrewDrive | None = None

    @property
    def printer(self) -> Printer:
        return self.planar.printer


class Controller(Protocol):
    """An algorithm that chooses controls, one for each target."""

    @property
    def name(self) -> str: ...

    def plan(self, model: WorldModel, targets_steps: np.ndarray, start_steps: np.ndarray, *, c_max: int = 3) -> Plan:
        """Choose controls [T, 2] in {−c_max…c_max}² for targets [T, 2] from ``start_steps`` [2]."""
        ...
