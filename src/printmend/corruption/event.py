"""Events of a print, named as effects are: a homing, a refit, a filament.

    homing:switch=sensorless          refit:on=x,teeth=3          filament:polymer=petg,hole_mm=0.1

`EVENTS` lists them by name. Values that are left out are drawn: a homing's by its switch, a filament's by its polymer.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol, cast

import numpy as np

from printmend.effects.prior import numbers_of
from printmend.effects.sized import Sized
from printmend.effects.switch import homing_mm, refit_mm
from printmend.effects.teeth import TOOTH_MM
from printmend.filament import material_of, polymers
from printmend.messages import say
from printmend.printer import Homing, Printer
from printmend.printer.printer import Switch

Given = Mapping[str, float | str]
SQUEEZED_MM = 0.1  # a first layer is pressed wider than the file says, on either side of a bead


@dataclass(frozen=True)
class Beads:
    """How far beads are too far out [mm], in addition to the effect `bead`: in holes, at corners, and at the foot of
    the first layer."""

    hole_mm: float = 0.0
    corner_mm: float = 0.0
    foot_mm: float = SQUEEZED_MM


@dataclass(frozen=True, eq=False)
class Made:
    """The changes that a cause makes to a printer: effects, a shift of both motors [2] mm, and beads (or None)."""

    parts: tuple[Sized, ...] = ()
    shift_mm: np.ndarray = field(default_factory=lambda: np.zeros(2))
    beads: Beads | None = None


class Event(Protocol):
    """An event of a print. ``names`` are its values; ``words`` are those whose values are texts."""

    @property
    def names(self) -> tuple[str, ...]: ...

    @property
    def words(self) -> tuple[str, ...]: ...

    @property
    def has_motors(self) -> bool: ...

    @property
    def said(self) -> str: ...

    @property
    def example(self) -> str: ...

    def made(self, given: Given, motor: int | None, printer: Printer, rng: np.random.Generator) -> Made:
        """Return the changes that it makes to a printer; ``motor`` is the affected motor, None for all."""
        ...


class Homed:
    """The end stops switch away from their mean place, and a motor may be off by an electrical turn."""

    names = ("switch", "scatter_mm", "turn_share")
    words = ("switch",)
    has_motors = False
    said = say("event-homing")
    example = "homing:switch=sensorless"

    def made(self, given: Given, motor: int | None, printer: Printer, rng: np.random.Generator) -> Made:
        if "switch" in given:
            printer = replace(printer, homing=Homing(cast(Switch, given["switch"])))
        scatter, turns = (None if name not in given else float(given[name]) for name in self.names[1:])
        return Made(shift_mm=homing_mm(printer, rng, scatter_mm=scatter, turn_share=turns))


class Refit:
    """Belts that were taken off and put back, each on any tooth."""

    names = ("teeth",)
    words: tuple[str, ...] = ()
    has_motors = True
    said = say("event-refit")
    example = "refit:on=x,teeth=3"

    def made(self, given: Given, motor: int | None, printer: Printer, rng: np.random.Generator) -> Made:
        shift = refit_mm(printer, rng)
        if "teeth" in given:
            shift = np.full(2, TOOTH_MM * float(given["teeth"]))
        return Made(shift_mm=shift if motor is None else np.where(np.arange(2) == motor, shift, 0.0))


class Filament:
    """A part printed in a polymer: it shrinks along each axis, and its lines change their width at outlines, holes and
    corners, and in the first layer."""

    names = ("polymer", "x_percent", "y_percent", "outline_mm", "hole_mm", "corner_mm", "foot_mm")
    words = ("polymer",)
    has_motors = False
    said = say("event-filament")
    example = "filament:polymer=petg,hole_mm=0.1"

    def made(self, given: Given, motor: int | None, printer: Printer, rng: np.random.Generator) -> Made:
        known = polymers()
        drawn = known[int(rng.integers(len(known)))]
        material = material_of(str(given.get("polymer", drawn)))
        shrinks = np.maximum(100 * (material.mean + material.sd * rng.standard_normal(2)), 0.0)
        ranges = {name: numbers_of("beads", name) for name in self.names[3:]}
        size = {name: float(rng.uniform(low, high)) for name, (low, high) in ranges.items()}
        size |= {name: float(value) for name, value in given.items() if name in size}
        percent = [float(given.get(name, each)) for name, each in zip(self.names[1:3], shrinks, strict=True)]
        parts = [Sized("shrinkage", axis, (), np.array([each])) for axis, each in enumerate(percent)]
        parts.append(Sized("bead", 0, (), np.array([size["outline_mm"]])))
        return Made(tuple(parts), beads=Beads(size["hole_mm"] - size["outline_mm"], size["corner_mm"], size["foot_mm"]))


EVENTS: dict[str, Event] = {"homing": Homed(), "refit": Refit(), "filament": Filament()}
