"""One axis of a CoreXY's bed that is stretched: both motors turn for it, so that no pulley explains it."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import Acts, Of, Places, SCALE_MM, Scene, Term, along
from printmend.effects.prior import alternatives


class Aspect:
    """An error that grows evenly along one bed axis, in mm per 100 mm; on other printers it is the motor's."""

    name = "aspect"
    of = Of.MACHINE
    acts = Acts.FRAME
    from_home = True
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        for axis in range(2 * scene.corexy):
            yield from alternatives(self.name, axis, [()], (1.0,))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        own = (places.bed_mm[:, where] - scene.middle_mm[where]) / SCALE_MM
        return along(where, own[:, None])

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return sizes
