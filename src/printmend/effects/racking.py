"""A gantry that lags on one side, or one of two motors that is loose."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import SCALE_MM, STAYS, Acts, Of, Places, Scene, Term, along
from printmend.effects.prior import alternatives
from printmend.effects.words import Found, Message, Told, span_mm

ACROSS_SHARE = 2.0  # a gantry racks across where that error is so many times the one along
RACKS = Message(
    "the play of {a} changes by {b} mm from one end of {c} to the other: the gantry racks, or one of two motors is "
    "loose"
)
ACROSS = Message(
    "where {a} comes to lie depends on which way {b} moved before, the more the nearer to its ends, by up to {c} "
    "mm: the gantry racks"
)


class Racking:
    """Play of one bed axis that changes along the other, in mm per 100 mm."""

    name = "racking"
    of = Of.MACHINE
    acts = Acts.NOT
    from_home = True
    fate = STAYS
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        for axis in range(2):
            yield from alternatives(self.name, axis, [()], (1.0, 1.0))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        other = (places.bed_mm[:, 1 - where] - scene.middle_mm[1 - where]) / SCALE_MM
        lag = 0.5 * places.ways[:, where] * other
        return np.concatenate([along(where, lag[:, None]), along(1 - where, lag[:, None])], axis=2)

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        along_mm, across_mm = found.sizes_mm * span_mm(scene, 1 - found.where) / SCALE_MM
        mine, other = "XY"[found.where], "XY"[1 - found.where]
        if abs(across_mm) > ACROSS_SHARE * abs(along_mm):
            yield Told("racking-across", ACROSS(other, mine, f"{abs(across_mm) / 2:.2f}"))
        else:
            yield Told("racking", RACKS(mine, f"{along_mm:+.2f}", other))
