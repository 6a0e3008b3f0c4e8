"""A measurement with an origin of its own, as a sheet on a scanner has."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import ALWAYS, GONE, Of, Places, Scene, Term, Usual, along
from printmend.effects.words import Numbers

FAR_MM = 30.0  # how far off an origin may be; the trace's was put near the bed's beforehand


class Origin(Usual):
    """A shift of everything, of any size."""

    name = "origin"
    of = Of.INSTRUMENT
    fate = GONE
    keys = Numbers(("x_mm", "y_mm"))

    def terms(self, scene: Scene) -> Iterator[Term]:
        if not scene.placed:
            # even a sheet that looks aligned has an origin of its own
            yield Term(self.name, 0, (), (FAR_MM, FAR_MM), ALWAYS)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        one = np.ones((len(places), 1))
        return np.concatenate([along(0, one), along(1, one)], axis=2)
