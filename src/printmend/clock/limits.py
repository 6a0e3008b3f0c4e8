"""The limits of a machine, from its file: the slicer's settings, otherwise the defaults of its firmware."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from printmend.clock.kernels import layout as k
from printmend.gcode.machine import Flavour
from printmend.jit import record
from printmend.messages import say
from printmend.printer import MotionLimits

Axes = tuple[float, float, float, float]
_CORNER = {
    "klipper": k.KLIPPER, "marlin": k.JERK, "marlin, by junction deviation": k.DEVIATION, "rrf": k.RRF,
}  # fmt: skip
_BLOCKS = {"klipper": k.QUEUE, "marlin": 16, "marlin, by junction deviation": 16, "rrf": 40}
UNSAID = MotionLimits()
SLICER = "the slicer's settings"
EXAMPLE, OWNER = "an example printer of that firmware", "the printer's file"
_SAID = {SLICER: "limits-of-slicer", EXAMPLE: "limits-of-example", OWNER: "limits-of-owner"}  # messages
FIRMWARES = tuple(_CORNER)
"""Names of the planners that are known."""
_OF_FLAVOUR = {Flavour.KLIPPER: "klipper", Flavour.RRF: "rrf"}
_OF_NAME = {"klipper": "klipper", "rrf": "rrf"}
# Klipper lets the extruder alone go so fast, as a share of the head's limit: a line of 4 nozzles², 0.4 mm, of 1.75 mm.
_EXTRUDER_SHARE = 4 * 0.4**2 / (np.pi * 1.75**2 / 4)


@dataclass(frozen=True)
class Limits:
    """The largest speeds [mm/s], accelerations [mm/s²] and jumps of speed [mm/s] of X, Y, Z, E, and of the head.

    The values are those that Marlin, Klipper and RepRapFirmware have in their own example configurations. ``said`` is
    where they come from. ``velocity_mm_s``, ``corner_mm_s`` and ``cruise_ratio`` are Klipper's.
    """

    firmware: str = "marlin"
    speed_mm_s: Axes = (300.0, 300.0, 5.0, 25.0)
    accel_mm_s2: Axes = (3000.0, 3000.0, 100.0, 10000.0)
    print_mm_s2: float = 3000.0
    travel_mm_s2: float = 3000.0
    retract_mm_s2: float = 3000.0
    jump_mm_s: Axes = (10.0, 10.0, 0.3, 5.0)
    deviation_mm: float = 0.013
    velocity_mm_s: float = 300.0
    corner_mm_s: float = 5.0
    cruise_ratio: float = 0.5
    arc_mm: float = 1.0
    said: str = field(default=EXAMPLE, compare=False)

    @property
    def words(self) -> tuple[str, str]:
        """Say whose planner they are for, and where they come from."""
        name = self.firmware if self.firmware == "rrf" else self.firmware.capitalize()
        return "RepRapFirmware" if name == "rrf" else name, say(_SAID[self.said])

    @property
    def most_mm_s2(self) -> float:
        """The acceleration [mm/s²] that the slicer's settings allow X and Y, 0 where no firmware holds itself to it."""
        return min(self.accel_mm_s2[:2]) if self.said == SLICER and self.firmware != "klipper" else 0.0

    def lower(self) -> np.record:
        """Return them as the kernels read them."""
        limits = record(k.LIMITS)
        limits.corner, limits.blocks = _CORNER[self.firmware], _BLOCKS[self.firmware]
        limits.speed[:], limits.accel[:], limits.jump[:] = self.speed_mm_s, self.accel_mm_s2, self.jump_mm_s
        limits.print_accel, limits.travel_accel = self.print_mm_s2, self.travel_mm_s2
        limits.retract_accel, limits.deviation = self.retract_mm_s2, self.deviation_mm
        limits.velocity, limits.corner_speed = self.velocity_mm_s, self.corner_mm_s
        limits.cruise_ratio, limits.percent, limits.arc_mm = self.cruise_ratio, 100.0, self.arc_mm
        return limits


