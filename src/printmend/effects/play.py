"""A belt, shaft or head that stays behind when its motor turns round (physics.md eq. 7)."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import Acts, Of, Places, Scene, Term, onto_bed
from printmend.effects.prior import alternatives


class Play:
    """Play that is the same everywhere."""

    name = "play"
    of = Of.MACHINE
    acts = Acts.DRIVE
    from_home = True
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            yield from alternatives(self.name, motor, [()], (1.0,))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, 0.5 * places.side[:, [where]])

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return sizes
