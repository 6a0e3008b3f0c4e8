"""The words for an effect: the names of its numbers, its faults, and its sentences in English and German.

Beside its columns, an effect may have up to three methods for its words:

- ``faults(found, beside, scene)`` yields a `Fault` for each thing that an effect which acts does;
- ``told(found, beside, scene)`` yields a `Told` for each thing that an effect which cannot act does to a print;
- ``advice(fault, where)`` returns the `Care` for a fault of its ``kinds``, by default of its name.

Without them, the program gives the effect's name and how far it moves a print.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from printmend.effects.effect import SCALE_MM, Acts, Effect, Places, Scene, name_of, terms_of
from printmend.messages import say, say_own
from printmend.units import SELDOM_SDS

if TYPE_CHECKING:
    from printmend.effects.sized import Sized

# How a person writes an effect down: the names of its numbers, with their units, and the effect that they make.
#
# An effect may have ``keys``: how its shape and its sizes follow from numbers with names. Missing numbers are drawn
# from the prior. `Numbers` name the values one by one, `Waves` give one harmonic by size and phase, `Whole` scales a
# drawn course to a size.

Given = Mapping[str, float | str]

# For each number: the least, the most, and an example. A name that is not here goes by its unit.
_LIMITS: dict[str, tuple[float, float, float]] = {
    "period_mm": (0.05, 10_000.0, 60.0),
    "long_mm": (0.1, 1000.0, 10.0),
    "length_mm": (0.05, 1000.0, 3.0),
    "width_mm": (0.1, 1000.0, 5.0),
    "at_mm": (-10_000.0, 10_000.0, 100.0),
    "at_share": (0.0, 1.0, 0.5),
    "after_share": (0.001, 10.0, 0.2),
    "turn_share": (0.0, 1.0, 0.05),
    "scatter_mm": (0.0, 5.0, 0.1),
    "teeth": (-1000.0, 1000.0, 3.0),
    "harmonic": (1.0, 32.0, 2.0),
    "side": (-1.0, 1.0, 1.0),
}
_UNITS: dict[str, tuple[float, float, float]] = {
    "mm": (-100.0, 100.0, 0.2),
    "rad": (-1000.0, 1000.0, 0.5),
    "deg": (-45.0, 45.0, 0.3),
    "percent": (-50.0, 50.0, 0.3),
}
AXES = "xy"


class Keys(Protocol):
    """The named numbers of an effect."""

    @property
    def names(self) -> tuple[str, ...]: ...

    def filled(self, given: Given, drawn: "Sized", effect: Effect, scene: Scene) -> "Sized":
        """Return a drawn effect with the numbers that were given."""
        ...


def limits_of(name: str) -> tuple[float, float, float]:
    """Return the smallest and the largest value of a number, and an example."""
    return _LIMITS.get(name) or _UNITS.get(name.rpartition("_")[2], (-1e4, 1e4, 0.2))


@dataclass(frozen=True)
class Numbers:
    """Values of the shape and the sizes, one by one, in their order; those without a name stay as drawn.

    ``axis`` is x or y. An angle in degrees becomes mm per 100 mm.
    """

    sizes: tuple[str, ...] = ("size_mm",)
    shape: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        return (*self.shape, *self.sizes)

    def filled(self, given: Given, drawn: "Sized", effect: Effect, scene: Scene) -> "Sized":
        if any(name in given for name in self.sizes):  # sizes that are given stand alone
            drawn = drawn.of(sizes_mm=np.zeros(len(drawn.sizes_mm)))
        sizes = _replaced(self.sizes, given, drawn.sizes_mm)
        return drawn.of(shape=tuple(_replaced(self.shape, given, drawn.shape)), sizes_mm=np.array(sizes))


@dataclass(frozen=True)
class Waves:
    """One harmonic of a Fourier series: size·cos(kφ − phase). If none of its numbers is given, the whole series is
    drawn."""

    harmonics: tuple[int, ...] = (1,)
    shape: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        return (*self.shape, *(("harmonic",) if len(self.harmonics) > 1 else ()), "size_mm", "phase_rad")

    def filled(self, given: Given, drawn: "Sized", effect: Effect, scene: Scene) -> "Sized":
        drawn = drawn.of(shape=tuple(_replaced(self.shape, given, drawn.shape)))
        if not set(given) & {"harmonic", "size_mm", "phase_rad"}:
            return drawn
        order = int(given.get("harmonic", self.harmonics[0]))
        count = len(self.harmonics)
        at = self.harmonics.index(order)
        cos, sin = float(drawn.sizes_mm[at]), float(drawn.sizes_mm[count + at])
        size, phase = float(given.get("size_mm", math.hypot(cos, sin))), given.get("phase_rad", math.atan2(sin, cos))
        sizes = np.zeros(len(drawn.sizes_mm))
        sizes[[at, count + at]] = size * math.cos(float(phase)), size * math.sin(float(phase))
        return drawn.of(sizes_mm=sizes)


@dataclass(frozen=True)
class Whole:
    """A randomly drawn curve; ``size_mm`` is its largest error."""

    @property
    def names(self) -> tuple[str, ...]:
        return ("size_mm",)

    def filled(self, given: Given, drawn: "Sized", effect: Effect, scene: Scene) -> "Sized":
        if "size_mm" not in given:
            return drawn
        from printmend.effects.effect import drawn_places

        moved = effect.columns(drawn_places(scene), drawn.where, drawn.shape, scene) @ drawn.sizes_mm
        return drawn.of(sizes_mm=drawn.sizes_mm * float(given["size_mm"]) / float(np.hypot(*moved.T).max()))


def keys_of(effect: Effect, shapes: int, sizes: int) -> Keys:
    """Return an effect's keys; without any, they are numbered in order."""
    named: Keys | None = getattr(effect, "keys", None)
    if named is not None:
        return named
    each = ("size_mm",) if sizes == 1 else tuple(f"size_{k + 1}_mm" for k in range(sizes))
    return Numbers(each, tuple(f"shape_{k + 1}" for k in range(shapes)))


