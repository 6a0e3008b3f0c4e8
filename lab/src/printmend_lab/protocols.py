"""The protocol of a controller, and a machine of three axes as it sees it."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from printmend.machine import ScrewDrive
from printmend.printer import Printer
from printmend.protocols import WorldModel
from printmend_lab.path import Plan


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
