"""A head or gantry that tilts: the place of one axis depends on the direction from which the other one came."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import STAYS, Acts, Of, Places, Scene, Term, Usual, along
from printmend.effects.prior import alternatives
from printmend.effects.words import Found, Told
from printmend.messages import say


class Tilt(Usual):
    """A shift across one bed axis with its way."""

    name = "tilt"
    cause = say("cause-tilt")  # of an expected error
    of = Of.MACHINE
    acts = Acts.NOT
    fate = STAYS

    def terms(self, scene: Scene) -> Iterator[Term]:
        for axis in range(2):
            yield from alternatives(self.name, axis, [()], (1.0,))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return along(1 - where, 0.5 * places.ways[:, [where]])

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        size = f"{abs(found.sizes_mm[0]):.2f}"
        words = say("where-comes-lie-depends-way-moved-2", "XY"[1 - found.where], "XY"[found.where], size)
        yield Told("direction", words)