def _replaced(names: tuple[str, ...], given: Given, values: "tuple[float, ...] | np.ndarray") -> list[float]:
    """Return values with those that were given in place of the first ones."""
    out = [float(value) for value in values]
    for k, name in enumerate(names):
        if name in given and k < len(out):
            out[k] = _number(name, given[name])
    return out


def _number(name: str, value: float | str) -> float:
    if isinstance(value, str):
        return float(AXES.index(value))
    return SCALE_MM * math.tan(math.radians(value)) if name.endswith("_deg") else value


NAMED_SIGMAS = 3.0  # a fault is named if it is larger than so many of its standard deviations …
LEAST_SHOWN = 0.005  # … and than this, in mm, % or °: with two decimals a smaller one would be said to be 0.00
SOON_MM = 0.1  # effect on a print above which a part should be looked at …
REPAIR_MM = 0.5  # … and above which it should be replaced
CARRIES, NOTHING = say("printmend-carries-all"), say("nothing-replace")  # what software does and an owner need not
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

    ``is_mended`` says whether files are mended for it. Otherwise it is only named: homing shifts it too far, or it
    ``is_doubtful`` whether mending would help.
    """

    part: str
    kind: str
    value: float
    sd: float
    unit: str
    words: str
    is_mended: bool = True
    is_doubtful: bool = False

    @property
    def size(self) -> float:
        """Its absolute value."""
        return abs(self.value)

    @property
    def shown(self) -> str:
        """Its size with two decimals."""
        return f"{self.size:.2f}"

    @property
    def row(self) -> dict[str, str | float | bool]:
        """The fault as a row of a model file's diagnosis."""
        sizes = {"value": round(self.value, 6), "sd": round(self.sd, 6)}
        left: dict[str, bool] = {} if self.is_mended else {"is_mended": False}
        doubt: dict[str, bool] = {"is_doubtful": True} if self.is_doubtful else {}
        return {"part": self.part, "kind": self.kind, **sizes, "unit": self.unit, **left, **doubt}


def plain_kind(kind: str) -> str:
    """Return a kind of fault without its number: ``harmonic-2`` is a ``harmonic``."""
    return kind.rstrip("0123456789.").removesuffix("-")


def fault_of(row: Mapping[str, Any]) -> Fault:
    """Return a fault from a row of a model file's diagnosis; its words are not kept there."""
    names = ("part", "kind", "value", "sd", "unit")
    said = {name: row[name] for name in names}
    is_mended, is_doubtful = bool(row.get("is_mended", True)), bool(row.get("is_doubtful", False))
    return Fault(**said, words="", is_mended=is_mended, is_doubtful=is_doubtful)


