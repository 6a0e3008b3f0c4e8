"""A printer's geometry, which a healthy machine of its kind would have; and which printer a name means."""

import re
from dataclasses import dataclass, field
from functools import cache
from itertools import product
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

    ``switch`` is their kind: a micro-switch, a contactless switch (``optical``, also inductive and Hall), stall
    detection (``sensorless``), or a switch whose place the firmware corrects by the motor's ``phase``.
    ``scatter_mm`` is the standard deviation of the place at which they switch, None if not measured.
    """

    switch: Switch = "unknown"
    scatter_mm: float | None = None


@dataclass(frozen=True)
class MotionLimits:
    """The limits of the owner's firmware, None where unknown.

    ``speed_mm_s`` and ``accel_mm_s2`` limit the head unless a file sets others. ``crossing_mm_s2`` limits a motor's
    acceleration while it crosses its slack: it then drives nothing but itself.
    """

    speed_mm_s: float | None = None
    accel_mm_s2: float | None = None
    crossing_mm_s2: float | None = None


@dataclass(frozen=True)
class Printer:
    """A machine: three axes, its kinematics, and what a test print needs to start.

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
    def mm_per_turn(self) -> tuple[float, float]:
        """Travel of one turn of each planar motor [mm]."""
        return (self.x.mm_per_turn, self.y.mm_per_turn)

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


# Which printer a name means: the names that slicers and owners give to printers on the market.


def _of_sizes(words: str, *beds_mm: int) -> tuple[str, ...]:
    """Return the printers of one model in several sizes; its words without a size mean any of them."""
    return tuple(f"{' | '.join(f'{word} {bed_mm}' for word in words.split(' | '))} | {words}" for bed_mm in beds_mm)


# Makers' names, and the names of their printers that differ in bed, kinematics or motors. A space stands for any
# separator or none. An upgrade that keeps the belts and the bed is the same printer (Ender-3, Pro, V2).
_MADE = {
    "anycubic": (
        "i3 mega | mega s | mega pro", "mega x", "mega zero | mega 0", "4 max", "chiron", "vyper", "kobra | kobra neo",
        "kobra 2", "kobra 3", "kobra go", "kobra max | kobra 2 max", "kobra plus | kobra 2 plus", "kobra s1",
    ),
    "artillery": (
        "sidewinder | sidewinder x1 | sidewinder x2 | x1 | x2", "sidewinder x3", "sidewinder x4", "genius", "hornet",
    ),
    "bambu lab | bambu | bbl": (
        "p1p | p1s", "p2s", "x1 | x1c | x1 carbon | x1e", "a1", "a1 mini", "h2d", "h2s", "h2c",
    ),
    "creality | ender": (
        "ender 2", "ender 3 | ender 3 v3 se", "ender 3 v3 ke", "ender 3 max | ender 3 max neo", "ender 3 s1 plus",
        "ender 3 v3", "ender 3 v3 plus", "ender 4", "ender 5", "ender 5 plus", "ender 5 max", "ender 6", "ender 7",
        "cr 5", "cr 6 | cr 6 se", "cr 6 max", "cr 8", "cr 10", "cr 10 mini", "cr 10 se", "cr 10 max", "cr 10 s4",
        "cr 10 s5", "cr 20", "cr 200b", "cr m4", "k1 | k1c | k1 se", "k1 max", "k2", "k2 plus", "sermoon",
    ),
    "elegoo": (
        "neptune 1", "neptune 2", "neptune 3", "neptune 3 plus", "neptune 3 max", "neptune 4", "neptune 4 plus",
        "neptune 4 max", "neptune x", "centauri",
    ),
    "kingroon": ("kp3s", "kp3s pro", "klp1"),
    "lulzbot": ("taz 6", "taz 5", "taz pro", "taz workhorse", "mini"),
    "prusa": (
        "mk2", "mk3 | mk3 5", "mk4 | mk3 9", "mini | mini is", "xl | xl2 | xl5", "core one", "core one l",
    ),
    "qidi": (
        "q1 pro", "q2", "x smart 3", "x plus 3", "x plus 4", "x max 3", "x cf pro", "max 4",
    ),
    "rat rig": (
        *_of_sizes("v core 3 | v core 3 1", 200, 300, 400, 500), *_of_sizes("v core 4", 300, 400, 500), "v minion",
    ),
    "sovol": ("sv01", "sv02", "sv03", "sv04", "sv05", "sv06", "sv06 plus", "sv07", "sv07 plus", "sv08"),
    "two trees": ("sapphire plus", "sapphire pro", "bluer", "sp 3", "sp 5"),
    "voron": (
        "voron 0 | v0", "voron 1 | v1", *_of_sizes("voron 2 | v2 | voron 2 4 | v2 4", 250, 300, 350),
        *_of_sizes("trident", 250, 300, 350), "switchwire | voron switchwire",
    ),
    "voxelab": ("aquila", "aries"),
    "anet": (), "ankermake": (), "biqu": (), "flashforge": (), "flsun": (), "geeetech": (), "makerbot": (),
    "raise3d": (), "snapmaker": (), "tronxy": (), "ultimaker": (), "wanhao": (),
}  # fmt: skip
_OF_ANY_MAKER = "prusai3"  # many makers' clones have this name
_LEAST_LETTERS = 3  # fewest characters of a word with a digit that identifies a printer alone, such as P1S


