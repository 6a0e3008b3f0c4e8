"""The digital twin: it prints what a broken printer would print.

`Twin.run` prints lattice controls, as in the paper's experiment. `Twin.follow` prints way-points in mm at micro-step
resolution from the home position, for G-code. Both take two or three axes. `Twin.seen` returns an instrument's readings
of the same way-points.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from printmend.corruption import Beads, Corruption, Fault
from printmend.corruption.transmission import Jumps
from printmend.effects import EFFECTS, Of, Scene, columns_of, places_of
from printmend.effects.effect import STAYS, at_places
from printmend.effects.sized import Sized, guided, scene_of_printer, with_effects
from printmend.errors import InputError
from printmend.machine import (
    Contacts,
    GainMechanism,
    Mechanism,
    contacts_from,
    drive_belts,
    lattice_tables,
    reach_bed,
    run_motors,
    run_screw,
)
from printmend.messages import say
from printmend.path import Trace
from printmend.printer import Printer, printer_of
from printmend.twin import kernels

# Effects along a commanded path that no machine's tables hold: columns times sizes, row by row.


def added_mm(parts: Sequence[Sized], trace: Trace, scene: Scene, contacts: Contacts, *, before: int = 0) -> np.ndarray:
    """Return the displacement [N, 2] mm that effects add to each row of a print with these contacts, after ``before``
    earlier prints."""
    bed_mm = scene.printer.from_motor(contacts.belt_mm)
    places = places_of(trace, scene, contacts.row, contacts.side, bed_mm)
    places = guided(replace(places, done=places.done + before), trace.commanded_mm, parts)
    moved = np.zeros((len(trace), 2))
    for part in parts:
        moved = moved + columns_of(part.effect, places, part.where, part.shape, scene) @ part.sizes_mm
    return moved


def moved_mm(
    mechanism: Mechanism,
    parts: Sequence[Sized],
    path_mm: np.ndarray,
    *,
    motors_mm: np.ndarray | None = None,
    from_home: bool = False,
    before: int = 0,
) -> np.ndarray:
    """Return the displacement [N, 2] mm that effects add along a path [N, 2] mm of the whole print.

    ``motors_mm`` [N, ≥ 2] is where the motors stop; by default exactly on the path. With ``from_home`` the path begins
    at the end stops, where each belt is engaged in the homing direction; otherwise each belt rests in the middle of its
    play. ``before`` is the number of earlier prints that wore the machine.
    """
    printer = mechanism.printer
    way_mm = float(np.hypot(*np.diff(path_mm, axis=0).T).sum())
    scene = scene_of_printer(printer, max(way_mm, 1e-9))
    motors_mm = printer.to_motor(path_mm) if motors_mm is None else motors_mm[:, :2]
    ways = [printer.motor_home_direction(motor) if from_home else 0 for motor in range(2)]
    contacts = contacts_from(mechanism, motors_mm, ways)
    return added_mm(
        parts, Trace(path_mm, np.full(path_mm.shape, np.nan), homed=from_home), scene, contacts, before=before
    )


@dataclass(frozen=True, eq=False)
class Twin:
    """A printer with a mechanism, true (from a `Fault`) or learned, and the jumps of its motors.

    ``along`` are effects that act along the path, which no mechanism can hold. ``before`` is the number of earlier
    prints, after which wear continues. ``beads`` say how far lines stand out at holes, at corners and in layer 1.
    """

    mechanism: Mechanism | GainMechanism
    jumps: tuple[Jumps, Jumps] = (Jumps(), Jumps())
    along: tuple[Sized, ...] = ()
    before: int = 0
    beads: Beads = field(default_factory=Beads)

    @classmethod
    def of(cls, corruption: Fault, printer: Printer | str | Path) -> "Twin":
        """Build the twin of ``printer`` broken by ``corruption``, a `Corruption` or a fault of another package."""
        printer = printer_of(printer)
        along: tuple[Sized, ...] = ()
        beads = Beads()
        if isinstance(corruption, Corruption):
            along, beads = corruption.along(printer), corruption.beads(printer)
        return cls(corruption.lower(printer), corruption.jumps, along, beads=beads)

    def with_effects(self, parts: Sequence[Sized]) -> "Twin":
        """Return this printer with more effects. Raises `InputError` for a gain table, or a drive that reverses."""
        more = tuple(part for part in parts if not part.is_held)
        return replace(self, mechanism=with_effects(self.tables, parts), along=self.along + more)

    def again(self) -> "Twin":
        """Return this printer for its next print: without jumps, and with the effects along the path that persist."""
        found = [(part, EFFECTS[part.effect]) for part in self.along]
        lasting = (part for part, law in found if law.of is not Of.INSTRUMENT and law.fate == STAYS)
        return Twin(self.mechanism, along=tuple(lasting), before=self.before + 1, beads=self.beads)

    @property
    def printed_along(self) -> tuple[Sized, ...]:
        """The effects along the path of the print, without those of its measurement."""
        return tuple(self._parts(printed=True))

    @property
    def wider_mm(self) -> float:
        """How far the effects of the filament push a wall out on either side [mm]."""
        if not self.along:
            return 0.0
        scene, one, at = scene_of_printer(self.printer), np.ones(1), np.array(self.printer.middle_mm)[None]
        motor, normal = self.printer.to_motor(at), np.array([[1.0, 0.0]])
        places = at_places(motor_mm=motor, bed_mm=at, done=one, move_mm=one, normal=normal)
        walls = [part for part in self.along if EFFECTS[part.effect].of is Of.MATERIAL]
        moved = [columns_of(part.effect, places, part.where, part.shape, scene)[0, 0] @ part.sizes_mm for part in walls]
        return float(sum(moved))

    @property
    def printer(self) -> Printer:
        return self.mechanism.printer

    def run(self, controls: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Print lattice controls.

        ``controls`` [T, 2] are integer full steps per tick along x and y. The layer starts at the lattice point
        ``start`` [2]: there printed = nominal = start, and each belt's play is centred (the paper's known state s0).
        Returns printed [T + 1, 2] full steps. With a third column, Z in its own full steps, printed is [T + 1, 3].
        Raises `InputError` if a motor would leave its tables.
        """
        controls = np.ascontiguousarray(controls, np.int64)
        start = np.asarray(start, np.int64)
        if controls.ndim != 2 or controls.shape[1] not in (2, 3) or start.shape != controls.shape[1:]:
            raise InputError(
                say("subject-controls"),
                wanted=say("controls-t-2-start-2-controls"),
                came=say("and", controls.shape, start.shape),
                todo=say("reshape-them"),
            )
        if isinstance(self.mechanism, GainMechanism):
            printed = self._run_gains(self.mechanism, controls, start)
        else:
            printed = self._run_motors(self.mechanism, controls[:, :2], start[:2])
        if len(start) == 2:
            return printed
        screw = self.mechanism.screw if isinstance(self.mechanism, Mechanism) else None
        height, push = run_screw(screw, self.printer, controls[:, 2], int(start[2]))
        return np.concatenate([printed + push, height[:, None]], axis=1)

    def _run_gains(self, mechanism: GainMechanism, controls: np.ndarray, start: np.ndarray) -> np.ndarray:
        printed = np.empty((len(controls) + 1, 2))
        for axis in range(2):
            bed = self.printer.bed_steps[axis]
            kernels.run_gain(controls, axis, int(start[axis]), mechanism.gains[axis], bed, printed)
        return printed

    def _run_motors(self, mechanism: Mechanism, controls: np.ndarray, start: np.ndarray) -> np.ndarray:
        tables = lattice_tables(mechanism, start)
        moves, skipped = self.printer.to_motor(controls), None
        if any(map(any, self.jumps)):
            moves, skipped = self._jumped(moves)
        belts = run_motors(tables.motors, moves)
        printed = tables.bed.printed(belts if skipped is None else belts + skipped)
        parts = self._parts(printed=True)
        if not parts:
            return printed
        pitch_mm = np.array([axis.mm_per_step for axis in self.printer.axes[:2]])
        low_mm = np.array([axis.min_mm for axis in self.printer.axes[:2]])
        path_mm = low_mm + np.vstack([start, start + np.cumsum(controls, axis=0)]) * pitch_mm
        moved = moved_mm(mechanism, parts, path_mm, before=self.before)
        return np.asarray(printed + (moved - moved[0]) / pitch_mm)  # a layer starts at its nominal place

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
        mechanism, printer = self.homed(), self.printer
        motors_mm = np.array(waypoints_mm, float)
        motors_mm[:, :2] = printer.to_motor(motors_mm[:, :2])
        skipped_mm = np.zeros((len(motors_mm), 2))
        for k, table in enumerate(mechanism.motors[: motors_mm.shape[1]]):
            axis = printer.axes[k]
            if k < 2 and any(self.jumps[k]):
                lost_mm, skipped_mm[:, k] = self.jumps[k].along(motors_mm[:, k], axis)
                motors_mm[:, k] += lost_mm
            microstep_mm = axis.mm_per_step / axis.microsteps
            motors_mm[:, k] = table.first_mm + np.rint((motors_mm[:, k] - table.first_mm) / microstep_mm) * microstep_mm
        belts_mm = drive_belts(mechanism, motors_mm, mechanism.engaged_mm())
        belts_mm[:, :2] += skipped_mm
        places_mm = reach_bed(mechanism, motors_mm, belts_mm)
        if parts := self._parts(printed=True):
            path_mm = np.asarray(waypoints_mm, float)[:, :2]
            places_mm[:, :2] += moved_mm(
                mechanism, parts, path_mm, motors_mm=motors_mm, from_home=True, before=self.before
            )
        return places_mm

    def seen(self, waypoints_mm: np.ndarray) -> np.ndarray:
        """Return an instrument's readings of the places of `follow`, with the effects of the measurement."""
        places_mm = self.follow(waypoints_mm)
        places_mm[:, :2] += self.misread_mm(waypoints_mm)
        return places_mm

    def misread_mm(self, waypoints_mm: np.ndarray) -> np.ndarray:
        """Return the error [N, 2] mm of an instrument at way-points [N, ≥ 2] mm of the whole print."""
        path_mm, parts = np.asarray(waypoints_mm, float)[:, :2], self._parts(printed=False)
        if not parts:
            return np.zeros(path_mm.shape)
        return moved_mm(self.homed(), parts, path_mm, from_home=True, before=self.before)

    def _parts(self, *, printed: bool) -> list[Sized]:
        """Return the effects along the path of the print, or those of its measurement."""
        return [part for part in self.along if (EFFECTS[part.effect].of is not Of.INSTRUMENT) == printed]

    def homed(self) -> Mechanism:
        """Return the machine with the origin that homing gives it. Raises `InputError` for a gain table."""
        return self.tables.homed()

    @property
    def tables(self) -> Mechanism:
        """The machine's tables. Raises `InputError` for a gain table, which has none."""
        if isinstance(self.mechanism, GainMechanism):
            raise InputError(
                say("subject-corruption", "'gain-table'"),
                wanted=say("conservative-corruption-g-code"),
                came=say("published-lattice-simulator"),
                todo=say("terminal-use-bench-table1-protocol-paper-gain"),
            )
        return self.mechanism
