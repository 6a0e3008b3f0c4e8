"""World models that are mechanisms: the naive one, and one over a machine, the true or a learned one."""

from dataclasses import dataclass

import numpy as np

from printmend.machine import GainMechanism, Mechanism, healthy_mechanism, lattice_tables
from printmend.machine.kernels import run
from printmend.path import Trace
from printmend.printer import Printer
from printmend.protocols import IncrementTables, State, Tables
from printmend.twin import kernels


@dataclass(frozen=True, eq=False)
class MechanismModel:
    """Imagine with a `Mechanism` as `Twin.run` prints with it, or with a `GainMechanism` by the published rules.

    The published rules do not clip the imagined position to the bed (physics.md §8.1); the twin does.
    """

    mechanism: Mechanism | GainMechanism

    @property
    def printer(self) -> Printer:
        return self.mechanism.printer

    def start(self, start_steps: np.ndarray) -> State:
        """Return the state [1] at the lattice point ``start_steps`` [2], with the play of each belt centred."""
        start = np.asarray(start_steps, np.int64)
        memory = np.concatenate([self.printer.to_motor(start), start]).astype(float)
        return State(start[None], start[None].astype(float), memory[None])

    def advance(self, state: State, controls: np.ndarray) -> State:
        """Return the states [K] after the controls [K, 2]. Raise `InputError` where a motor would leave its tables."""
        controls = np.asarray(controls, np.int64)
        if isinstance(self.mechanism, GainMechanism):
            return _advance_gains(self.mechanism, state, controls)
        nominal = state.nominal_steps + controls
        count = len(nominal)
        assert state.memory is not None
        memory = np.broadcast_to(state.memory, (count, 4))
        belts, starts = memory[:, :2], memory[:, 2:]
        motors = self.printer.to_motor(nominal)
        after, position = np.empty((count, 2)), np.empty((count, 2))
        for start in np.unique(starts, axis=0):
            mine = (starts == start).all(axis=1)
            tables = lattice_tables(self.mechanism, start.astype(np.int64))
            for k, motor in enumerate(tables.motors):
                index = motors[mine, k] - motor.first_step
                motor.check(index)
                held = np.empty(len(index))
                run.clip_each(belts[mine, k], motor.lower_steps[index], motor.upper_steps[index], held)
                after[mine, k] = held
            position[mine] = tables.bed.printed(after[mine])
        return State(nominal, position, np.concatenate([after, starts], axis=1))

    def tabulate(self, start_steps: np.ndarray, *, c_max: int = 3) -> Tables | None:
        """Return play tables anchored at the start, or the published increments."""
        if isinstance(self.mechanism, GainMechanism):
            return gain_tables(self.mechanism, c_max)
        return lattice_tables(self.mechanism, start_steps)


def _advance_gains(mechanism: GainMechanism, state: State, controls: np.ndarray) -> State:
    bed = np.array(mechanism.printer.bed_steps)
    nominal = np.broadcast_to(state.nominal_steps, (len(controls), 2)).astype(np.int64)
    moved, each = np.empty((len(controls), 2)), np.empty(len(controls))
    for axis in range(2):
        kernels.displace(nominal[:, axis].copy(), controls[:, axis].copy(), mechanism.gains[axis], each)
        moved[:, axis] = each
    return State(np.clip(nominal + controls, 0, bed), state.position_steps + moved, state.memory)


def gain_tables(mechanism: GainMechanism, c_max: int) -> IncrementTables:
    """Tabulate the published displacement at every nominal position of the bed and every control."""
    tables = []
    for axis, bed in enumerate(mechanism.printer.bed_steps):
        table = np.empty((bed + 1, 2 * c_max + 1))
        kernels.tabulate_gain(mechanism.gains[axis], table)
        tables.append(table)
    return IncrementTables((tables[0], tables[1]), c_max)


# The naive model: the printer is as designed.


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
