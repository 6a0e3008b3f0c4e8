"""The digital twin: what a broken printer would print.

`Twin.run` prints lattice controls, the paper's experiment; `Twin.follow` prints way-points in mm at micro-step
resolution from the home position, for G-code. Both take two axes, or three.
"""

from dataclasses import dataclass

import numpy as np

from printmend.corruption import Fault
from printmend.corruption.jump import Jumps
from printmend.errors import InputError
from printmend.machine.mechanism import GainMechanism, Mechanism
from printmend.printer import Printer
from printmend.protocols import LatticeFrame, PlayTables
from printmend.twin import kernels
from printmend.twin.height import follow_height, run_height


@dataclass(frozen=True, eq=False)
class Twin:
    """A printer with a mechanism, true (from a `Fault`) or learned, and the jumps of its motors."""

    mechanism: Mechanism | GainMechanism
    jumps: tuple[Jumps, Jumps] = (Jumps(), Jumps())

    @classmethod
    def of(cls, corruption: Fault, printer: Printer) -> "Twin":
        """Build the twin of ``printer`` broken by ``corruption``, a `Corruption` or a fault of another package."""
        return cls(corruption.lower(printer), corruption.jumps)

    @property
    def printer(self) -> Printer:
        return self.mechanism.printer

    def run(self, controls: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Print lattice controls.

        ``controls`` [T, 2] integer full steps a tick along x and y, ``start`` [2] the lattice point where the layer
        starts: printed = nominal = start there, with the play of each belt centred (the paper's known state s0).
        Returns printed [T + 1, 2] full steps. With a third column, Z in its own full steps, printed is [T + 1, 3].
        Raises `InputError` where a motor would leave its tables.
        """
        controls = np.ascontiguousarray(controls, np.int64)
        start = np.asarray(start, np.int64)
        if controls.ndim != 2 or controls.shape[1] not in (2, 3) or start.shape != controls.shape[1:]:
            raise InputError(
                "controls",
                wanted="controls [T, 2] and start [2], or controls [T, 3] and start [3]",
                came=f"{controls.shape} and {start.shape}",
                todo="reshape them",
            )
        if len(start) == 2:
            return self._run(controls, start)
        screw = self.mechanism.screw if isinstance(self.mechanism, Mechanism) else None
        height, push = run_height(screw, self.printer, controls[:, 2], int(start[2]))
        printed = self._run(np.ascontiguousarray(controls[:, :2]), start[:2])
        return np.concatenate([printed + push, height[:, None]], axis=1)

    def _run(self, controls: np.ndarray, start: np.ndarray) -> np.ndarray:
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
        skipped = None
        if any(map(any, self.jumps)):
            moves, skipped = self._jumped(moves)
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
        if skipped is not None:
            printed += skipped
        return lattice_bed(self.mechanism, printed, start)

    def _jumped(self, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the motors' moves [T, 2] with the steps they miss, and the belts' skips [T + 1, 2], full steps."""
        moves, skipped = moves.copy(), np.zeros((len(moves) + 1, 2))
        for motor, jumps in enumerate(self.jumps):
            axis = self.printer.axes[motor]
            path_mm = np.concatenate([[0.0], np.cumsum(moves[:, motor])]) * axis.mm_per_step
            lost_mm, skipped_mm = jumps.along(path_mm, axis)
            moves[:, motor] += np.rint(np.diff(lost_mm) / axis.mm_per_step).astype(np.int64)
            skipped[:, motor] = skipped_mm / axis.mm_per_step
        return moves, skipped

    def follow(self, waypoints_mm: np.ndarray) -> np.ndarray:
        """Print the straight moves between way-points [N, 2] mm, the first being the home position just homed.

        Returns printed [N, 2] mm at the way-points; [N, 3] with Z, for way-points [N, 3]. Motors stop on micro-steps.
        Raises `InputError` for a gain table, which knows only the lattice.
        """
        mechanism, waypoints_mm = self.homed(), np.asarray(waypoints_mm, float)
        printed = _follow(mechanism, waypoints_mm[:, :2], self.jumps)
        if waypoints_mm.shape[1] == 2:
            return printed
        height, push = follow_height(mechanism.screw, self.printer, waypoints_mm[:, 2])
        return np.concatenate([printed + push, height[:, None]], axis=1)

    def homed(self) -> Mechanism:
        """Return the machine with the origin that homing gives it. Raises `InputError` for a gain table."""
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

    At the start each belt rests where the mechanism says: with the play centred, (lower + upper)/2 is the nominal
    motor position.
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
        share = mechanism.rest_share[motor]
        shift = -((1 - share) * errors[0][at] + share * errors[1][at])
        lattice = first + np.arange(len(errors[0]))
        # Where a table is flat, rounding could make it fall by 1e-13.
        lowers.append(np.maximum.accumulate(lattice + (errors[0] + shift)))
        uppers.append(np.maximum(np.maximum.accumulate(lattice + (errors[1] + shift)), lowers[-1]))
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
    low_mm, pitch_mm = np.array([printer.x.min_mm, printer.y.min_mm]), np.array(printer.mm_per_step)
    start = np.asarray(start_steps, float)[None]
    bed, bed_start = np.empty((len(belts), 2)), np.empty((1, 2))
    for place, out in ((np.ascontiguousarray(belts, float), bed), (start, bed_start)):
        kernels.bend(place, low_mm, pitch_mm, mechanism.frame.coefficients_mm, mechanism.frame.scale_mm, out)
    bed += start - bed_start
    return bed


def _follow(mechanism: Mechanism, waypoints_mm: np.ndarray, jumps: tuple[Jumps, Jumps]) -> np.ndarray:
    printer = mechanism.printer
    motors_mm = printer.to_motor(waypoints_mm)
    belts_mm = np.empty_like(motors_mm)
    for motor, table in enumerate(mechanism.transmissions):
        microstep_mm = printer.axes[motor].mm_per_step / printer.axes[motor].microsteps
        commanded_mm, skipped_mm = motors_mm[:, motor], None
        if any(jumps[motor]):
            lost_mm, skipped_mm = jumps[motor].along(commanded_mm, printer.axes[motor])
            commanded_mm = commanded_mm + lost_mm
        at_mm = table.first_mm + np.rint((commanded_mm - table.first_mm) / microstep_mm) * microstep_mm
        lower, upper = table.branches_mm(at_mm)
        home = lower if printer.motor_home_direction(motor) > 0 else upper
        column = np.empty(len(at_mm))
        kernels.run_play(np.arange(len(at_mm)), home[0], lower, upper, column)
        belts_mm[:, motor] = column if skipped_mm is None else column + skipped_mm
    return mechanism.frame.apply(printer.from_motor(belts_mm))
