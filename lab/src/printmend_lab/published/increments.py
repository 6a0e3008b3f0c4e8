"""World models without memory: a control moves the carriage by an amount that depends on the nominal position."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from printmend.errors import TraceError
from printmend.machine import Mechanism, healthy_transmission
from printmend.path import Trace, frozen
from printmend.printer import Printer
from printmend.protocols import IncrementTables, JointTables, State, Tables, WorldModel
from printmend_lab.path import Layer

# From a trace to what the published learners read: one row a tick, in full steps.

# A way-point this close to the lattice (in steps) is on it: far below a micro-step, far above rounding.
_ON_LATTICE = 1e-6


# A move shorter than this (in steps) says nothing of one step's displacement, only of the measurement's noise.
_SHORTEST = 0.5


@dataclass(frozen=True, eq=False)
class Transitions:
    """N ticks: ``nominal_steps`` [N, 2] before, ``controls`` [N, 2] in {−1, 0, 1}, ``displacement_steps`` [N, 2]."""

    nominal_steps: np.ndarray
    controls: np.ndarray
    displacement_steps: np.ndarray

    def __len__(self) -> int:
        return len(self.nominal_steps)


def transitions_of(trace: Trace, printer: Printer) -> Transitions:
    """Return the ticks of the moves whose two ends were measured, in the order of motion.

    A layer's trace gives back its controls. A longer move is walked on the lattice: its ticks share its measured
    displacement, in proportion. Rows of different layers are not joined: each layer is a print of its own
    (paper §III). Raise `TraceError` where no tick remains.
    """
    low_mm, pitch_mm = np.array([printer.x.min_mm, printer.y.min_mm]), np.array(printer.mm_per_step)
    commanded = (trace.commanded_mm - low_mm) / pitch_mm
    lattice = np.rint(commanded)
    commanded = np.where(np.abs(commanded - lattice) < _ON_LATTICE, lattice, commanded)
    usable = trace.measured_rows[:-1] & trace.measured_rows[1:]
    if trace.layer is not None:
        usable &= trace.layer[:-1] == trace.layer[1:]
    start, moved = commanded[:-1][usable], np.diff(commanded, axis=0)[usable]
    measured = np.diff(trace.measured_mm, axis=0)[usable] / pitch_mm

    ticks = np.maximum(np.ceil(np.abs(moved).max(axis=1, initial=0.0)), 1.0).astype(np.int64)
    move = np.repeat(np.arange(len(ticks)), ticks)
    tick = np.arange(len(move)) - np.repeat(np.cumsum(ticks) - ticks, ticks)
    share = np.stack([tick, tick + 1], axis=1) / ticks[move, None]
    # Halves always up: rounding them to even could skip a lattice point.
    before, after = (np.floor(start[move] + moved[move] * share[:, end, None] + 0.5) for end in range(2))
    controls = after - before
    long = np.abs(moved) >= _SHORTEST
    gain = measured / np.where(long, moved, 1.0)
    rest = np.where(moved == 0.0, measured / ticks[:, None], 0.0)
    displacement = np.where(controls != 0, controls * gain[move], rest[move])
    kept = controls.any(axis=1) & (long[move] | (controls == 0)).all(axis=1)
    if not kept.any():
        raise TraceError(
            "trace",
            wanted="at least one commanded move with both ends measured",
            came=f"{int(trace.measured_rows.sum())} measured rows of {len(trace)}, no two neighbours that move",
            todo="measure neighbouring way-points",
        )
    return Transitions(before[kept], controls[kept], displacement[kept])


def layer_trace(layer: Layer, printed_steps: np.ndarray, printer: Printer) -> Trace:
    """Return the trace of a layer printed by its own controls: one row a tick, ``printed_steps`` [T + 1, 2]."""
    low_mm, pitch_mm = np.array([printer.x.min_mm, printer.y.min_mm]), np.array(printer.mm_per_step)
    return Trace(low_mm + layer.nominal_steps * pitch_mm, low_mm + np.asarray(printed_steps) * pitch_mm)


class UnitModel(WorldModel, Protocol):
    """A memoryless model that knows what one step does."""

    def unit_displacement(self, nominal: np.ndarray, signs: np.ndarray) -> np.ndarray:
        """Return the displacement [K, 2] of controls [K, 2] in {−1, 0, 1} from nominal positions [K, 2]."""
        ...


def moved(state: State, controls: np.ndarray, displacement: np.ndarray, printer: Printer) -> State:
    """Return the states [K] after controls [K, 2]: nominal clipped to the bed, imagined not (physics.md §8.1)."""
    nominal = np.clip(state.nominal_steps + controls, 0, printer.bed_steps)
    return State(nominal, state.position_steps + displacement)


class JointUnits:
    """What joint models share, whatever predicts one step: where they begin, and that a control is |c| steps."""

    printer: Printer

    def unit_displacement(self, nominal: np.ndarray, signs: np.ndarray) -> np.ndarray:
        """Return the predicted displacement [K, 2] of one tick; an axis at rest stays."""
        raise NotImplementedError

    def start(self, start_steps: np.ndarray) -> State:
        """Return the state [1] at the lattice point ``start_steps`` [2]."""
        return State.at(start_steps)

    def advance(self, state: State, controls: np.ndarray) -> State:
        """Return the states [K] after the controls [K, 2]: the prediction for their signs, times |c|."""
        controls = np.asarray(controls, np.int64)
        nominal = np.broadcast_to(state.nominal_steps, (len(controls), 2))
        unit = self.unit_displacement(nominal, np.sign(controls))
        return moved(state, controls, unit * np.abs(controls), self.printer)


@dataclass(frozen=True, eq=False)
class AxisModel:
    """Axes that know nothing of each other: a control c from nominal position n moves its axis by c·gain[n].

    ``gains`` is a pair of arrays [bed + 1]: the predictions of a per-axis learner at every lattice position. This is
    all that planning needs of the learner, so it is also what a saved model holds.
    """

    printer: Printer
    gains: tuple[np.ndarray, np.ndarray]

    def __post_init__(self) -> None:
        object.__setattr__(self, "gains", tuple(frozen(np.asarray(row, float)) for row in self.gains))

    def start(self, start_steps: np.ndarray) -> State:
        """Return the state [1] at the lattice point ``start_steps`` [2]."""
        return State.at(start_steps)

    def unit_displacement(self, nominal: np.ndarray, signs: np.ndarray) -> np.ndarray:
        """Return the displacement [K, 2] of one step of each axis in the directions ``signs`` [K, 2]."""
        return np.stack([self.gains[axis][nominal[:, axis]] for axis in range(2)], axis=1) * signs

    def advance(self, state: State, controls: np.ndarray) -> State:
        """Return the states [K] after the controls [K, 2]: one step's prediction times |c|."""
        controls = np.asarray(controls, np.int64)
        nominal = np.broadcast_to(state.nominal_steps, (len(controls), 2))
        return moved(state, controls, self.unit_displacement(nominal, controls), self.printer)

    def tabulate(self, start_steps: np.ndarray, *, c_max: int = 3) -> IncrementTables:
        """Return c·gain[n] for every nominal position and control."""
        controls = np.arange(-c_max, c_max + 1)
        return IncrementTables((self.gains[0][:, None] * controls, self.gains[1][:, None] * controls), c_max)

    @cached_property
    def mechanism(self) -> Mechanism | None:
        """The nearest conservative machine, without play: X[n + 1] − X[n] = the mean of gain[n] and gain[n + 1].

        A step forward from n is predicted as gain[n] and the step back from n + 1 as gain[n + 1]; a machine must
        return to where it was, so it gets their mean (gains below 0 count as 0). None on a CoreXY, whose motors are
        not its axes.
        """
        if self.printer.kinematics != "cartesian":
            return None
        drives = []
        for motor in range(2):
            healthy, axis = healthy_transmission(self.printer, motor), self.printer.axes[motor]
            gain = np.maximum(self.gains[motor], 0.0)
            error = np.concatenate([[0.0], np.cumsum((gain[1:] + gain[:-1]) / 2 - 1.0)]) * axis.mm_per_step
            lattice_mm = axis.min_mm + np.arange(len(error)) * axis.mm_per_step
            position = healthy.motor_mm + np.interp(healthy.motor_mm, lattice_mm, error)
            drives.append(type(healthy)(healthy.first_mm, healthy.pitch_mm, position, position))
        return Mechanism(self.printer, (drives[0], drives[1]))


