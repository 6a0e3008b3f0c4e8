"""Machines as arrays: the one value that corruptions lower to, learners produce, twins run, planners invert.

Each planar motor drives the carriage through a `Transmission`: two monotone tables over the motor's position m,

    u ← min(max(u, lower(m)), upper(m))            generalised play, physics.md eq. 7

where u is the position that the belt gives the carriage. `lower` is reached when the motor moves forwards and
pushes, `upper` when it moves backwards; a taut transmission has lower = upper. Slack on the shaft before a
monotone map (eq. 10), play after it, and friction that grows with the distance (eq. 9) all have this form,
because a clip passes through a monotone map. A `Frame` then maps the two belt positions to the bed.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from printmend.path import frozen
from printmend.printer import Printer


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

    @property
    def is_taut(self) -> bool:
        return bool(np.array_equal(self.lower_mm, self.upper_mm))

    def branches_mm(self, motor_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (lower, upper) [mm] at any motor positions [mm]."""
        grid = self.motor_mm
        motor_mm = np.asarray(motor_mm, float)
        inside = np.clip(motor_mm, grid[0], grid[-1])
        beyond = motor_mm - inside
        return np.interp(inside, grid, self.lower_mm) + beyond, np.interp(inside, grid, self.upper_mm) + beyond

    def shifted(self, by_mm: float) -> "Transmission":
        """Move the carriage's origin: add ``by_mm`` to both tables."""
        return Transmission(self.first_mm, self.pitch_mm, self.lower_mm + by_mm, self.upper_mm + by_mm)


def healthy_transmission(printer: Printer, motor: int) -> Transmission:
    """Return the identity at every micro-step of the bed and of one more bed on either side.

    A damaged pulley can need the motor well beyond the nominal bed to reach a place on it. Every full step
    k·mm_per_step from the motor's lower end is an entry.
    """
    low_mm, high_mm = printer.motor_range_mm(motor)
    axis = printer.axes[motor]
    steps = round((high_mm - low_mm) / axis.mm_per_step)
    first_mm, pitch_mm = low_mm - steps * axis.mm_per_step, axis.mm_per_step / axis.microsteps
    motor_mm = first_mm + pitch_mm * np.arange(3 * steps * axis.microsteps + 1)
    return Transmission(first_mm, pitch_mm, motor_mm, motor_mm)


@dataclass(frozen=True, eq=False)
class Frame:
    """The map from belt positions to the bed: the identity plus low-order cross terms (physics.md eq. 14).

        x' = x + Σ_{p+q ≤ 3} a_pq (x/L)^p (y/L)^q          L = ``scale_mm``; y' likewise with b_pq

    ``coefficients_mm`` [2, 10] in the order of `Frame.exponents`. Skew, axis scale, straightness and yaw fit.
    """

    coefficients_mm: np.ndarray = field(default_factory=lambda: np.zeros((2, 10)))
    scale_mm: float = 100.0

    exponents = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients_mm", frozen(np.asarray(self.coefficients_mm, float)))

    @property
    def is_identity(self) -> bool:
        return not self.coefficients_mm.any()

    def terms(self, xy_mm: np.ndarray) -> np.ndarray:
        """Return the monomials [..., 10] at bed positions [..., 2]."""
        x, y = np.asarray(xy_mm)[..., 0] / self.scale_mm, np.asarray(xy_mm)[..., 1] / self.scale_mm
        return np.stack([x**p * y**q for p, q in self.exponents], axis=-1)

    def apply(self, xy_mm: np.ndarray) -> np.ndarray:
        """Map positions given by the belts [..., 2] to positions on the bed [..., 2]."""
        if self.is_identity:
            return np.asarray(xy_mm)
        return xy_mm + self.terms(xy_mm) @ self.coefficients_mm.T

    def invert(self, xy_mm: np.ndarray) -> np.ndarray:
        """Return the belt positions whose image is ``xy_mm`` [..., 2], by fixed-point iteration to 1e-9 mm."""
        target = np.asarray(xy_mm, float)
        if self.is_identity:
            return target
        belt = target
        for _ in range(60):
            step = target - self.apply(belt)
            belt = belt + step
            if np.abs(step).max(initial=0.0) < 1e-10:
                break
        return belt


