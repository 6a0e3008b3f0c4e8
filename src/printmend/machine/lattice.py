"""A machine on the full-step lattice, as in the paper's experiment: its motors' tables, anchored at a layer's start.

Twins print with these tables, and planners predict with them through the same kernels, so both agree.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from printmend.errors import InputError
from printmend.machine.kernels import run
from printmend.machine.kernels.lattice import Lattice
from printmend.machine.mechanism import BedMap, Mechanism, ScrewDrive, Transmission
from printmend.messages import say
from printmend.path import frozen
from printmend.printer import Printer
from printmend.printer.printer import Axis

WHOLE = 1e-6  # a full step this close to a whole number of table entries counts as whole


@dataclass(frozen=True, eq=False)
class LatticeMotor:
    """One motor's play on the lattice: belt ← min(max(belt, lower[i]), upper[i]), all in full steps.

    Entry i of ``lower_steps`` and ``upper_steps`` [N] stands for motor position ``first_step`` + i. A layer starts with
    the motor at entry ``start`` and its belt, at rest in the play, at that entry's nominal position ``origin_steps``.
    """

    name: str
    first_step: int
    start: int
    lower_steps: np.ndarray
    upper_steps: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "lower_steps", frozen(np.asarray(self.lower_steps, float)))
        object.__setattr__(self, "upper_steps", frozen(np.asarray(self.upper_steps, float)))

    @property
    def origin_steps(self) -> float:
        """Where the belt is when the layer starts."""
        return float(self.first_step + self.start)

    def check(self, index: np.ndarray) -> None:
        """Raise `InputError` if one of the entries ``index`` is not in the tables."""
        if index.size and (index.min() < 0 or index.max() >= len(self.lower_steps)):
            raise self.left()

    def left(self) -> InputError:
        """Return the error for a motor that leaves its tables."""
        return InputError(
            say("subject-motor", self.name),
            wanted=say("controls-stay-within-bed-length-bed") if self.name != "z" else say("heights-axis"),
            came=say("controls-leave"),
            todo=say("check-start-controls"),
        )


@dataclass(frozen=True, eq=False)
class LatticeScrew:
    """Z on the lattice: its motor, and ``push_steps`` [N, 2], how far the screw pushes the nozzle at each entry of the
    motor's tables, in full steps of x and y, relative to the layer's start."""

    motor: LatticeMotor
    push_steps: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "push_steps", frozen(np.asarray(self.push_steps, float)))


@dataclass(frozen=True, eq=False)
class PlayTables:
    """A machine with memory on the lattice: its two planar ``motors``, and how their belts reach the ``bed``.

    On a CoreXY the motors are a = x + y and b = x − y of the controls. Everything is in full steps.
    """

    motors: tuple[LatticeMotor, LatticeMotor]
    bed: BedMap

    @property
    def arrays(self) -> Lattice:
        """The tables as kernels take them."""
        a, b = self.motors
        branches = (a.lower_steps, a.upper_steps, b.lower_steps, b.upper_steps)
        return Lattice(a.start, b.start, a.origin_steps, b.origin_steps, *branches, self.bed.record)

    @property
    def is_taut(self) -> bool:
        """Return whether no motor has play, so that the machine has no memory."""
        return all(np.array_equal(motor.lower_steps, motor.upper_steps) for motor in self.motors)

    @property
    def is_coupled(self) -> bool:
        """Return whether a motor moves the nozzle along both axes."""
        return self.bed.corexy or not self.bed.is_straight


def lattice_tables(mechanism: Mechanism, start_steps: np.ndarray) -> PlayTables:
    """Return the planar motors of a mechanism on the lattice, for a layer that starts at ``start_steps`` [2].

    At the start, each belt rests at the mechanism's position in its play, which becomes the nominal position. Raise
    `InputError` if the start lies outside the tables.
    """
    return _tables_from(mechanism, *np.asarray(start_steps, np.int64).tolist())


@lru_cache(maxsize=16)  # every tick on a machine asks again
def _tables_from(mechanism: Mechanism, *start_steps: int) -> PlayTables:
    printer = mechanism.printer
    start = printer.to_motor(np.array(start_steps))
    # Lattice motor positions count from the motor's image of the bed's lower corner.
    corner_mm = printer.to_motor(np.array([printer.x.min_mm, printer.y.min_mm]))
    a, b = (
        _lattice_motor(printer.motors[k], table, printer.axes[k], corner_mm[k], int(start[k]), mechanism.rest_share[k])
        for k, table in enumerate(mechanism.transmissions)
    )
    return PlayTables((a, b), lattice_bed(mechanism).anchored(np.array(start_steps, float)))


def lattice_screw(screw: ScrewDrive, printer: Printer, start_step: int) -> LatticeScrew:
    """Return Z on the lattice, for a layer that starts at full step ``start_step`` of Z.

    Raise `InputError` if the start lies outside the axis.
    """
    z = printer.z
    motor = _lattice_motor("z", screw.transmission, z, z.min_mm, start_step, screw.rest_share)
    push_mm = screw.wobble_mm[:: z.microsteps]
    return LatticeScrew(motor, (push_mm - push_mm[motor.start]) / np.array(printer.mm_per_step))


def _lattice_motor(
    name: str, table: Transmission, axis: Axis, corner_mm: float, start_step: int, rest_share: float
) -> LatticeMotor:
    """Return a transmission on the lattice, for a layer that starts at full step ``start_step`` of its motor."""
    lower, upper = _errors_steps(table, axis.mm_per_step)
    first = round((table.first_mm - corner_mm) / axis.mm_per_step)
    motor = LatticeMotor(name, first, start_step - first, np.empty(len(lower)), np.empty(len(lower)))
    motor.check(np.array(motor.start))
    branches = np.empty((2, len(lower)))
    run.lay_branches(lower, upper, first, motor.start, rest_share, *branches)
    return LatticeMotor(name, first, motor.start, *branches)


@lru_cache(maxsize=16)  # every layer on a machine asks again
def _errors_steps(table: Transmission, mm_per_step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of a table's branches at full steps, relative to the motor, in full steps.

    A machine's tables have an entry for each micro-step; a saved model's may have fewer.
    """
    # Convert errors instead of positions to the other unit: a healthy motor stays exact.
    motor_mm, stride = table.motor_mm, mm_per_step / table.pitch_mm
    errors_mm = [branch - motor_mm for branch in (table.lower_mm, table.upper_mm)]
    if abs(stride - round(stride)) < WHOLE:
        at_steps = [each[:: round(stride)] for each in errors_mm]
    else:
        full_mm = np.arange(motor_mm[0], motor_mm[-1] + table.pitch_mm / 2, mm_per_step)
        at_steps = [np.interp(full_mm, motor_mm, each) for each in errors_mm]
    lower, upper = (each / mm_per_step for each in at_steps)
    return frozen(lower), frozen(upper)


