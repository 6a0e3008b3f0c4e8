"""A guide in two pieces: past the joint, everything is pushed aside."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import STEPS, Places, Scene, Shapes, Usual, along, steps
from printmend.effects.prior import number_of
from printmend.effects.words import Found, Numbers, Told, span_mm
from printmend.messages import say


class Joint(Usual):
    """A step along one bed axis, across it, over a width. No polynomial and no wave of a frame is as sharp."""

    name = "joint"
    keys = Numbers(shape=("at_mm", "width_mm"))

    def shapes(self, where: int, scene: Scene) -> Shapes:
        width = number_of(self.name, "width")  # others are looked for about it
        return [(at, width) for at in steps(*scene.bed_span_mm[where])]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        at, width = shape
        return along(1 - where, np.clip((places.bed_mm[:, [where]] - at) / width + 0.5, 0.0, 1.0))

    def spacing(self, where: int, shape: tuple[float, ...], scene: Scene) -> tuple[float, ...]:
        return span_mm(scene, where) / STEPS, shape[1]

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        where = "XY"[found.where], f"{found.shape[0]:.0f}", "XY"[1 - found.where]
        yield Told("joint", say("off-mm-beyond-guide-two-pieces", *where, f"{found.sizes_mm[0]:+.2f}"))
