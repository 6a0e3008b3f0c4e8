"""The protocols of a learner and a world model.

A planner never names a model. It reads a `Tables` value, which carries the hysteresis as part of the state, or, for
models that cannot be tabulated, calls `WorldModel.advance` on batches.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from printmend.machine import PlayTables
from printmend.path import Trace
from printmend.printer import Printer


@dataclass(frozen=True, eq=False)
class State:
    """N imagined machines: ``nominal_steps`` [N, 2] int64 (the sum of the controls, hence the motors' angles) and
    ``position_steps`` [N, 2] float (where the carriage is). ``memory`` [N, M] is all else that the model needs to
    continue (the belts' positions in their play, the layer's start); planners pass it on unread."""

    nominal_steps: np.ndarray
    position_steps: np.ndarray
    memory: np.ndarray | None = None

    @classmethod
    def at(cls, start_steps: np.ndarray) -> "State":
        """Return the state [1] of a memoryless model at the lattice point ``start_steps`` [2]."""
        start = np.asarray(start_steps, np.int64)
        return cls(start[None], start[None].astype(float))

    def __getitem__(self, k: int) -> "State":
        """Return the state [1] of machine k."""
        memory = None if self.memory is None else self.memory[k : k + 1]
        return State(self.nominal_steps[k : k + 1], self.position_steps[k : k + 1], memory)


@dataclass(frozen=True, eq=False)
class IncrementTables:
    """Memoryless increments per axis: position ← position + ``displacement_steps[axis][n, c + c_max]``.

    n is the nominal position on the lattice 0…bed; c the control in −c_max…c_max. The published models and the
    published simulator have this form (physics.md §8.1).
    """

    displacement_steps: tuple[np.ndarray, np.ndarray]
    c_max: int


@dataclass(frozen=True, eq=False)
class JointTables:
    """Memoryless increments of both axes together, for controls of one step an axis.

    position ← position + |c|·``unit_steps[cell_x, cell_y, sign_x + 1, sign_y + 1]`` [Bx, By, 3, 3, 2], where
    ``cells[axis][n]`` is the cell of nominal position n on the lattice 0…bed: the published "fast" rule (physics.md
    §8.1). With ``rolled`` the one-step model goes tick by tick instead: an axis that has made its |c| steps rests.
    """

    cells: tuple[np.ndarray, np.ndarray]
    unit_steps: np.ndarray
    rolled: bool = False


Tables = PlayTables | IncrementTables | JointTables


@runtime_checkable
class WorldModel(Protocol):
    """The model that a planner imagines with. Frozen; made by a learner, or from the true corruption (the Oracle)."""

    @property
    def printer(self) -> Printer: ...

    def start(self, start_steps: np.ndarray) -> State:
        """Return the state [1] of a layer that starts at the lattice point ``start_steps`` [2]."""
        ...

    def advance(self, state: State, controls: np.ndarray) -> State:
        """Return the states [K] after the controls [K, 2] are applied to ``state`` [1] or [K].

        Planners try controls up to ``c_max``; the ticks of a layer's trace have −1, 0 and 1.
        """
        ...

    def tabulate(self, start_steps: np.ndarray, *, c_max: int = 3) -> Tables | None:
        """Return the model as arrays, anchored so that the layer starts at ``start_steps``; None where it cannot be."""
        ...


class Learner(Protocol):
    """An algorithm that makes a world model from one measured print."""

    @property
    def name(self) -> str: ...

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> WorldModel:
        """Learn from a trace. Raise `TraceError` where it cannot support any model."""
        ...
