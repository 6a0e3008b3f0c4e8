"""Lines that are wider or narrower than set: every wall stands out by the same amount."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import Acts, Of, Places, Scene, Term
from printmend.effects.prior import size_mm


class Bead:
    """A shift along the normal of every wall."""

    name = "bead"
    of = Of.MATERIAL
    acts = Acts.NOT
    from_home = True
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        if scene.walls:
            yield Term(self.name, 0, (), (size_mm(self.name),), 7.0)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return np.asarray(places.normal[:, :, None])

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return sizes
