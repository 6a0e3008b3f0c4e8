"""Machines as arrays: the value that corruptions lower to, learners produce, twins run and planners invert.

Each planar motor drives the carriage through a `Transmission`: two monotone tables over the motor's position m,

    u ← min(max(u, lower(m)), upper(m))            generalised play, physics.md eq. 7

where u is the position that the belt gives the carriage. `lower` is reached when the motor moves forwards and
pushes, `upper` when it moves backwards; a taut transmission has lower = upper. Slack on the shaft before a
monotone map (eq. 10), play after it, and friction that grows with the distance (eq. 9) all have this form,
because a clip passes through a monotone map. A `Frame` then maps the two belt positions to the bed.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from printmend.errors import ConfigError
from printmend.jit import record
from printmend.machine.kernels import bed as law
from printmend.machine.kernels import run
from printmend.machine.kernels.bed import MOST_WAVES, WAVE_FIELDS
from printmend.messages import say
from printmend.path import frozen
from printmend.printer import Printer
from printmend.units import TURN_RAD

# The map from two motors' belts to the bed, as a value in any unit: CoreXY mixing and a crooked frame.


@dataclass(frozen=True, eq=False)
class BedMap:
    """The map from motors to bed: CoreXY mixing if ``corexy``, then x' = x + Σ a_pq ((x + x0)/Lx)^p ((y + y0)/Ly)^q
    for belts at (x, y), and y' with b_pq (physics.md eq. 13 and 14).

    ``terms`` [2, 10] are a and b in the order of `Frame.exponents`, ``origin`` [2] is (x0, y0) and ``scale`` [2] is
    (Lx, Ly), all in one unit: mm, or full steps. ``waves`` [K, 6] are added. Each has its angle per unit of
    (x + x0)/Lx and of (y + y0)/Ly, and its cosine and sine coefficients in x, then in y.
    """

    corexy: bool
    terms: np.ndarray
    origin: np.ndarray
    scale: np.ndarray
    waves: np.ndarray = field(default_factory=lambda: np.zeros((0, law.WAVE_FIELDS)))

    def __post_init__(self) -> None:
        for name in ("terms", "origin", "scale", "waves"):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), float)))

    @cached_property
    def is_straight(self) -> bool:
        """Return whether the frame moves no place."""
        return not self.terms.any() and not len(self.waves)

    @property
    def record(self) -> np.record:
        """The map as the kernels read it: a record of `kernels.bed.BED`."""
        way = record(law.BED)
        way.corexy, way.framed, way.wave_count = self.corexy, not self.is_straight, len(self.waves)
        way.origin[:], way.scale[:], way.terms[:] = self.origin, self.scale, self.terms
        way.waves[: len(self.waves)] = np.ascontiguousarray(self.waves).view(law.WAVE).ravel()
        return way

    def anchored(self, place: np.ndarray) -> "BedMap":
        """Return the map, shifted so that the frame does not move ``place`` [2], where a layer starts."""
        if self.is_straight:
            return self
        way = self.record
        run.anchor(way, float(place[0]), float(place[1]))
        return replace(self, terms=way.terms)

    def printed(self, belts: np.ndarray) -> np.ndarray:
        """Map the positions of the motors' belts [..., 2] to places on the bed [..., 2]."""
        return self._each(run.printed_each, belts)

    def wanted(self, places: np.ndarray) -> np.ndarray:
        """Return the positions of the motors' belts [..., 2] for places on the bed [..., 2]: the inverse."""
        return self._each(run.wanted_each, places)

    def _each(self, law_each: Callable[..., None], places: np.ndarray) -> np.ndarray:
        places = np.asarray(places, float)
        if self.is_straight and not self.corexy:
            return places
        flat = np.ascontiguousarray(places.reshape(-1, 2))
        out = np.empty(flat.shape)
        law_each(self.record, flat, out)
        return out.reshape(places.shape)

    def slopes(self, belts: np.ndarray) -> np.ndarray:
        """Return the derivatives [N, 2, 2] of the places on the bed by the motors' belts, at belts [N, 2]."""
        out = np.empty((len(belts), 2, 2))
        run.slopes_each(self.record, np.ascontiguousarray(belts, float), out)
        return out


_MOST_Z_PLACES = 5_000_000  # most entries of a screw's tables; 300 mm with an 8 mm lead at 128 a step need a million


