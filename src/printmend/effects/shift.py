"""A plate that was shifted, or a nozzle with an offset: the whole print is displaced from home."""

from collections.abc import Iterator

from printmend.effects.effect import FAR_MM, Scene, Term
from printmend.effects.origin import Origin
from printmend.effects.prior import alternatives


class Shift(Origin):
    """A shift of everything that was measured."""

    name = "shift"

    def terms(self, scene: Scene) -> Iterator[Term]:
        if scene.placed:
            yield from alternatives(self.name, 0, [()], (1.0, 1.0), (FAR_MM, FAR_MM))