def lattice_bed(mechanism: Mechanism) -> BedMap:
    """Return how the belts of a mechanism reach the bed in full steps. A layer's tables hold this map
    `BedMap.anchored`."""
    printer, bed = mechanism.printer, mechanism.bed
    pitch_mm = np.array(printer.mm_per_step)
    origin = np.array([printer.x.min_mm, printer.y.min_mm]) / pitch_mm
    waves = bed.waves / np.array([1.0, 1.0, *pitch_mm[[0, 0, 1, 1]]])
    return BedMap(bed.corexy, bed.terms / pitch_mm[:, None], origin, bed.scale / pitch_mm, waves)


def run_motors(motors: tuple[LatticeMotor, ...], moves: np.ndarray) -> np.ndarray:
    """Move motors by ``moves`` [T, M] full steps from the start of a layer; return their belts [T + 1, M].

    Raise `InputError` if a motor leaves its tables.
    """
    moves = np.ascontiguousarray(moves, np.int64)
    belts = np.empty((len(moves) + 1, len(motors)))
    for k, motor in enumerate(motors):
        lower, upper = motor.lower_steps, motor.upper_steps
        if not run.run_motor(moves, k, motor.start, motor.origin_steps, lower, upper, belts):
            raise motor.left()
    return belts


def run_screw(
    screw: ScrewDrive | None, printer: Printer, controls: np.ndarray, start_step: int
) -> tuple[np.ndarray, np.ndarray]:
    """Move Z by controls [T] from full step ``start_step``, the nut at rest there.

    Return the height [T + 1] in full steps of Z, and the push [T + 1, 2] in full steps of x and y. Without a screw,
    these are the commanded height and zero. Raise `InputError` if Z leaves its tables.
    """
    risen = np.concatenate([[0], np.cumsum(controls, dtype=np.int64)])
    if screw is None:
        return (start_step + risen).astype(float), np.zeros((len(risen), 2))
    tables = lattice_screw(screw, printer, start_step)
    height = run_motors((tables.motor,), controls[:, None])[:, 0]
    return height, tables.push_steps[tables.motor.start + risen]
