"""A dent or a missing tooth of the belt: the carriage is ahead or behind near one place, and nowhere else."""

import numpy as np

from printmend.effects.effect import Places, Scene, Shapes, onto_bed
from printmend.effects.prior import apart_of, numbers_of
from printmend.effects.splice import AtOnePlace


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
        return [(float(at), width) for width in widths for at in np.arange(low, high, 2 * width)]

    def spacing(self, where: int, shape: tuple[float, ...], scene: Scene) -> tuple[float, ...]:
        _, width = shape
        return 2 * width, apart_of(self.name, "widths", width)  # bells that meet where they are steepest

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        at, width = shape
        bell = np.exp(-0.5 * ((places.motor_mm[:, [where]] - at) / width) ** 2)
        return onto_bed(scene, where, bell)
