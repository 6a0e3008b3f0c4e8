"""Two sheets that were measured as one: one part of the bed is off against the other."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import Acts, Of, about, Places, Scene, Term, along
from printmend.effects.prior import alternatives

BORDERS = 25  # places of a border that are tried


class Halves:
    """A shift past a border along one bed axis."""

    name = "halves"
    of = Of.INSTRUMENT
    acts = Acts.NOT
    from_home = True
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        for axis in range(2):
            yield from alternatives(self.name, axis, [(float(at),) for at in borders_mm(scene, axis)], (1.0, 1.0))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        past = (places.bed_mm[:, where] > shape[0])[:, None] * 1.0
        return np.concatenate([along(0, past), along(1, past)], axis=2)

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        for at in about(shape[0], 8.0, round_):
            yield (float(at),)

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return np.zeros_like(sizes)


def borders_mm(scene: Scene, axis: int) -> np.ndarray:
    """Return the borders between two parts of the bed that are tried along an axis."""
    low, high = scene.bed_span_mm[axis]
    return np.linspace(low, high, BORDERS + 2)[2:-2]
