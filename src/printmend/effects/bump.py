"""A dent or a missing tooth of the belt: the carriage is ahead or behind near one place, and nowhere else."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import Places, Scene, Shapes, about, about_factor, onto_bed
from printmend.effects.prior import numbers_of
from printmend.effects.splice import AtOnePlace

SPACING = 2.0  # distance of the places that are tried, in widths
WIDTHS_APART = 0.7  # of the logarithms of two widths


class Bump(AtOnePlace):
    """A bell about one place of one belt."""

    name = "bump"
    most = 2
    words = "fault-bump"
    title = "belt-dent-missing-tooth"
    meaning = "lines-bulge-at-one-place"
    replace = "look-for-dent-missing-tooth"

    def shapes(self, where: int, scene: Scene) -> Shapes:
        low, high = scene.motor_span_mm[where]
        widths = numbers_of(self.name, "widths")
        return [(float(at), width) for width in widths for at in np.arange(low, high, SPACING * width)]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        at, width = shape
        bell = np.exp(-0.5 * ((places.motor_mm[:, [where]] - at) / width) ** 2)
        return onto_bed(scene, where, bell)

    def finer(self, where: int, shape: tuple[float, ...], round_: int, scene: Scene) -> Iterator[tuple[float, ...]]:
        at, width = shape
        for place in about(at, SPACING * width, round_):
            yield place, width
        for wider in about_factor(width, WIDTHS_APART, round_):
            yield at, wider
