"""What is said of an effect: its faults by name, and its sentences in English and German.

An effect says something of itself with up to three methods beside its columns. Each is optional:

- ``faults(found, beside, scene)`` yields a `Fault` for each thing that an effect which acts does;
- ``told(found, beside, scene)`` yields a `Told` for each thing that an effect which cannot act does to a print;
- ``advice(fault, where)`` returns what an owner should do about a fault of its kind, None for other kinds.

An effect without them is still named, by its name and by how far it moves a print.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from printmend.effects.effect import Effect, Places, Scene
from printmend.messages import say, say_own

NAMED_SIGMAS = 3.0  # a fault is named if it is larger than so many of its standard deviations …
LEAST = {"mm": 0.002, "%": 0.005, "°": 0.001}  # … and than this in its unit: smaller faults move no print
BELOW_SIGMAS, BELOW_SHARE = 2.0, 0.0228  # this share of a normal law lies so far below its median
LEAST_SHOWN_MM = 0.005  # a fault whose size is said with two decimals would be said to be 0.00 below this
SOON_MM = 0.1  # effect on a print above which a part should be looked at
CARRIES = say("printmend-carries-all")
PLACES = 201  # places along an axis at which the size of an effect is looked at


@dataclass(frozen=True)
class Message:
    """A sentence of an effect from outside, in English and in German, with places {a}, {b}, … that calling it fills.

    The sentences of printmend's own effects are in the catalogue (`messages`), by id.
    """

    english: str
    german: str = ""

    def __call__(self, *values: object) -> str:
        return say_own((self.english, self.german), *values)


@dataclass(frozen=True)
class Fault:
    """One fault of one motor or of the frame: ``kind``, ``value`` ± ``sd`` in ``unit``, and the words for it.

    ``is_mended`` says whether it acts, so that files are mended for it: an effect that the next homing shifts too far
    is named, and left as it is.
    """

    part: str
    kind: str
    value: float
    sd: float
    unit: str
    words: str
    is_mended: bool = True

    @property
    def row(self) -> dict[str, str | float | bool]:
        """The fault as a row of a model file's diagnosis."""
        sizes = {"value": round(self.value, 6), "sd": round(self.sd, 6)}
        left: dict[str, bool] = {} if self.is_mended else {"is_mended": False}
        return {"part": self.part, "kind": self.kind, **sizes, "unit": self.unit, **left}


def fault_of(row: Mapping[str, Any]) -> Fault:
    """Return a fault from a row of a model file's diagnosis; its words are not kept there."""
    names = ("part", "kind", "value", "sd", "unit")
    return Fault(**{name: row[name] for name in names}, words="", is_mended=bool(row.get("is_mended", True)))


@dataclass(frozen=True)
class Told:
    """What an effect that cannot act does to a print: ``kind`` for programs and ``words`` for an owner.

    ``is_harmless`` marks what is of the measurement or is set elsewhere: it is a note, however large.
    """

    kind: str
    words: str
    is_harmless: bool = False


@dataclass(frozen=True)
class Care:
    """What to do about a fault: its ``title`` and ``meaning``, by how much it shifts a print, how to repair it, and
    what software carries."""

    title: str
    meaning: str
    effect_mm: float
    repair: str
    software: str = CARRIES


@dataclass(frozen=True, eq=False)
class Found:
    """An effect at one place as it is believed.

    ``sizes_mm`` [P] are those that act, or for an effect that does not act the mean of the drawn machines that have it.
    ``draws_mm`` [P, D] are those of all drawn machines, near shapes included; ``chance`` is the share of them that
    have it.
    """

    law: Effect
    where: int
    shape: tuple[float, ...]
    sizes_mm: np.ndarray
    draws_mm: np.ndarray
    chance: float = 1.0
    acts: bool = False

    @property
    def effect(self) -> str:
        return self.law.name

    def columns(self, places: Places, scene: Scene) -> np.ndarray:
        """Return where places move [N, 2, P] mm for one unit of each size."""
        return self.law.columns(places, self.where, self.shape, scene)

    def size(self, measure: Callable[[np.ndarray], float]) -> tuple[float, float]:
        """Return a measure of the sizes [P], and its standard deviation towards 0 over the drawn machines that have it:
        that of a normal law with their median and a low quantile, for a few may be much larger."""
        size = float(measure(self.sizes_mm))
        drawn = [np.sign(size) * measure(each) for each in self.draws_mm[:, self.draws_mm.any(axis=0)].T] or [0.0]
        low, middle = np.quantile(drawn, [BELOW_SHARE, 0.5])
        return size, float(middle - low) / BELOW_SIGMAS


def amount(value: float, sd: float, unit: str = "mm") -> str:
    """Write a value with its uncertainty, to two digits of the latter: ``0.213 ± 0.021 mm``."""
    digits = int(np.clip(1 - np.floor(np.log10(max(sd, 1e-6))), 2, 4))
    return f"{value:.{digits}f} ± {max(sd, 10.0**-digits):.{digits}f} {unit}"


def motor_name(scene: Scene, motor: int) -> str:
    """Return a motor's name as programs have it: ``x``, or on a CoreXY ``a``."""
    return scene.printer.motors[motor]


def carrier_name(scene: Scene, where: int) -> str:
    """Return in an owner's words what moved: motor ``where`` (0, 1), or bed axis ``where − 2``."""
    return motor_name(scene, where).upper() if where < 2 else "XY"[where - 2]


def along_motor_mm(scene: Scene, motor: int) -> np.ndarray:
    """Return places [N] over what was seen of a motor."""
    return np.linspace(*scene.motor_span_mm[motor], PLACES)


def span_mm(scene: Scene, axis: int) -> float:
    """Return the length that was seen of a bed axis."""
    low, high = scene.bed_span_mm[axis]
    return high - low


def those_of(effect: str, beside: Iterable[Found], where: int | None = None, *, acts: bool = True) -> list[Found]:
    """Return those of one effect, at one place where that is given, that act."""
    return [
        each for each in beside if each.effect == effect and where in (None, each.where) and (each.acts or not acts)
    ]


def is_first(found: Found, effects: Sequence[str], beside: Iterable[Found]) -> bool:
    """Say whether this is the first of some effects that make one fault together, which is said once."""
    return next((each for each in beside if each.effect in effects and each.acts), found) is found
