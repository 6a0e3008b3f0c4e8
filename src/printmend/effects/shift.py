"""A plate that was shifted, or a nozzle with an offset: the whole print is displaced from home."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import FAR_MM, GONE, Of, Places, Scene, Term, Usual, along_both
from printmend.effects.prior import alternatives
from printmend.effects.words import Found, Numbers, Told
from printmend.messages import say


class Shift(Usual):
    """A shift of everything that was measured."""

    name = "shift"
    of = Of.INSTRUMENT
    fate = GONE
    keys = Numbers(("x_mm", "y_mm"))

    def terms(self, scene: Scene) -> Iterator[Term]:
        if scene.placed:
            yield from alternatives(self.name, 0, [()], (1.0, 1.0), (FAR_MM, FAR_MM))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return along_both(np.ones((len(places), 1)))

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        words = say("everything-lies-mm-where-home-says", *(f"{each:+.2f}" for each in found.sizes_mm))
        yield Told("moved", words, is_harmless=True)
