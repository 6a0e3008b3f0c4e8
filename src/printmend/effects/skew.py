"""Axes that are not square (physics.md eq. 14)."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import Acts, Of, Places, SCALE_MM, Scene, Term, along
from printmend.effects.prior import alternatives


class Skew:
    """A lean of one bed axis against the other, in mm per 100 mm: of Y (0), or of X (1)."""

    name = "skew"
    of = Of.MACHINE
    acts = Acts.FRAME
    from_home = True
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        for axis in range(2):
            yield from alternatives(self.name, axis, [()], (1.0,))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        other = (places.bed_mm[:, 1 - where] - scene.middle_mm[1 - where]) / SCALE_MM
        return along(where, other[:, None])

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return sizes
