"""A gantry that lags on one side, or one of two motors that is loose."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import Acts, Of, Places, SCALE_MM, Scene, Term, along
from printmend.effects.prior import alternatives


class Racking:
    """Play of one bed axis that changes along the other, in mm per 100 mm."""

    name = "racking"
    of = Of.MACHINE
    acts = Acts.NOT
    from_home = True
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        for axis in range(2):
            yield from alternatives(self.name, axis, [()], (1.0, 1.0))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        other = (places.bed_mm[:, 1 - where] - scene.middle_mm[1 - where]) / SCALE_MM
        lag = 0.5 * places.ways[:, where] * other
        return np.concatenate([along(where, lag[:, None]), along(1 - where, lag[:, None])], axis=2)

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return sizes