@dataclass(frozen=True)
class Told:
    """The consequence of an effect that cannot act: ``kind`` for programs and ``words`` for an owner.

    ``is_harmless`` marks errors of the measurement, or of settings elsewhere: they become a note, however large. One
    that ``may_be_printers`` leaves it open whether its motor is healthy.
    """

    kind: str
    words: str
    is_harmless: bool = False
    may_be_printers: bool = False


@dataclass(frozen=True)
class Care:
    """Advice about a fault: its ``title`` and ``meaning``, by how much it shifts a print, how to repair it, and what
    software corrects."""

    title: str
    meaning: str
    effect_mm: float
    repair: str
    software: str = CARRIES


def where_seen(effect_mm: float, repair: str, otherwise: str = NOTHING) -> str:
    """Return the repair of a fault that moves a print so far, or what is said where a print hardly shows it."""
    return repair if effect_mm >= SOON_MM else otherwise


@dataclass(frozen=True, eq=False)
class Found:
    """An effect at one place as it is believed.

    ``sizes_mm`` [P] are those that act, or for an effect that does not act the mean of the drawn machines that have it.
    ``draws_mm`` [P, D] are those of all drawn machines, near shapes included; ``there`` [D] says which of them have it,
    ``chance`` how many.
    """

    law: Effect
    where: int
    shape: tuple[float, ...]
    sizes_mm: np.ndarray
    draws_mm: np.ndarray
    acts: bool = False

    @property
    def effect(self) -> str:
        return self.law.name

    @cached_property
    def there(self) -> np.ndarray:
        return np.asarray(self.draws_mm.any(axis=0))

    @property
    def chance(self) -> float:
        return float(self.there.mean())

    @property
    def name(self) -> str:
        """What it is called with these sizes."""
        return name_of(self.law, self.sizes_mm)

    @property
    def is_held(self) -> bool:
        """Tell whether a mechanism holds it with these sizes."""
        return self.law.acts is not Acts.NOT and self.name == self.effect

    def columns(self, places: Places, scene: Scene) -> np.ndarray:
        """Return where places move [N, 2, P] mm for one unit of each size."""
        return self.law.columns(places, self.where, self.shape, scene)

    def size(self, measure: Callable[[np.ndarray], float] = lambda sizes: float(sizes[0])) -> tuple[float, float]:
        """Return a measure of the sizes [P], by default the first, and its standard deviation towards 0 over the drawn
        machines that have it: that of a normal law with their median and a low quantile, for a few may be much larger.
        """
        size = float(measure(self.sizes_mm))
        drawn = [np.sign(size) * measure(each) for each in self.draws_mm[:, self.there].T] or [0.0]
        low, middle = np.quantile(drawn, [math.erfc(SELDOM_SDS / math.sqrt(2)) / 2, 0.5])
        return size, float(middle - low) / SELDOM_SDS


def amount(value: float, sd: float, unit: str = "mm") -> str:
    """Write a value with its uncertainty, to two digits of the latter: ``0.213 ± 0.021 mm``."""
    digits = int(np.clip(1 - np.floor(np.log10(max(sd, 1e-6))), 2, 4))
    return f"{value:.{digits}f} ± {max(sd, 10.0**-digits):.{digits}f} {unit}"


def stands_out(size: float, sd: float) -> bool:
    """Tell whether a size is large enough, and sure enough, to be named."""
    return size > max(NAMED_SIGMAS * sd, LEAST_SHOWN)


def motor_name(scene: Scene, motor: int) -> str:
    """Return a motor's name as programs have it: ``x``, or on a CoreXY ``a``."""
    return scene.printer.motors[motor]


def carrier_name(scene: Scene, where: int) -> str:
    """Return in an owner's words what moved: motor ``where`` (0, 1), or bed axis ``where − 2``."""
    return motor_name(scene, where).upper() if where < 2 else "XY"[where - 2]


def is_of_motor(law: Effect) -> bool:
    """Tell whether an effect's first two places are the motors, not the axes of the bed."""
    return bool(getattr(law, "at_motors", law.acts is Acts.DRIVE))


def part_of(law: Effect, where: int, scene: Scene) -> str:
    """Return in an owner's words which motor or axis has an effect, empty for one of the whole frame or machine."""
    if law.acts is Acts.FRAME or len({term.where for term in terms_of(law, scene)}) < 2:
        return ""
    return carrier_name(scene, where if is_of_motor(law) else where % 2 + 2)


def along_motor_mm(scene: Scene, motor: int) -> np.ndarray:
    """Return positions [N] over the measured span of a motor."""
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
