"""A guide in two pieces: past their joint everything is pushed aside."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Places, Scene, Term, Usual, about, along
from printmend.effects.halves import APART_MM, borders_mm
from printmend.effects.prior import alternatives
from printmend.effects.words import Found, Numbers, Told
from printmend.messages import say


class Joint(Usual):
    """A step along one bed axis, across it. No polynomial and no wave of a frame is as sharp."""

    name = "joint"
    keys = Numbers(shape=("at_mm",))

    def terms(self, scene: Scene) -> Iterator[Term]:
        for axis in range(2):
            yield from alternatives(self.name, axis, [(float(at),) for at in borders_mm(scene, axis)])

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return along(1 - where, (places.bed_mm[:, [where]] > shape[0]) * 1.0)

    def finer(self, where: int, shape: tuple[float, ...], round_: int, scene: Scene) -> Iterator[tuple[float, ...]]:
        yield from ((at,) for at in about(shape[0], APART_MM, round_))

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        (at,), (step_mm,) = found.shape, found.sizes_mm
        where = "XY"[found.where], f"{at:.0f}", "XY"[1 - found.where]
        yield Told("joint", say("off-mm-beyond-guide-two-pieces", *where, f"{step_mm:+.2f}"))