@dataclass(frozen=True, eq=False)
class Rolled:
    """The exact mode of Algorithm 1: a control of |c| steps is |c| ticks of the one-step model, not |c| times one.

    An axis that has made its steps rests while the other goes on.
    """

    base: UnitModel

    @property
    def printer(self) -> Printer:
        return self.base.printer

    def start(self, start_steps: np.ndarray) -> State:
        """Return the state [1] at the lattice point ``start_steps`` [2]."""
        return self.base.start(start_steps)

    def advance(self, state: State, controls: np.ndarray) -> State:
        """Return the states [K] after the controls [K, 2]."""
        controls = np.asarray(controls, np.int64)
        nominal = np.broadcast_to(state.nominal_steps, (len(controls), 2))
        displacement = np.zeros((len(controls), 2))
        for tick in range(int(np.abs(controls).max(initial=0))):
            signs = np.sign(controls) * (np.abs(controls) > tick)
            displacement = displacement + self.base.unit_displacement(nominal, signs)
            nominal = np.clip(nominal + signs, 0, self.printer.bed_steps)
        return moved(state, controls, displacement, self.printer)

    def tabulate(self, start_steps: np.ndarray, *, c_max: int = 3) -> Tables | None:
        """Return the base model's tables, rolled."""
        unit = self.base.tabulate(start_steps, c_max=1)
        if isinstance(unit, JointTables):
            return JointTables(unit.cells, unit.unit_steps, rolled=True)
        if not isinstance(unit, IncrementTables):
            return None
        tables = [rolled_table(table, c_max) for table in unit.displacement_steps]
        return IncrementTables((tables[0], tables[1]), c_max)


def rolled_table(unit: np.ndarray, c_max: int) -> np.ndarray:
    """Roll one-step displacements [n, 3] to controls −c_max…c_max: [n, 2·c_max + 1]."""
    last = len(unit) - 1
    table = np.zeros((len(unit), 2 * c_max + 1))
    for sign in (-1, 1):
        nominal = np.arange(len(unit))
        for c in range(1, c_max + 1):
            table[:, c_max + sign * c] = table[:, c_max + sign * (c - 1)] + unit[nominal, 1 + sign]
            nominal = np.clip(nominal + sign, 0, last)
    return table


class UnitLearner(Protocol):
    """A learner of memoryless one-step models."""

    @property
    def name(self) -> str: ...

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> UnitModel: ...


@dataclass(frozen=True)
class RolledLearner:
    """A learner whose model is rolled."""

    name: str
    base: UnitLearner

    def fit(self, trace: Trace, printer: Printer, *, rng: np.random.Generator) -> Rolled:
        """Fit the base learner. Raise `TraceError` where it does."""
        return Rolled(self.base.fit(trace, printer, rng=rng))
