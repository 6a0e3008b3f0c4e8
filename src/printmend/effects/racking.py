"""A gantry that lags on one side, or one of two motors that is loose."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import SCALE_MM, Places, Scene, Usual, along, onto_bed
from printmend.effects.words import Found, Numbers, Told, span_mm
from printmend.messages import say


class Racking(Usual):
    """Play that changes along the other axis, in mm per 100 mm: of a belt (0, 1), or of a CoreXY's bed axis (2, 3)."""

    name = "racking"
    at_motors = True
    keys = Numbers(("size_mm", "across_mm"))

    def carriers(self, scene: Scene) -> range:
        return range(4 if scene.corexy else 2)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        axis = where % 2
        if where < 2:  # the middle is that of the other motor's way, on most printers of the other axis
            other = scene.motor_off_middle(1 - axis, places.motor_mm[:, 1 - axis])
            lag = onto_bed(scene, axis, (0.5 * places.side[:, axis] * other)[:, None])
        else:
            other = scene.off_middle(places.bed_mm)[:, 1 - axis]
            lag = along(axis, (0.5 * places.ways[:, axis] * other)[:, None])
        across = along(1 - axis, (0.5 * places.ways[:, axis] * other)[:, None])
        return np.concatenate([lag, across], axis=2)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        axis = found.where % 2
        along_mm, across_mm = found.sizes_mm * span_mm(scene, 1 - axis) / SCALE_MM
        names = "AB" if scene.corexy and found.where < 2 else "XY"
        mine, other = names[axis], names[1 - axis]
        if abs(across_mm) > abs(along_mm):
            words = say("where-comes-lie-depends-way-moved", other, mine, f"{abs(across_mm) / 2:.2f}")
            yield Told("racking-across", words)
        else:
            yield Told("racking", say("play-changes-mm-end-other-gantry", mine, f"{along_mm:+.2f}", other))
