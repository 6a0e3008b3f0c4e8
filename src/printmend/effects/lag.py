"""A head with play in its guides: it lags within that play, whichever motor turns."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Places, Scene, Usual, along
from printmend.effects.words import Found, Told
from printmend.messages import say


class Lag(Usual):
    """Play of one bed axis of a CoreXY; on other printers it is the belt's."""

    name = "lag"
    positive = True

    def carriers(self, scene: Scene) -> range:
        return range(2 * scene.corexy)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return along(where, -0.5 * places.ways[:, [where]])

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        words = say("head-lags-along-mm-whichever-motor", "XY"[found.where], f"{abs(found.sizes_mm[0]):.2f}")
        yield Told("rail-play", words)
