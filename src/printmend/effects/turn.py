"""A plate that lay turned: everything turns about the middle of the bed."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import Acts, Of, Places, SCALE_MM, Scene, Term
from printmend.effects.prior import alternatives

ALWAYS = 0.999  # nobody knows how a sheet lay on a scanner


class Turn:
    """A turn, in mm per 100 mm."""

    name = "turn"
    of = Of.INSTRUMENT
    acts = Acts.NOT
    from_home = True
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        yield from alternatives(self.name, 0, [()], (1.0,), share=None if scene.placed else ALWAYS)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        x, y = ((places.bed_mm - scene.middle_mm) / SCALE_MM).T
        return np.stack([-y, x], axis=1)[:, :, None]

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return np.zeros_like(sizes)