def klipper(velocity_mm_s: float, accel_mm_s2: float, z_mm_s: float, z_mm_s2: float) -> Limits:
    """Return the limits of a Klipper printer, all else as Klipper takes it unless it is set."""
    return Limits(
        "klipper", (velocity_mm_s, velocity_mm_s, z_mm_s, _EXTRUDER_SHARE * velocity_mm_s),
        (accel_mm_s2, accel_mm_s2, z_mm_s2, _EXTRUDER_SHARE * accel_mm_s2), accel_mm_s2, accel_mm_s2, accel_mm_s2,
        velocity_mm_s=velocity_mm_s,
    )  # fmt: skip


_SETTING = re.compile(
    rb"^;?\s*\"?machine_max_(speed|feedrate|acceleration|jerk|junction_deviation)_?([a-z]*)\"?\s*[:=][\s\[\"]*"
    rb"(\d+(?:\.\d+)?)", re.MULTILINE,
)  # fmt: skip
_IGNORED = re.compile(rb"^;?\s*\"?machine_limits_usage\"?\s*[:=]\s*\"?ignore", re.MULTILINE)


def limits_of(
    flavour: Flavour, hints: tuple[bytes, ...], firmware: str | None = None, owner: MotionLimits = UNSAID
) -> Limits:
    """Return the limits with which a file begins: what its slicer wrote of the machine (`Part.hints`), else the
    firmware's own. M201, M203, M204, M205, M566 and SET_VELOCITY_LIMIT change them on the way.

    ``firmware`` is what reads the file where that is known better (`--firmware`), ``owner`` what the printer's file
    says of it.
    """
    name = _OF_FLAVOUR.get(flavour, "marlin") if firmware is None else _OF_NAME.get(firmware, "marlin")
    plain = klipper(300.0, 3000.0, 25.0, 300.0) if name == "klipper" else Limits(name)
    found: dict[str, float] = {}
    for text in hints:
        if b"machine_max_" in text and not _IGNORED.search(text):
            for kind, axis, value in _SETTING.findall(text):
                found.setdefault(f"{kind.decode()} {axis.decode()}", float(value))
    found = {key: value for key, value in found.items() if value > 0.0}
    return _owned(plain if not found else _settled(plain, found), owner)


def _owned(limits: Limits, owner: MotionLimits) -> Limits:
    """Return the limits with those of the printer's file."""
    if owner.speed_mm_s is not None:
        speed = owner.speed_mm_s
        limits = replace(limits, velocity_mm_s=speed, speed_mm_s=(speed, speed, *limits.speed_mm_s[2:]))
    if owner.accel_mm_s2 is not None:
        accel = owner.accel_mm_s2
        most = max(accel, owner.crossing_mm_s2 or 0.0)
        limits = replace(
            limits, print_mm_s2=accel, travel_mm_s2=accel, accel_mm_s2=(most, most, *limits.accel_mm_s2[2:])
        )
    if owner.speed_mm_s is None and owner.accel_mm_s2 is None:
        return limits
    return replace(limits, said=OWNER)


def _settled(plain: Limits, found: Mapping[str, float]) -> Limits:
    """Return the limits with those of a slicer's settings."""

    def axes(kind: str, otherwise: Axes) -> Axes:
        x, y, z, e = (found.get(f"{kind} {axis}", old) for axis, old in zip("xyze", otherwise, strict=True))
        return x, y, z, e

    speed, accel = axes("feedrate", plain.speed_mm_s), axes("acceleration", plain.accel_mm_s2)
    print_mm_s2 = found.get("acceleration extruding", min(accel[:2]))
    name = plain.firmware
    if name == "marlin" and "junction_deviation " in found and not any(key.startswith("jerk") for key in found):
        name = "marlin, by junction deviation"
    return Limits(
        name, speed, accel, print_mm_s2, found.get("acceleration travel", print_mm_s2),
        found.get("acceleration retracting", plain.retract_mm_s2), axes("jerk", plain.jump_mm_s),
        found.get("junction_deviation ", plain.deviation_mm), min(speed[:2]), plain.corner_mm_s, plain.cruise_ratio,
        said=SLICER,
    )  # fmt: skip
