"""A motor that slipped or a plate that was pushed: a constant offset from one moment on."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import STEPS, Of, Places, Scene, Shapes, Usual, carrier, steps
from printmend.effects.prior import fate_of
from printmend.effects.words import Found, Numbers, Told, carrier_name
from printmend.messages import say


class AtOneMoment(Usual):
    """A shift at one moment, a share of the print: before the first mark, it would be one of the place."""

    of = Of.SESSION
    keys = Numbers(shape=("at_share",))

    def shapes(self, where: int, scene: Scene) -> Shapes:
        return [(each,) for each in steps(0.0, 1.0)]

    def spacing(self, where: int, shape: tuple[float, ...], scene: Scene) -> tuple[float, ...]:
        return (1 / STEPS,)

    def is_possible(self, where: int, shape: tuple[float, ...], scene: Scene) -> bool:
        return shape[0] > scene.unseen_share


class Step(AtOneMoment):
    """A shift of one belt, or on a CoreXY of an axis."""

    name = "step"
    at_motors = True
    fate = fate_of(name)
    most = 2

    def carriers(self, scene: Scene) -> range:
        return range(4 if scene.corexy else 2)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return carrier(scene, where, (places.done > shape[0])[:, None] * 1.0)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        size, done = f"{found.sizes_mm[0]:+.2f}", f"{100 * found.shape[0]:.0f}"
        yield Told("step", say("suddenly-off-mm-after-print", carrier_name(scene, found.where), size, done))
