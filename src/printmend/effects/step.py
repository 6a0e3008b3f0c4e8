"""A motor that slipped or a plate that was pushed: a constant offset from one moment on."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Fate, Of, Places, Scene, Term, Usual, about, carrier
from printmend.effects.prior import alternatives
from printmend.effects.words import Found, Numbers, Told, carrier_name
from printmend.messages import say

APART = 0.02  # of a print: distance of the moments that are tried
BREAKS = np.arange(0.04, 0.97, APART)


def breaks(scene: Scene) -> list[float]:
    """Return the moments that are tried: before the first mark, a shift would be one of the place."""
    return [float(each) for each in BREAKS if each > scene.unseen_share]


class Step(Usual):
    """A shift at one moment, a share of the print."""

    name = "step"
    of = Of.SESSION
    fate = Fate(anew=0.1, stays=0.4)
    most = 2
    keys = Numbers(shape=("at_share",))

    def terms(self, scene: Scene) -> Iterator[Term]:
        for where in range(4 if scene.corexy else 2):
            yield from alternatives(self.name, where, [(each,) for each in breaks(scene)], (1.0,))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        course = (places.done > shape[0]) * 1.0
        return carrier(scene, where, course[:, None])

    def finer(self, where: int, shape: tuple[float, ...], round_: int, scene: Scene) -> Iterator[tuple[float, ...]]:
        yield from ((float(each),) for each in about(shape[0], APART, round_) if each > scene.unseen_share)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        size, done = f"{found.sizes_mm[0]:+.2f}", f"{100 * found.shape[0]:.0f}"
        yield Told("step", say("suddenly-off-mm-after-print", carrier_name(scene, found.where), size, done))
