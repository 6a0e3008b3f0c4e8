"""A head or bed that tilts in its guides: the position of one axis depends on the direction of the other, by a
constant, or in proportion to the distance from a point."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import SCALE_MM, Places, Scene, Usual, along
from printmend.effects.words import Found, Numbers, Told, span_mm
from printmend.messages import say


class Tilt(Usual):
    """A shift across one bed axis with its way, and how it grows along that axis, in mm per 100 mm."""

    name = "tilt"
    keys = Numbers(("size_mm", "grow_mm"))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        place = scene.off_middle(places.bed_mm)[:, where]
        return along(1 - where, 0.5 * places.ways[:, [where]] * np.stack([np.ones(len(place)), place], axis=1))

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        ends = found.sizes_mm[0] + found.sizes_mm[1] * span_mm(scene, found.where) / SCALE_MM * np.array([-0.5, 0.5])
        size = f"{np.abs(ends).max():.2f}"
        words = say("where-comes-lie-depends-way-moved-2", "XY"[1 - found.where], "XY"[found.where], size)
        yield Told("direction", words)
