"""A measurement with an origin of its own, as a sheet on a scanner has."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import ALWAYS, FAR_MM, GONE, Of, Places, Scene, Term, Usual, along_both
from printmend.effects.words import Numbers


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
        return along_both(np.ones((len(places), 1)))
