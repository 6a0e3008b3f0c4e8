"""The digital twin: what a broken printer would print.

`Twin.run` prints lattice controls, the paper's experiment; `Twin.follow` prints way-points in mm at micro-step
resolution from the home position, for G-code.
"""

from dataclasses import dataclass

import numpy as np

from printmend.corruption import Corruption
from printmend.errors import InputError
from printmend.mechanism import GainMechanism, Mechanism
from printmend.printer import Printer
from printmend.protocols import LatticeFrame, PlayTables
from printmend.twin import kernels


@dataclass(frozen=True, eq=False)
class Twin:
    """A printer with a mechanism, true (from a `Corruption`) or learned."""

    mechanism: Mechanism | GainMechanism

    @classmethod
    def of(cls, corruption: Corruption, printer: Printer) -> "Twin":
        """Build the twin of ``printer`` broken by ``corruption``."""
        return cls(corruption.lower(printer))

    @property
    def printer(self) -> Printer:
        return self.mechanism.printer

    def run(self, controls: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Print lattice controls.

        ``controls`` [T, 2] integer full steps a tick along x and y, ``start`` [2] the lattice point where the layer
        starts: printed = nominal = start there, with the play of each belt centred (the paper's known state s0).
        Returns printed [T + 1, 2] full steps. Raises `InputError` where the motor would leave its tables.
        """
        controls = np.ascontiguousarray(controls, np.int64)
        start = np.asarray(start, np.int64)
        if controls.ndim != 2 or controls.shape[1] != 2 or start.shape != (2,):
            raise InputError(
                "controls",
                wanted="controls [T, 2] and start [2]",
                came=f"{controls.shape} and {start.shape}",
                todo="reshape them",
            )
        printed = np.empty((len(controls) + 1, 2))
        if isinstance(self.mechanism, GainMechanism):
            for axis in range(2):
                bed = self.printer.bed_steps[axis]
                kernels.run_gain(controls, axis, int(start[axis]), self.mechanism.gains[axis], bed, printed)
            return printed
        tables = lattice_tables(self.mechanism, start)
        moves = controls
        if tables.corexy:
            moves = np.stack([controls[:, 0] + controls[:, 1], controls[:, 0] - controls[:, 1]], axis=1)
        origin = self.printer.to_motor(start)
        for motor in range(2):
            index = int(origin[motor]) - tables.first_steps[motor]
            lower, upper = tables.lower_steps[motor], tables.upper_steps[motor]
            if not kernels.run_play_controls(moves, motor, index, float(origin[motor]), lower, upper, printed):
                raise InputError(
                    f"motor {self.printer.motors[motor]}",
                    wanted="controls that stay within a bed's length of the bed",
                    came="controls that leave it",
                    todo="check the start and the controls",
                )
        return lattice_bed(self.mechanism, printed, start)

    def follow(self, waypoints_mm: np.ndarray) -> np.ndarray:
        """Print the straight moves between way-points [N, 2] mm, the first being the home position just homed.

        Returns printed [N, 2] mm at the way-points. Motors stop on micro-steps. Raises `InputError` for a gain table,
        which knows only the lattice.
        """
        return _follow(self._homed(), waypoints_mm)

    def _homed(self) -> Mechanism:
        if isinstance(self.mechanism, GainMechanism):
            raise InputError(
                "corruption 'gain-table'",
                wanted="a conservative corruption for G-code",
                came="the published lattice simulator",
                todo="use `bench table1 --protocol paper` for gain tables",
            )
        return self.mechanism.homed()


def lattice_tables(mechanism: Mechanism, start_steps: np.ndarray) -> PlayTables:
    """Return a mechanism on the full-step lattice, in full steps, anchored at a layer's start.

    At the start the play is centred: (lower + upper)/2 = the nominal motor position.
    """
    printer = mechanism.printer
    origin = printer.to_motor(np.asarray(start_steps, np.int64))
    lowers, uppers, firsts = [], [], []
    for motor, table in enumerate(mechanism.transmissions):
        axis = printer.axes[motor]
        stride = axis.microsteps
        # Errors, not positions, go through the change of units: a healthy motor stays exact.
        motor_mm = table.first_mm + table.pitch_mm * np.arange(0, len(table.lower_mm), stride)
        errors = [(branch[::stride] - motor_mm) / axis.mm_per_step for branch in (table.lower_mm, table.upper_mm)]
        # Lattice motor positions count from the motor's image of the bed's lower corner.
        corner_mm = printer.to_motor(np.array([printer.x.min_mm, printer.y.min_mm]))[motor]
        first = round((table.first_mm - corner_mm) / axis.mm_per_step)
        at = int(origin[motor]) - first
        shift = -(errors[0][at] + errors[1][at]) / 2
        lattice = first + np.arange(len(errors[0]))
        lowers.append(lattice + (errors[0] + shift))
        uppers.append(lattice + (errors[1] + shift))
        firsts.append(first)
    return PlayTables(
        (lowers[0], lowers[1]),
        (uppers[0], uppers[1]),
        (firsts[0], firsts[1]),
        corexy=printer.kinematics == "corexy",
        frame=lattice_frame(mechanism, start_steps),
    )


def lattice_frame(mechanism: Mechanism, start_steps: np.ndarray) -> LatticeFrame | None:
    """Return a mechanism's frame in full steps, anchored so that the start stays put; None for the identity."""
    frame, printer = mechanism.frame, mechanism.printer
    if frame.is_identity:
        return None
    pitch_mm = np.array(printer.mm_per_step)
    coefficients = frame.coefficients_mm / pitch_mm[:, None]
    origin = np.array([printer.x.min_mm, printer.y.min_mm]) / pitch_mm
    loose = LatticeFrame(coefficients, origin, frame.scale_mm / pitch_mm)
    start = np.asarray(start_steps, float)
    anchored = coefficients.copy()
    anchored[:, 0] += start - loose.apply(start)
    return LatticeFrame(anchored, origin, loose.scale_steps)


def lattice_bed(mechanism: Mechanism, motors_steps: np.ndarray, start_steps: np.ndarray) -> np.ndarray:
    """Map belt positions of the motors [N, 2] to the bed [N, 2] in full steps; the start maps to itself."""
    printer = mechanism.printer
    belts = printer.from_motor(motors_steps)
    if mechanism.frame.is_identity:
        return belts
    low_mm = np.array([printer.x.min_mm, printer.y.min_mm])
    pitch_mm = np.array(printer.mm_per_step)
    start_steps = np.asarray(start_steps, float)
    with_start = np.concatenate([np.atleast_2d(start_steps), belts])
    bed = (mechanism.frame.apply(low_mm + with_start * pitch_mm) - low_mm) / pitch_mm
    return bed[1:] + (start_steps - bed[0])


def _follow(mechanism: Mechanism, waypoints_mm: np.ndarray) -> np.ndarray:
    printer = mechanism.printer
    waypoints_mm = np.asarray(waypoints_mm, float)
    motors_mm = printer.to_motor(waypoints_mm)
    belts_mm = np.empty_like(motors_mm)
    for motor, table in enumerate(mechanism.transmissions):
        microstep_mm = printer.axes[motor].mm_per_step / printer.axes[motor].microsteps
        at_mm = table.first_mm + np.rint((motors_mm[:, motor] - table.first_mm) / microstep_mm) * microstep_mm
        lower, upper = table.branches_mm(at_mm)
        home = lower if printer.motor_home_direction(motor) > 0 else upper
        column = np.empty(len(at_mm))
        kernels.run_play(np.arange(len(at_mm)), home[0], lower, upper, column)
        belts_mm[:, motor] = column
    return mechanism.frame.apply(printer.from_motor(belts_mm))