def printers_named(name: str) -> frozenset[str]:
    """Return the printers that a name may mean, each by the first of its words; none for an unknown name.

    A maker's name without a model's means any of its printers. Many makers use words without a digit (Mini): these
    count only as the whole name, or after the maker's name.
    """
    words, makers, pattern = _known()
    if (whole := words.get(bare_name(name))) is not None:
        return whole
    found = [bare_name(each[0]) for each in pattern.finditer(_of_file(name).lower())]
    models = [words[each] for each in found if each in words]
    return frozenset[str]().union(*(models or [makers[each] for each in found]))


@cache
def _known() -> tuple[dict[str, frozenset[str]], dict[str, frozenset[str]], re.Pattern[str]]:
    """Return the printers by their words, the printers by their makers, and a pattern that finds either in a name."""
    words: dict[str, frozenset[str]] = {}
    makers: dict[str, frozenset[str]] = {_OF_ANY_MAKER: frozenset()}
    patterns = {_OF_ANY_MAKER: _pattern("prusa i3")}
    for maker, printers in _MADE.items():
        calls, names = maker.split(" | "), [each.split(" | ") for each in printers]
        for call in calls:
            makers[bare_name(call)] = frozenset([calls[0], *(f"{calls[0]} {each[0]}" for each in names)])
            patterns[bare_name(call)] = _pattern(call)
        for each in names:
            for call, word in product(("", *calls), each):
                said = f"{call} {word}".strip()
                key = bare_name(said)
                words[key] = words.get(key, frozenset()) | {f"{calls[0]} {each[0]}"}
                if call or (len(key) >= _LEAST_LETTERS and any(c.isdigit() for c in key)):
                    patterns[key] = _pattern(said)
    longest_first = sorted(patterns, key=len, reverse=True)
    return words, makers, re.compile(rf"(?<![^\W_])(?:{'|'.join(patterns[each] for each in longest_first)})")


def _pattern(word: str) -> str:
    """Return a pattern for a word that no digit follows, and no letter if the word ends with a letter."""
    return r"[\W_]*".join(word.split()) + (r"(?!\d)" if word[-1].isdigit() else r"(?![^\W_])")


def bare_name(name: str) -> str:
    """Return a printer's name as lower-case letters and digits; the path of a TOML file counts as its file name."""
    return "".join(each for each in _of_file(name).lower() if each.isalnum())


def _of_file(name: str) -> str:
    return name.replace("\\", "/").rpartition("/")[2] if name.endswith(".toml") else name
