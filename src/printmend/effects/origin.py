"""A measurement whose places have an origin of their own, as a sheet on a scanner has."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import GONE, Acts, Of, Places, Scene, Term, along
from printmend.effects.keys import Numbers

FAR_MM = 30.0  # how far off an origin may be; the trace's was put near the bed's beforehand
ALWAYS = 1e3  # logarithm of its odds: no sheet lies exactly where the bed does, though it may look so


class Origin:
    """A shift of everything, of any size."""

    name = "origin"
    of = Of.INSTRUMENT
    acts = Acts.NOT
    from_home = True
    fate = GONE
    most = 1
    keys = Numbers(("x_mm", "y_mm"))

    def terms(self, scene: Scene) -> Iterator[Term]:
        if not scene.placed:
            yield Term(self.name, 0, (), (FAR_MM, FAR_MM), ALWAYS)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        one = np.ones((len(places), 1))
        return np.concatenate([along(0, one), along(1, one)], axis=2)

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())
