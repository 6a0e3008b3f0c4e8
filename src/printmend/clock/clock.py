"""Compute how long a printer takes for a file, mended or as it is, by a model of its firmware's planner."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from printmend.clock import kernels as k
from printmend.clock.kernels import advance
from printmend.gcode.container import open_gcode
from printmend.gcode.kernels import NO_NOTES, PIECE, RECORD
from printmend.gcode.machine import Flavour
from printmend.gcode.read import starting_state
from printmend.gcode.write import Planned, follow
from printmend.jit import record
from printmend.messages import say
from printmend.printer import MotionLimits, Printer

# Read a machine's limits from the file: the slicer's settings, otherwise the defaults of its firmware.

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
"""Names of the known planners."""
_OF_FLAVOUR = {Flavour.KLIPPER: "klipper", Flavour.RRF: "rrf"}
_OF_NAME = {"klipper": "klipper", "rrf": "rrf"}
# Klipper's limit for the extruder alone, as a share of the head's: a bead of 4 · 0.4² mm² over the filament's area.
_EXTRUDER_SHARE = 4 * 0.4**2 / (np.pi * 1.75**2 / 4)


@dataclass(frozen=True)
class Limits:
    """The largest speeds [mm/s], accelerations [mm/s²] and jumps of speed [mm/s] of X, Y, Z, E, and of the head.

    The defaults are those of the example configurations of Marlin, Klipper and RepRapFirmware. ``said`` is the values'
    source. ``velocity_mm_s``, ``corner_mm_s`` and ``cruise_ratio`` are Klipper's. ``most_mm_s2`` is the acceleration to
    which the firmware limits X and Y, whatever moves ask for; it is 0 if the file does not state it.
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
    most_mm_s2: float = 0.0
    said: str = field(default=EXAMPLE, compare=False)

    @property
    def words(self) -> tuple[str, str]:
        """Return the limits' firmware and their source, in words."""
        name = self.firmware if self.firmware == "rrf" else self.firmware.capitalize()
        return "RepRapFirmware" if name == "rrf" else name, say(_SAID[self.said])

    def lower(self) -> np.record:
        """Return the limits as the kernels read them."""
        limits = record(k.LIMITS)
        limits.corner, limits.blocks = _CORNER[self.firmware], _BLOCKS[self.firmware]
        limits.speed[:], limits.accel[:], limits.jump[:] = self.speed_mm_s, self.accel_mm_s2, self.jump_mm_s
        limits.print_accel, limits.travel_accel = self.print_mm_s2, self.travel_mm_s2
        limits.retract_accel, limits.deviation = self.retract_mm_s2, self.deviation_mm
        limits.velocity, limits.corner_speed = self.velocity_mm_s, self.corner_mm_s
        limits.cruise_ratio, limits.percent, limits.arc_mm = self.cruise_ratio, 100.0, self.arc_mm
        return limits


def klipper(velocity_mm_s: float, accel_mm_s2: float, z_mm_s: float, z_mm_s2: float) -> Limits:
    """Return the limits of a Klipper printer, with Klipper's defaults for all other values."""
    return Limits(
        "klipper", (velocity_mm_s, velocity_mm_s, z_mm_s, _EXTRUDER_SHARE * velocity_mm_s),
        (accel_mm_s2, accel_mm_s2, z_mm_s2, _EXTRUDER_SHARE * accel_mm_s2), accel_mm_s2, accel_mm_s2, accel_mm_s2,
        velocity_mm_s=velocity_mm_s,
    )  # fmt: skip


_SETTING = re.compile(
    rb"^;?\s*\"?machine_max_(speed|feedrate|acceleration|jerk|junction_deviation)_?([a-z]*)\"?\s*[:=][\s\[\"]*"
    rb"(\d+(?:\.\d+)?)", re.MULTILINE,
)  # fmt: skip
_MOST, _WORD = re.compile(rb"^M201(?=\s)[^;\n]*", re.MULTILINE), re.compile(rb"[XY] ?(\d+(?:\.\d+)?)")
_IGNORED = re.compile(rb"^;?\s*\"?machine_limits_usage\"?\s*[:=]\s*\"?ignore", re.MULTILINE)


def limits_of(
    flavour: Flavour, hints: tuple[bytes, ...], firmware: str | None = None, owner: MotionLimits = UNSAID
) -> Limits:
    """Return the limits at the beginning of a file: the slicer's settings for the machine (`Part.hints`), otherwise the
    firmware's defaults. M201, M203, M204, M205, M566 and SET_VELOCITY_LIMIT change them on the way.

    ``firmware`` overrides ``flavour`` (`--firmware`); ``owner`` are the limits in the printer's file, which come first.
    """
    name = _OF_FLAVOUR.get(flavour, "marlin") if firmware is None else _OF_NAME.get(firmware, "marlin")
    plain = klipper(300.0, 3000.0, 25.0, 300.0) if name == "klipper" else Limits(name)
    found: dict[str, float] = {}
    for text in hints:
        if b"machine_max_" in text and not _IGNORED.search(text):
            for kind, axis, value in _SETTING.findall(text):
                found.setdefault(f"{kind.decode()} {axis.decode()}", float(value))
    found = {key: value for key, value in found.items() if value > 0.0}
    limits = _owned(plain if not found else _settled(plain, found), owner)
    if name == "klipper":  # Klipper obeys each move's acceleration, and ignores M201
        return limits
    told = [float(value) for text in hints for line in _MOST.findall(text)[:1] for value in _WORD.findall(line)]
    return replace(limits, most_mm_s2=min(told, default=min(limits.accel_mm_s2[:2]) if found else 0.0))