@dataclass(frozen=True, eq=False)
class ScrewDrive:
    """Z: its transmission, and ``wobble_mm`` [N, 2]: where the screw pushes the nozzle at each entry of its tables.

    ``rest_share`` is that of `Mechanism`, for the nut in its play.
    """

    transmission: Transmission
    wobble_mm: np.ndarray
    rest_share: float = 0.5

    def __post_init__(self) -> None:
        object.__setattr__(self, "wobble_mm", frozen(np.asarray(self.wobble_mm, float)))

    def wobble_at_mm(self, motor_mm: np.ndarray) -> np.ndarray:
        """Return the push [N, 2] mm at commanded heights [N] mm."""
        grid = self.transmission.motor_mm
        return np.stack([np.interp(motor_mm, grid, self.wobble_mm[:, axis]) for axis in range(2)], axis=1)


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A whole machine, true or learned: a transmission for each planar motor, then the frame; and Z, where it matters.

    Without a ``screw`` Z is as commanded and pushes nothing. ``rest_share`` says where in its play each belt rests when
    a layer starts: 0 where the motor would push it forwards at once, 1 where back, and in the middle of the two.
    """

    printer: Printer
    transmissions: tuple[Transmission, Transmission]
    frame: Frame = field(default_factory=Frame)
    screw: ScrewDrive | None = None
    rest_share: tuple[float, float] = (0.5, 0.5)

    def homed(self) -> "Mechanism":
        """Return this machine with the origin that homing gives it.

        The end stop fixes the carriage: at the home position, reached from the homing direction, the bed
        position is the home position. So the branch engaged there is shifted to pass through it.
        """
        home_xy = np.array(self.printer.home_mm)
        motors_mm = self.printer.to_motor(home_xy)
        belts_mm = self.printer.to_motor(self.frame.invert(home_xy))
        shifted = []
        for motor, transmission in enumerate(self.transmissions):
            lower, upper = transmission.branches_mm(motors_mm[motor])
            engaged = lower if self.printer.motor_home_direction(motor) > 0 else upper
            shifted.append(transmission.shifted(float(belts_mm[motor] - engaged)))
        screw = None if self.screw is None else self._homed_screw(self.screw)
        return replace(self, transmissions=(shifted[0], shifted[1]), screw=screw)

    def _homed_screw(self, screw: ScrewDrive) -> ScrewDrive:
        z = self.printer.z
        lower, upper = screw.transmission.branches_mm(np.array(z.home_mm))
        engaged = lower if z.home_direction > 0 else upper
        at_home = screw.wobble_at_mm(np.array([z.home_mm]))
        return replace(
            screw,
            transmission=screw.transmission.shifted(float(z.home_mm - engaged)),
            wobble_mm=screw.wobble_mm - at_home,
        )


def healthy_mechanism(printer: Printer) -> Mechanism:
    """Return the machine as designed."""
    return Mechanism(printer, (healthy_transmission(printer, 0), healthy_transmission(printer, 1)))


@dataclass(frozen=True, eq=False)
class GainMechanism:
    """The simulator of the paper's published code: a gain a step, indexed by the nominal position.

    ``gains`` is a pair of arrays of 1100 gains. The same in both directions and not conservative; rules in
    physics.md §8.1. Exists so that the paper's own protocol can be run.
    """

    printer: Printer
    gains: tuple[np.ndarray, np.ndarray]

    def __post_init__(self) -> None:
        object.__setattr__(self, "gains", tuple(frozen(np.asarray(row, float)) for row in self.gains))
