"""More play in one part of the bed than in the other."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import STEPS, Places, Scene, Shapes, Usual, onto_bed, steps
from printmend.effects.words import Found, Numbers, Told, carrier_name, span_mm
from printmend.messages import say


class UnevenPlay(Usual):
    """Play of one motor past a border along a bed axis that another motor moves; along its own way, play changes as
    `Rub` and `Friction` have it."""

    name = "uneven_play"
    at_motors = True
    keys = Numbers(shape=("axis", "at_mm"))

    def shapes(self, where: int, scene: Scene) -> Shapes:
        axes = (0, 1) if scene.corexy else (1 - where,)
        return [(float(axis), at) for axis in axes for at in steps(*scene.bed_span_mm[axis])]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        axis, at = shape
        more = 0.5 * places.side[:, where] * (places.bed_mm[:, int(axis)] > at)
        return onto_bed(scene, where, more[:, None])

    def spacing(self, where: int, shape: tuple[float, ...], scene: Scene) -> tuple[float, ...]:
        return 0.0, span_mm(scene, int(shape[0])) / STEPS

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        carrier, axis = carrier_name(scene, found.where), "XY"[int(found.shape[0])]
        size = float(found.sizes_mm[0])
        message = "mm-more-play-upper-part-model" if size > 0 else "mm-less-play-upper-part-model"
        words = say(message, carrier, f"{abs(size):.2f}", axis)
        yield Told("halves-play", words)
