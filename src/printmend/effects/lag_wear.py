"""Play of a head in its guides that grows during the print."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Of, Places, Scene
from printmend.effects.lag import Lag
from printmend.effects.words import Found, Told
from printmend.messages import say


class LagWear(Lag):
    """Play of one bed axis of a CoreXY that grows with the length printed; on other printers it is the belt's."""

    name = "lag_wear"
    of = Of.SESSION  # that stays, as `Wear`

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return super().columns(places, where, shape, scene) * places.done[:, None, None]

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        yield Told("wear", say("play-head-along-grew-mm-while", "XY"[found.where], f"{found.sizes_mm[0]:.2f}"))
