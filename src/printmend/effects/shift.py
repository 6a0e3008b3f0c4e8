"""A plate that was shifted, or a nozzle with an offset: the whole print is displaced from home."""

from collections.abc import Iterator, Sequence

from printmend.effects.effect import FAR_MM, Scene, Term
from printmend.effects.origin import Origin
from printmend.effects.prior import alternatives
from printmend.effects.words import Found, Told
from printmend.messages import say


class Shift(Origin):
    """A shift of everything that was measured."""

    name = "shift"

    def terms(self, scene: Scene) -> Iterator[Term]:
        if scene.placed:
            yield from alternatives(self.name, 0, [()], (1.0, 1.0), (FAR_MM, FAR_MM))

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        words = say("everything-lies-mm-where-home-says", *(f"{each:+.2f}" for each in found.sizes_mm))
        yield Told("moved", words, is_harmless=True)
