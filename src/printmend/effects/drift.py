"""A belt, or on a CoreXY an axis, that shifts evenly while it prints."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Of, Places, Scene, Usual, carrier
from printmend.effects.prior import fate_of
from printmend.effects.words import Found, Told, carrier_name
from printmend.messages import say


class Drift(Usual):
    """A shift that grows with the length printed."""

    name = "drift"
    at_motors = True
    of = Of.SESSION
    fate = fate_of(name)

    def carriers(self, scene: Scene) -> range:
        return range(4 if scene.corexy else 2)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        course = places.done
        return carrier(scene, where, course[:, None])

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        words = say(
            "drifted-evenly-during-print-mm-first", carrier_name(scene, found.where), f"{found.sizes_mm[0]:+.2f}"
        )
        yield Told("linear", words)
