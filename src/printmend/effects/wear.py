"""Play that grows while it prints, as where something comes loose."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import Acts, Of, Places, Scene, Term, onto_bed
from printmend.effects.prior import alternatives


class Wear:
    """Play of one motor that grows with the length printed."""

    name = "wear"
    of = Of.SESSION
    acts = Acts.NOT
    from_home = True
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            yield from alternatives(self.name, motor, [()], (1.0,))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, (0.5 * places.side[:, where] * places.done)[:, None])

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return sizes