@dataclass(frozen=True, eq=False)
class Transmission:
    """The carriage position of one motor, tabulated: ``lower_mm[i]`` and ``upper_mm[i]`` at ``first_mm + i·pitch_mm``.

    Both tables are non-decreasing, lower ≤ upper. Positions between the entries are interpolated linearly;
    beyond the ends the table is continued with the slope of a healthy motor (1).
    """

    first_mm: float
    pitch_mm: float
    lower_mm: np.ndarray
    upper_mm: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "lower_mm", frozen(np.asarray(self.lower_mm, float)))
        object.__setattr__(self, "upper_mm", frozen(np.asarray(self.upper_mm, float)))

    @property
    def motor_mm(self) -> np.ndarray:
        """The motor positions of the entries [N]."""
        return self.first_mm + self.pitch_mm * np.arange(len(self.lower_mm))

    @cached_property
    def is_taut(self) -> bool:
        """Return whether there is no play: both branches are the same."""
        return bool(np.array_equal(self.lower_mm, self.upper_mm))

    def branches_mm(self, motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (lower, upper) [mm] at any motor positions [mm]."""
        lower = _looked_up(run.branch_each, self.lower_mm, self, motor_mm)
        return lower, lower.copy() if self.is_taut else _looked_up(run.branch_each, self.upper_mm, self, motor_mm)

    def shifted(self, by_mm: float) -> "Transmission":
        """Move the carriage's origin: add ``by_mm`` to both tables."""
        return Transmission(self.first_mm, self.pitch_mm, self.lower_mm + by_mm, self.upper_mm + by_mm)


def _looked_up(law: Callable[..., None], table_mm: np.ndarray, at: Transmission, motor_mm: np.ndarray) -> np.ndarray:
    """Return a table's values at motor positions of any shape, by one of the laws of `kernels.run`."""
    motors = np.asarray(motor_mm, float)
    out = np.empty(motors.shape)
    law(table_mm, at.first_mm, 1.0 / at.pitch_mm, np.ascontiguousarray(motors.reshape(-1)), out.reshape(-1))
    return out


@lru_cache(maxsize=16)
def healthy_transmission(printer: Printer, motor: int) -> Transmission:
    """Return the identity at every micro-step of the bed, and of one more bed on either side.

    With a damaged pulley, the motor may have to go well beyond the nominal bed to reach a place on it. Every full step
    k·mm_per_step from the motor's lower end is an entry.
    """
    low_mm, high_mm = printer.motor_range_mm(motor)
    axis = printer.axes[motor]
    steps = round((high_mm - low_mm) / axis.mm_per_step)
    first_mm, pitch_mm = low_mm - steps * axis.mm_per_step, axis.mm_per_step / axis.microsteps
    motor_mm = first_mm + pitch_mm * np.arange(3 * steps * axis.microsteps + 1)
    return Transmission(first_mm, pitch_mm, motor_mm, motor_mm)


def z_grid_mm(printer: Printer) -> tuple[np.ndarray, float, float]:
    """Return the tables' commanded heights [N], their first and their pitch: micro-steps, to a turn beyond the ends.

    Every full step from the axis' lower end is an entry. Raise `ConfigError` for a screw that is too fine to tabulate.
    """
    axis = printer.z
    steps = math.ceil(axis.length_mm / axis.mm_per_step) + 2 * axis.steps_per_turn
    places = steps * axis.microsteps
    if places > _MOST_Z_PLACES:
        raise ConfigError(
            printer.name, wanted=say("z-most-micro-steps-long", _MOST_Z_PLACES), came=f"{places:.3g}",
            todo=say("check-mm-per-turn-steps-per"),
        )  # fmt: skip
    first_mm, pitch_mm = axis.min_mm - axis.mm_per_turn, axis.mm_per_step / axis.microsteps
    return first_mm + pitch_mm * np.arange(places + 1), first_mm, pitch_mm


@dataclass(frozen=True, eq=False)
class Frame:
    """The map from belt positions to the bed: the identity, low-order cross terms, waves (physics.md eq. 14).

        x' = x + Σ_{p+q ≤ 3} a_pq (x/L)^p (y/L)^q + Σ_k c_k cos(2πs/P) + d_k sin(2πs/P)          y' likewise

    L is ``scale_mm`` and s the distance along a wave. ``coefficients_mm`` [2, 10] follow the order of `Frame.exponents`
    and describe skew, axis scale, straightness and yaw. ``waves`` [K, 6], of crooked rails or a distorted bed, are at
    most `MOST_WAVES`: each wave's direction in right angles (0 along x, 1 along y), its length P mm, and its c and d in
    x, then in y, mm.
    """

    coefficients_mm: np.ndarray = field(default_factory=lambda: np.zeros((2, 10)))
    scale_mm: float = 100.0
    waves: np.ndarray = field(default_factory=lambda: np.zeros((0, WAVE_FIELDS)))

    exponents = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients_mm", frozen(np.asarray(self.coefficients_mm, float)))
        object.__setattr__(self, "waves", frozen(np.asarray(self.waves, float)))
        if self.waves.shape[1:] != (WAVE_FIELDS,) or len(self.waves) > MOST_WAVES:
            raise ValueError(f"wanted at most {MOST_WAVES} waves of {WAVE_FIELDS} numbers, got {self.waves.shape}")

    @property
    def is_identity(self) -> bool:
        """Return whether the frame moves no place."""
        return not self.coefficients_mm.any() and not len(self.waves)

    def terms(self, xy_mm: np.ndarray) -> np.ndarray:
        """Return the monomials [..., 10] at bed positions [..., 2]."""
        x, y = np.asarray(xy_mm)[..., 0] / self.scale_mm, np.asarray(xy_mm)[..., 1] / self.scale_mm
        return np.stack([x**p * y**q for p, q in self.exponents], axis=-1)

    @cached_property
    def _straight_motors(self) -> BedMap:
        return self.bed_map(corexy=False)

    def bed_map(self, *, corexy: bool) -> BedMap:
        """Return the frame behind two motors, in mm: how their belts reach the bed."""
        waves, (towards, length_mm) = self.waves.copy(), self.waves[:, :2].T
        along = [
            np.where(towards == rest, 0.0, law(towards * TURN_RAD / 4)) for rest, law in ((1, np.cos), (0, np.sin))
        ]
        waves[:, :2] = np.stack(along, axis=1) * (TURN_RAD * self.scale_mm / length_mm)[:, None]
        return BedMap(corexy, self.coefficients_mm, np.zeros(2), np.full(2, self.scale_mm), waves)

    def apply(self, xy_mm: np.ndarray) -> np.ndarray:
        """Map the positions that the belts give [..., 2] to positions on the bed [..., 2]."""
        return self._straight_motors.printed(xy_mm)

    def invert(self, xy_mm: np.ndarray) -> np.ndarray:
        """Return the belt positions whose image is ``xy_mm`` [..., 2], to 1e-10 mm."""
        return self._straight_motors.wanted(xy_mm)


@dataclass(frozen=True, eq=False)
class ScrewDrive:
    """Z: its transmission, and ``wobble_mm`` [N, 2]: how far the screw pushes the nozzle at each entry of its tables.

    ``rest_share`` is like `Mechanism`'s, for the nut in its play.
    """

    transmission: Transmission
    wobble_mm: np.ndarray
    rest_share: float = 0.5

    def __post_init__(self) -> None:
        object.__setattr__(self, "wobble_mm", frozen(np.asarray(self.wobble_mm, float)))

    def wobble_at_mm(self, motor_mm: np.ndarray) -> np.ndarray:
        """Return the push [N, 2] mm at commanded heights [N] mm."""
        push_mm = (_looked_up(run.push_each, column, self.transmission, motor_mm) for column in self._columns_mm)
        return np.stack(list(push_mm), axis=-1)

    @cached_property
    def _columns_mm(self) -> tuple[np.ndarray, np.ndarray]:
        return frozen(self.wobble_mm[:, 0]), frozen(self.wobble_mm[:, 1])


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A whole machine, true or learned: a transmission for each planar motor, the frame, and a Z screw if it matters.

    Without a ``screw`` Z is as commanded and pushes nothing. ``rest_share`` is where in its play each belt rests when a
    layer starts: at 0 the motor pushes it at once when it moves forwards, at 1 when it moves back.
    """

    printer: Printer
    transmissions: tuple[Transmission, Transmission]
    frame: Frame = field(default_factory=Frame)
    screw: ScrewDrive | None = None
    rest_share: tuple[float, float] = (0.5, 0.5)

    @cached_property
    def bed(self) -> BedMap:
        """How the belts of the planar motors reach the bed [mm]."""
        return self.frame.bed_map(corexy=self.printer.kinematics == "corexy")

    @property
    def motors(self) -> tuple[Transmission, ...]:
        """The transmissions of the two planar motors, and of Z if there is a screw."""
        return self.transmissions if self.screw is None else (*self.transmissions, self.screw.transmission)

    def engaged_mm(self) -> np.ndarray:
        """Return where the belts [2] are at the end stops; with a screw [3], the nozzle's height too.

        The branch of the direction in which a motor homes is engaged there.
        """
        printer = self.printer
        home_mm = [*printer.to_motor(np.array(printer.home_mm)), printer.z.home_mm]
        ways = [*map(printer.motor_home_direction, range(2)), printer.z.home_direction]
        return np.array([table.branches_mm(home_mm[k])[0 if ways[k] > 0 else 1] for k, table in enumerate(self.motors)])

    def motors_at(self, belts_mm: np.ndarray, side: np.ndarray) -> np.ndarray:
        """Return where the motors have to be [N, 2] for their belts to be there: pushed forwards where ``side`` [N, 2]
        is above 0, pulled back where it is below, and half-way between the two at 0."""
        motors_mm = np.empty_like(belts_mm)
        for at, belt_mm, table in zip(range(2), belts_mm.T, self.transmissions, strict=True):
            branches = (table.lower_mm, table.upper_mm)
            lower, upper = (belt_mm - np.interp(belt_mm, each, each - table.motor_mm) for each in branches)
            motors_mm[:, at] = np.where(side[:, at] > 0, lower, np.where(side[:, at] < 0, upper, (lower + upper) / 2))
        return motors_mm

    def play_at_home_mm(self) -> np.ndarray:
        """Return how much play each belt has at the end stops [2]."""
        home_mm = self.printer.to_motor(np.array(self.printer.home_mm))
        branches = (table.branches_mm(at) for table, at in zip(self.transmissions, home_mm, strict=True))
        return np.array([float(upper - lower) for lower, upper in branches])

    def homed(self) -> "Mechanism":
        """Return this machine with the origin that homing gives it.

        The end stops fix the carriage: at home, reached in the homing direction, bed position and height are those of
        the home position, and the screw does not push. So the engaged branches are shifted to pass through it.
        """
        z_mm = self.printer.z.home_mm
        wanted_mm = np.array([*self.bed.wanted(np.array(self.printer.home_mm)), z_mm])
        a, b, *z = (
            table.shifted(float(to_mm - from_mm))
            for table, from_mm, to_mm in zip(self.motors, self.engaged_mm(), wanted_mm, strict=False)
        )
        screw = self.screw
        if screw is not None:
            at_home = screw.wobble_at_mm(np.array([z_mm]))
            screw = replace(screw, transmission=z[0], wobble_mm=screw.wobble_mm - at_home)
        return replace(self, transmissions=(a, b), screw=screw)


def healthy_mechanism(printer: Printer) -> Mechanism:
    """Return the machine as designed."""
    return Mechanism(printer, (healthy_transmission(printer, 0), healthy_transmission(printer, 1)))


@dataclass(frozen=True, eq=False)
class GainMechanism:
    """The simulator of the paper's published code: a gain for each step, indexed by the nominal position.

    ``gains`` is a pair of arrays of 1100 gains. They are the same in both directions and not conservative (physics.md
    §8.1). This class exists to run the paper's own protocol.
    """

    printer: Printer
    gains: tuple[np.ndarray, np.ndarray]

    def __post_init__(self) -> None:
        object.__setattr__(self, "gains", tuple(frozen(np.asarray(row, float)) for row in self.gains))


# A machine whose motors start at other angles: errors that repeat with their turns move on the bed.


def homed_again(mechanism: Mechanism, by_mm: np.ndarray) -> Mechanism:
    """Return a machine whose motors [2] home ``by_mm`` of belt further on than before."""

    def moved(table: Transmission, by: float) -> Transmission:
        lower, upper = table.branches_mm(table.motor_mm + by)
        return replace(table, lower_mm=lower, upper_mm=upper)

    a, b = (moved(table, float(by)) for table, by in zip(mechanism.transmissions, by_mm, strict=True))
    return replace(mechanism, transmissions=(a, b))
