"""A machine that grows as it warms up, and is cold again when a print begins."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import Acts, Of, about, Places, SCALE_MM, Scene, Term, along
from printmend.effects.prior import alternatives

TIMES = (0.1, 0.25, 0.7)  # shares of the print


class Warmth:
    """Growth from the middle of the bed along both axes, and shifts of both, with one time constant."""

    name = "warmth"
    of = Of.SESSION
    acts = Acts.NOT
    from_home = True
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        yield from alternatives(self.name, 0, [(each,) for each in TIMES], (1.0, 1.0, 1.0, 1.0))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        grown = (1.0 - np.exp(-places.done / shape[0]))[:, None]
        x, y = ((places.bed_mm - scene.middle_mm) / SCALE_MM).T
        grows = [along(0, x[:, None] * grown), along(1, y[:, None] * grown)]
        return np.concatenate([*grows, along(0, grown), along(1, grown)], axis=2)

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        for factor in about(0.0, 0.9, round_):
            yield (float(shape[0] * np.exp(factor)),)

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return sizes
