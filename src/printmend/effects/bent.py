"""Guides that are not straight: low-order terms of the place on the bed (physics.md eq. 14)."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Places, Profiles, Scene, Usual, along_both
from printmend.effects.prior import number_of, profile_of
from printmend.effects.words import AXES, Care, Fault, Found, Numbers, where_seen
from printmend.machine import Frame
from printmend.messages import say

POWERS = Frame.exponents[3:]  # of x and of y: those of second and third order


class Bent(Usual):
    """Second- and third-order terms of both places, for x and for y."""

    name = "bent"
    kinds = ("bow",)
    acts = Acts.FRAME
    keys = Numbers(tuple(f"{axis}_{'x' * p + 'y' * q}_mm" for axis in AXES for p, q in POWERS))

    def carriers(self, scene: Scene) -> range:
        return range(1)

    def profiles(self, where: int, scene: Scene) -> Profiles:
        """Return profiles of the terms' sizes: of all alike, or mostly of what one guide pushes across itself."""
        every = np.tile(profile_of(self.name), 2)
        across = np.ravel(np.transpose(POWERS) == 0)  # X as it depends on Y alone, and Y on X
        return [every, every * np.where(across, 1.0, number_of(self.name, "beside"))]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return along_both(_products(scene.off_middle(places.bed_mm)))

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        corners = np.stack(np.meshgrid(*scene.bed_span_mm), axis=-1).reshape(-1, 2)
        terms = _products(scene.off_middle(corners))
        size, sd = found.size(lambda sizes: float(np.hypot(*(sizes.reshape(2, -1) @ terms.T)).max()))
        yield Fault("frame", "bow", size, sd, "mm", say("fault-bent", f"{size:.2f}"))

    def advice(self, fault: Fault, where: str) -> Care:
        """Return how far straight lines bow, and which part may be bent."""
        repair = where_seen(fault.size, say("look-along-rods-rails-replace-bent"))
        return Care(say("guides-bent"), say("straight-lines-bow-up-mm-bed", fault.shown), fault.size, repair)


def _products(off_middle: np.ndarray) -> np.ndarray:
    """Return xᵖ yᵠ [N, 7] of places [N, 2] for each of `POWERS`."""
    x, y = off_middle.T
    return np.stack([x**p * y**q for p, q in POWERS], axis=1)
