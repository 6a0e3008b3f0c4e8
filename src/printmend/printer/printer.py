"""A printer's geometry: what a healthy machine of this kind would do."""

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from printmend.units import radius_mm

Kinematics = Literal["cartesian", "corexy"]
Extruder = Literal["bowden", "direct"]
PAUSE = "M0"  # Marlin and its kin wait, where they stand, for a press of the knob
KLIPPER_PAUSE, RRF_PAUSE = "PAUSE", "M226"  # Klipper knows no M0; RepRapFirmware ends the print there
Switch = Literal["unknown", "switch", "optical", "sensorless", "phase"]
SWITCHES: tuple[str, ...] = get_args(Switch)


@dataclass(frozen=True)
class Axis:
    """One axis of the bed and the motor that goes with it.

    ``home_mm`` is the coordinate that the firmware takes after homing against the end stop on ``home_side``.
    On a CoreXY the motors A and B take their steps and circumference from ``x`` and ``y``.
    """

    name: str
    min_mm: float
    max_mm: float
    steps_per_turn: int
    mm_per_turn: float
    microsteps: int
    home_mm: float
    home_side: Literal["min", "max"]

    @property
    def mm_per_step(self) -> float:
        """Travel of one full motor step [mm]."""
        return self.mm_per_turn / self.steps_per_turn

    @property
    def length_mm(self) -> float:
        return self.max_mm - self.min_mm

    @property
    def radius_mm(self) -> float:
        """Effective radius of the healthy pulley [mm]."""
        return radius_mm(self.mm_per_turn)

    @property
    def home_direction(self) -> int:
        """The sign of the last move of homing: +1 towards the maximum, −1 towards the minimum."""
        return 1 if self.home_side == "max" else -1


@dataclass(frozen=True)
class Homing:
    """The end stops of X and Y.

    ``switch`` is their kind: a micro-switch, one without contact (``optical``, also inductive and Hall), none but the
    motor's own stall (``sensorless``), or one whose place the firmware corrects by the motor's ``phase``.
    ``scatter_mm`` is the standard deviation of the place at which they switch, None where nobody measured it.
    """

    switch: Switch = "unknown"
    scatter_mm: float | None = None


@dataclass(frozen=True)
class MotionLimits:
    """The limits of the owner's firmware, None where unknown.

    ``speed_mm_s`` and ``accel_mm_s2`` hold for the head unless a file sets others. ``crossing_mm_s2`` is how fast a
    motor may speed up while it crosses its slack: then it drives nothing but itself.
    """

    speed_mm_s: float | None = None
    accel_mm_s2: float | None = None
    crossing_mm_s2: float | None = None


@dataclass(frozen=True)
class Printer:
    """A machine: three axes, the way its motors move them, and what a test print needs to start.

    ``extruder`` says where the filament's motor sits: a Bowden tube needs a longer retraction. ``start_gcode`` are the
    owner's lines that heat, home and level; without any a test print uses plain ones. ``pause_gcode`` is the command
    that waits for the owner. ``homing`` says how X and Y find home, ``limits`` are the firmware's. None of these
    belongs to the mechanics: machines that differ only there are equal.
    """

    name: str
    kinematics: Kinematics
    x: Axis
    y: Axis
    z: Axis
    extruder: Extruder = field(default="bowden", compare=False)
    start_gcode: str = field(default="", compare=False)
    pause_gcode: str = field(default=PAUSE, compare=False)
    homing: Homing = field(default=Homing(), compare=False)
    limits: MotionLimits = field(default=MotionLimits(), compare=False)

    @property
    def axes(self) -> tuple[Axis, Axis, Axis]:
        return (self.x, self.y, self.z)

    @property
    def motors(self) -> tuple[str, str]:
        """The names of the two planar motors: they own the pulleys, the belts and their faults."""
        return ("a", "b") if self.kinematics == "corexy" else ("x", "y")

    @property
    def home_mm(self) -> tuple[float, float]:
        return (self.x.home_mm, self.y.home_mm)

    @property
    def middle_mm(self) -> tuple[float, float]:
        """The middle of the bed."""
        return ((self.x.min_mm + self.x.max_mm) / 2, (self.y.min_mm + self.y.max_mm) / 2)

    @property
    def mm_per_step(self) -> tuple[float, float]:
        """Travel of one full step of each planar motor [mm]."""
        return (self.x.mm_per_step, self.y.mm_per_step)

    @property
    def bed_steps(self) -> tuple[int, int]:
        """The lattice of the bed: nominal positions are the integers 0…n on each axis."""
        return (round(self.x.length_mm / self.x.mm_per_step), round(self.y.length_mm / self.y.mm_per_step))

    def to_motor(self, xy: np.ndarray) -> np.ndarray:
        """Map bed coordinates [..., 2] to motor coordinates [..., 2], in the same unit.

        Cartesian: the identity. CoreXY: a = x + y, b = x − y (physics.md §3, eq. 13).
        """
        if self.kinematics == "cartesian":
            return np.asarray(xy)
        xy = np.asarray(xy)
        return np.stack([xy[..., 0] + xy[..., 1], xy[..., 0] - xy[..., 1]], axis=-1)

    def from_motor(self, motor: np.ndarray) -> np.ndarray:
        """Invert `to_motor`: x = (a + b)/2, y = (a − b)/2 on a CoreXY."""
        if self.kinematics == "cartesian":
            return np.asarray(motor)
        motor = np.asarray(motor)
        return np.stack([(motor[..., 0] + motor[..., 1]) / 2, (motor[..., 0] - motor[..., 1]) / 2], axis=-1)

    def motor_range_mm(self, motor: int) -> tuple[float, float]:
        """The motor coordinates [mm] that the bed's corners span."""
        corners = np.array([[x, y] for x in (self.x.min_mm, self.x.max_mm) for y in (self.y.min_mm, self.y.max_mm)])
        values = self.to_motor(corners)[:, motor]
        return float(values.min()), float(values.max())

    def motor_home_direction(self, motor: int) -> int:
        """The sign of the motor's last move while homing X, then Y.

        On a CoreXY the axis that homes last moves both motors: +y turns A forwards and B backwards.
        """
        if self.kinematics == "cartesian":
            return (self.x, self.y)[motor].home_direction
        return self.y.home_direction * (1 if motor == 0 else -1)
