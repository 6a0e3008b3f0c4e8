"""The unknowns of an instrument: its scale, the difference of its axes' scales, and their skew."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from printmend.effects.effect import ALWAYS, GONE, Effect, Of, Places, Scene, Term, Usual
from printmend.effects.words import Given

if TYPE_CHECKING:
    from printmend.effects.sized import Sized


@dataclass(frozen=True)
class Percents:
    """The picture's scale, half the difference of its axes' scales, and half their lean, in mm per 100 mm."""

    names = ("scale_percent", "axes_percent", "lean_percent")

    def filled(self, given: Given, drawn: "Sized", effect: Effect, scene: Scene) -> "Sized":
        if not given:
            return drawn
        one = basis(scene)
        shares = np.array([float(given.get(name, 0.0)) / 100.0 for name in self.names])
        return drawn.of(sizes_mm=np.linalg.solve(one, shares))


class Stretch(Usual):
    """A linear error of the picture, as uncertain as the instrument says."""

    name = "stretch"
    of = Of.INSTRUMENT
    fate = GONE
    keys = Percents()

    def terms(self, scene: Scene) -> Iterator[Term]:
        if scene.instrument.covariance.any():
            # every instrument has an error, even if its picture looks exact
            yield Term(self.name, 0, (), (1.0, 1.0, 1.0), ALWAYS)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        x, y = (places.bed_mm - scene.middle_mm).T
        scale, half, lean = np.stack([x, y], axis=1), np.stack([x, -y], axis=1), np.stack([y, x], axis=1)
        return np.stack([scale, half, lean], axis=2) @ basis(scene)


def basis(scene: Scene) -> np.ndarray:
    """Return what one unit of each size is [3, 3]: a scale, a difference of the axes' scales, a lean."""
    values, axes = np.linalg.eigh(scene.instrument.covariance)
    return np.asarray(axes * np.sqrt(np.maximum(values, 0.0)))
