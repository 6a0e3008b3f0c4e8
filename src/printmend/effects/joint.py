"""A guide in two pieces: past their joint everything is pushed aside."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Places, Scene, Shapes, Usual, about, about_factor, along
from printmend.effects.halves import APART_MM, borders_mm
from printmend.effects.prior import number_of
from printmend.effects.words import Found, Numbers, Told
from printmend.messages import say

WIDTHS_APART = 1.4  # of the logarithms of two widths


class Joint(Usual):
    """A step along one bed axis, across it, over a width. No polynomial and no wave of a frame is as sharp."""

    name = "joint"
    keys = Numbers(shape=("at_mm", "width_mm"))

    def shapes(self, where: int, scene: Scene) -> Shapes:
        width = number_of(self.name, "width")  # others are looked for about it
        return [(float(at), width) for at in borders_mm(scene, where)]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        at, width = shape
        return along(1 - where, np.clip((places.bed_mm[:, [where]] - at) / width + 0.5, 0.0, 1.0))

    def finer(self, where: int, shape: tuple[float, ...], round_: int, scene: Scene) -> Iterator[tuple[float, ...]]:
        at, width = shape
        yield from ((place, width) for place in about(at, APART_MM, round_))
        yield from ((at, wider) for wider in about_factor(width, WIDTHS_APART, round_))

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        where = "XY"[found.where], f"{found.shape[0]:.0f}", "XY"[1 - found.where]
        yield Told("joint", say("off-mm-beyond-guide-two-pieces", *where, f"{found.sizes_mm[0]:+.2f}"))
