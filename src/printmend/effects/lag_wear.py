"""Play of a head in its guides that grows while it prints."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Of, Places, Scene, Term, Usual, along
from printmend.effects.prior import alternatives
from printmend.effects.words import Found, Told
from printmend.messages import say


class LagWear(Usual):
    """Play of one bed axis of a CoreXY that grows with the length printed; on other printers it is the belt's."""

    name = "lag_wear"
    of = Of.SESSION  # that stays, as `Wear`

    def terms(self, scene: Scene) -> Iterator[Term]:
        for axis in range(2 * scene.corexy):
            yield from alternatives(self.name, axis, [()], (1.0,), positive=True)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return along(where, (-0.5 * places.ways[:, where] * places.done)[:, None])

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        yield Told("wear", say("play-head-along-grew-mm-while", "XY"[found.where], f"{found.sizes_mm[0]:.2f}"))
