"""The seams: what a learner, a world model and a controller are.

A planner never names a model. It reads a `Tables` value, which carries the hysteresis as part of the state, or, for
models that cannot be tabulated, calls `WorldModel.advance` on batches.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from printmend.machine.mechanism import Frame, ScrewDrive
from printmend.path import Plan, Trace, frozen
from printmend.printer import Printer


@dataclass(frozen=True, eq=False)
class State:
    """N imagined machines: ``nominal_steps`` [N, 2] int64 (the sum of the controls, hence the motors' angles)
    and ``position_steps`` [N, 2] float (where the carriage is). ``memory`` [N, M] is whatever else the model needs
    to go on from here (the belts' positions in their play, the layer's start); planners pass it on unread."""

    nominal_steps: np.ndarray
    position_steps: np.ndarray
    memory: np.ndarray | None = None

    def __getitem__(self, k: int) -> "State":
        """Return the state [1] of machine k."""
        memory = None if self.memory is None else self.memory[k : k + 1]
        return State(self.nominal_steps[k : k + 1], self.position_steps[k : k + 1], memory)


@dataclass(frozen=True, eq=False)
class LatticeFrame:
    """A crooked frame in full steps: bed position = belts + ``coefficients_steps`` [2, 10] · monomials of
    (belts + ``origin_steps``) / ``scale_steps`` in the order of `Frame.exponents`. The constant terms hold the anchor:
    the start maps to itself."""

    coefficients_steps: np.ndarray
    origin_steps: np.ndarray
    scale_steps: np.ndarray

    def __post_init__(self) -> None:
        for name in ("coefficients_steps", "origin_steps", "scale_steps"):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), float)))

    def apply(self, belts_steps: np.ndarray) -> np.ndarray:
        """Map belt positions along x and y [..., 2] to the bed [..., 2]."""
        u, v = np.moveaxis((belts_steps + self.origin_steps) / self.scale_steps, -1, 0)
        terms = np.stack([u**p * v**q for p, q in Frame.exponents], axis=-1)
        return belts_steps + terms @ self.coefficients_steps.T

    def invert(self, bed_steps: np.ndarray) -> np.ndarray:
        """Return the belt positions whose image is ``bed_steps`` [..., 2], by fixed-point iteration."""
        belts = np.asarray(bed_steps, float)
        for _ in range(60):
            step = bed_steps - self.apply(belts)
            belts = belts + step
            if np.abs(step).max(initial=0.0) < 1e-10:
                break
        return belts

    def slopes(self, belts_steps: np.ndarray) -> np.ndarray:
        """Return the derivatives of the bed position by the belts' [..., 2, 2]."""
        u, v = np.moveaxis((belts_steps + self.origin_steps) / self.scale_steps, -1, 0)
        by_u = np.stack([p * u ** max(p - 1, 0) * v**q for p, q in Frame.exponents], axis=-1)
        by_v = np.stack([q * u**p * v ** max(q - 1, 0) for p, q in Frame.exponents], axis=-1)
        terms = np.stack([by_u / self.scale_steps[0], by_v / self.scale_steps[1]], axis=-1)
        return np.eye(2) + self.coefficients_steps @ terms


@dataclass(frozen=True, eq=False)
class PlayTables:
    """Hysteretic, conservative: per motor, position ← clip(position, lower[m], upper[m]) [full steps].

    ``lower_steps`` and ``upper_steps`` are pairs of arrays; entry i stands for motor position
    ``first_steps[motor] + i``. ``corexy`` says that motors are a = x + y, b = x − y of the controls. ``frame``, where
    it is not None, maps the belts' x and y to the bed.
    """

    lower_steps: tuple[np.ndarray, np.ndarray]
    upper_steps: tuple[np.ndarray, np.ndarray]
    first_steps: tuple[int, int]
    corexy: bool = False
    frame: LatticeFrame | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "lower_steps", tuple(frozen(np.asarray(t, float)) for t in self.lower_steps))
        object.__setattr__(self, "upper_steps", tuple(frozen(np.asarray(t, float)) for t in self.upper_steps))


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
    """What a planner imagines with. Frozen; made by a learner, or from the true corruption (the Oracle)."""

    @property
    def printer(self) -> Printer: ...

    def start(self, start_steps: np.ndarray) -> State:
        """Return the state [1] of a layer that starts at the lattice point ``start_steps`` [2]."""
        ...

    def advance(self, state: State, controls: np.ndarray) -> State:
        """Return the states [K] after the controls [K, 2] are applied to ``state`` [1] or [K]."""
        ...

    def tabulate(self, start_steps: np.ndarray, *, c_max: int = 3) -> Tables | None:
        """Return the model as arrays, anchored so that the layer starts at ``start_steps``; None where it cannot be."""
        ...


@dataclass(frozen=True, eq=False)
class SpaceModel:
    """A machine of three axes as a planner sees it; without a ``screw`` Z is as commanded and pushes nothing."""

    planar: WorldModel
    screw: ScrewDrive | None = None

    @property
    def printer(self) -> Printer:
        return self.planar.printer


class Learner(Protocol):
    """An algorithm that makes a world model from one measured print."""

    @property
    def name(self) -> str: ...

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> WorldModel:
        """Learn from a trace. Raise `TraceError` where it cannot support any model."""
        ...


class Controller(Protocol):
    """An algorithm that chooses controls, one for each target."""

    @property
    def name(self) -> str: ...

    def plan(self, model: WorldModel, targets_steps: np.ndarray, start_steps: np.ndarray, *, c_max: int = 3) -> Plan:
        """Choose controls [T, 2] in {−c_max…c_max}² for targets [T, 2] from ``start_steps`` [2]."""
        ...
