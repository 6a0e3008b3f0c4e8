"""How a person writes an effect down: the names of its numbers, with their units, and the effect that they make.

An effect may have ``keys``: how its shape and its sizes follow from numbers with names. Missing numbers are drawn from
the prior. `Numbers` name the values one by one, `Waves` give one harmonic by size and phase, `Whole` scales a drawn
course to a size.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from printmend.effects.effect import SCALE_MM, Effect, Scene

if TYPE_CHECKING:
    from printmend.effects.sized import Sized

Given = Mapping[str, float | str]

# For each number: the least, the most, and an example. A name that is not here goes by its unit.
_LIMITS: dict[str, tuple[float, float, float]] = {
    "period_mm": (0.05, 10_000.0, 60.0),
    "width_mm": (0.1, 1000.0, 5.0),
    "at_mm": (-10_000.0, 10_000.0, 100.0),
    "at_share": (0.0, 1.0, 0.5),
    "after_share": (0.001, 10.0, 0.2),
    "turn_share": (0.0, 1.0, 0.05),
    "scatter_mm": (0.0, 5.0, 0.1),
    "teeth": (-1000.0, 1000.0, 3.0),
    "harmonic": (1.0, 32.0, 2.0),
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
    """Return the least and the most that a number may be, and one for an example."""
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
    """One harmonic of a Fourier series: size·cos(kφ − phase). Without any of its numbers the whole series is drawn."""

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
    """A drawn course; ``size_mm`` is its largest error."""

    @property
    def names(self) -> tuple[str, ...]:
        return ("size_mm",)

    def filled(self, given: Given, drawn: "Sized", effect: Effect, scene: Scene) -> "Sized":
        if "size_mm" not in given:
            return drawn
        from printmend.effects.sample import drawn_places

        moved = effect.columns(drawn_places(scene), drawn.where, drawn.shape, scene) @ drawn.sizes_mm
        return drawn.of(sizes_mm=drawn.sizes_mm * float(given["size_mm"]) / float(np.hypot(*moved.T).max()))


def keys_of(effect: Effect, shapes: int, sizes: int) -> Keys:
    """Return an effect's keys; one that names none has its numbers in their order."""
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
