"""Axes that are not square (physics.md eq. 14)."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import SCALE_MM, Acts, Places, Scene, Usual, along
from printmend.effects.words import Care, Fault, Found, Numbers, amount, is_first, those_of, where_seen
from printmend.messages import say


class Skew(Usual):
    """A lean of one bed axis against the other, in mm per 100 mm: of Y (0), or of X (1)."""

    name = "skew"
    acts = Acts.FRAME
    keys = Numbers(("angle_deg",))

    def carriers(self, scene: Scene) -> range:
        # without a place the leaning axis is unknown: the alternative is the same shape, turned
        return range(2 if scene.placed else 1)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return along(where, scene.off_middle(places.bed_mm)[:, [1 - where]])

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        """Report the skew of the printed axes. No measurement shows how much of it is the frame's, and how much comes
        from unequal belts of a CoreXY."""
        if is_first(found, (self.name,), beside):
            of_scale = leans_of_scales(scene)
            leans = [(each, 1.0) for each in those_of(self.name, beside, acts=False)]
            leans += [(each, of_scale[each.where]) for each in those_of("scale", beside, acts=False)]
            acting = (factor * each.sizes_mm[0] for each, factor in leans if each.acts)
            value = float(np.degrees(sum(np.arctan(size_mm / SCALE_MM) for size_mm in acting)))
            drawn = np.sum([factor * each.draws_mm[0] for each, factor in leans], axis=0)
            sd = float(np.degrees(np.std(drawn[drawn != 0])) / SCALE_MM)
            yield Fault("frame", "skew", value, sd, "°", say("fault-skew", amount(value, sd, "°")))

    def advice(self, fault: Fault, where: str) -> Care:
        """Return how far right angles come out off, and whether the frame needs squaring."""
        leans_mm = SCALE_MM * math.tan(math.radians(fault.size))
        meaning = say("right-angles-come-out-off-mm", fault.shown, f"{leans_mm:.2f}")
        repair = where_seen(leans_mm, say("loosen-frame-square-tighten"), say("nothing-repair"))
        carries = say("firmware-can-hold-printmend-export-printmend")
        return Care(say("frame-not-square"), meaning, leans_mm, repair, carries)


def leans_of_scales(scene: Scene) -> np.ndarray:
    """Return by how much axes lean for a scale of each motor [2]: 0 where each motor has an axis of its own."""
    belt, motor = scene.printer.from_motor(np.eye(2)), scene.printer.to_motor(np.eye(2))
    return np.asarray(np.sum(belt * motor[::-1].T, axis=1))
