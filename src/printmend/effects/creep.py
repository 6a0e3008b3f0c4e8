"""A shift that slows down, as when a set screw gives way or a clamp settles."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Of, Places, Scene, Shapes, Usual, carrier
from printmend.effects.prior import apart_of, fate_of, numbers_of
from printmend.effects.words import Found, Numbers, Told, carrier_name
from printmend.messages import say


class Creep(Usual):
    """A shift that comes with one time constant, a share of the print."""

    name = "creep"
    at_motors = True
    of = Of.SESSION
    fate = fate_of(name)
    keys = Numbers(shape=("after_share",))

    def carriers(self, scene: Scene) -> range:
        return range(4 if scene.corexy else 2)

    def shapes(self, where: int, scene: Scene) -> Shapes:
        return [(each,) for each in numbers_of(self.name, "times")]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        course = 1.0 - np.exp(-places.done / shape[0])
        return carrier(scene, where, course[:, None])

    def spacing(self, where: int, shape: tuple[float, ...], scene: Scene) -> tuple[float, ...]:
        return (apart_of(self.name, "times", shape[0]),)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        crept_mm = found.sizes_mm[0] * (1.0 - np.exp(-1.0 / found.shape[0]))  # a slow one has not settled yet
        soon = f"{100 * found.shape[0]:.0f}"
        words = say("crept-mm-most-first-print-something", carrier_name(scene, found.where), f"{crept_mm:+.2f}", soon)
        yield Told("creep", words)
