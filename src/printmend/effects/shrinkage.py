"""A part that shrank as it cooled: by different shares along X and Y, in every print in this filament."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import ALWAYS, SCALE_MM, Of, Places, Scene, Term, Usual, along
from printmend.effects.words import Numbers


class Shrinkage(Usual):
    """A part that is smaller than it was printed, in mm per 100 mm along a bed axis (0 or 1).

    In a measurement it is the remainder after the polymer's mean shrinkage. It looks exactly like the scale of the
    machine; `filament.ledger` separates the two.
    """

    name = "shrinkage"
    keys = Numbers(("percent",))
    of = Of.MATERIAL
    from_home = False

    def terms(self, scene: Scene) -> Iterator[Term]:
        if scene.shrinkage_sd is not None:  # every plastic shrinks
            for axis in range(2):
                yield Term(self.name, axis, (), (scene.shrinkage_sd * SCALE_MM,), ALWAYS)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return along(where, -scene.off_middle(places.bed_mm)[:, [where]])