def _owned(limits: Limits, owner: MotionLimits) -> Limits:
    """Override the limits with those in the printer's file."""
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
    """Override the limits with those in a slicer's settings."""

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


_AS_IT_IS, _NO_RECORDS, _NO_PIECES = np.empty(0, np.int64), np.empty(0, RECORD), np.empty(0, PIECE)


@dataclass(frozen=True)
class Duration:
    """The time of a file as it is and as mended [s], by these ``limits``, without heating, homing and probing."""

    before_s: float
    after_s: float
    limits: Limits

    @property
    def share(self) -> float:
        """The share of time that mending adds."""
        return self.after_s / self.before_s - 1.0 if self.before_s > 0.0 else 0.0

    def json(self) -> dict[str, Any]:
        """Return plain values for a report."""
        limits = self.limits
        return {
            "before_s": round(self.before_s, 2), "after_s": round(self.after_s, 2), "firmware": limits.firmware,
            "limits": limits.said,
        }  # fmt: skip

    def words(self, *, mended: bool) -> str:
        """Say how long the file takes as it is, and mended if ``mended``."""
        before, after = span_words(self.before_s), span_words(self.after_s)
        if mended:
            return say("it-takes-mended", before, after, f"{100 * self.share:+.1f}", *self.limits.words)
        return say("it-takes", before, *self.limits.words)

    def __add__(self, other: "Duration") -> "Duration":
        """Return the time of two prints, one after the other."""
        return replace(self, before_s=self.before_s + other.before_s, after_s=self.after_s + other.after_s)


@dataclass(eq=False)
class Clock:
    """A clock on its way through one program. Mutable, because a file of any length streams through it.

    ``times_s`` [TIMES] are the times at the places where the file states the printing time, as far as it was read.
    """

    limits: np.record
    state: np.record = field(default_factory=lambda: record(k.CLOCK))
    queue: np.ndarray = field(default_factory=lambda: np.zeros(k.QUEUE, k.MOVE), repr=False)
    times_s: np.ndarray = field(default_factory=lambda: np.zeros(k.TIMES), repr=False)

    def advance(self, planned: Planned, *, mended: bool) -> None:
        """Advance by a part of a file, as it is or as planned."""
        first = planned.first if mended else _AS_IT_IS
        advance(
            self.limits, self.state, self.queue, self.times_s, planned.records, planned.begin, planned.end,
            planned.notes, first, planned.pieces, False,
        )  # fmt: skip

    def finish(self) -> None:
        """Let the machine stop."""
        advance(
            self.limits, self.state, self.queue, self.times_s, _NO_RECORDS, 0, 0, NO_NOTES, _AS_IT_IS, _NO_PIECES, True
        )

    @property
    def seconds(self) -> float:
        """The time so far [s]."""
        return float(self.state.seconds)


def start_clock(limits: Limits) -> Clock:
    """Return a clock at the beginning of a program."""
    clock = Clock(limits.lower())
    clock.state.at[:] = np.nan
    clock.state.peak2 = np.inf
    return clock


@dataclass(eq=False)
class Stopwatch:
    """Both clocks of one program: of the file as it is, and of the mended one."""

    limits: Limits
    before: Clock
    after: Clock

    def watch(self, planned: Planned) -> None:
        """Advance both clocks by a part of the program."""
        self.before.advance(planned, mended=False)
        self.after.advance(planned, mended=True)

    def finish(self) -> None:
        """Let both machines stop."""
        self.before.finish()
        self.after.finish()

    @property
    def duration(self) -> Duration:
        """The times of both clocks so far."""
        return Duration(self.before.seconds, self.after.seconds, self.limits)


def start_stopwatch(limits: Limits) -> Stopwatch:
    """Return both clocks at the beginning of a program."""
    return Stopwatch(limits, start_clock(limits), start_clock(limits))


def span_words(seconds: float) -> str:
    """Return a time in hours, minutes and seconds, the two largest that it has."""
    whole = round(seconds)
    hours, minutes = whole // 3600, whole % 3600 // 60
    if hours:
        return f"{hours} h {minutes} min"
    return f"{minutes} min {whole % 60} s" if minutes else f"{whole} s"


def file_seconds(path: Path | str, limits: Limits, printer: Printer) -> float:
    """Return how long ``printer`` takes for a file's programs within ``limits`` [s]. Raises like `open_gcode`."""
    seconds = 0.0
    with open_gcode(path) as file:
        for part in file.parts:
            clock = start_clock(limits)
            state = starting_state(part, printer=printer)
            follow(part.chunks(), state, _as_it_is, look=partial(clock.advance, mended=False))
            clock.finish()
            seconds += clock.seconds
    return seconds


def _as_it_is(records: np.ndarray, _begin: int) -> tuple[int, np.ndarray, np.ndarray]:
    return len(records), np.zeros(len(records) + 1, np.int64), _NO_PIECES
