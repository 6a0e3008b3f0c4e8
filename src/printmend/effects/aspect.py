"""Unequal axes of a CoreXY's bed. Both motors turn for each axis, so no pulley explains it."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Places, Scene, Usual
from printmend.effects.words import Care, Fault, Found, Numbers, amount, where_seen
from printmend.messages import say

SHARES = np.array([0.5, -0.5])  # of it that X and Y have


class Aspect(Usual):
    """X that is longer than Y, in mm per 100 mm, half of it on either side; on other printers it is the motors'.

    The common part of both axes is the scale of both motors, which keeps the two effects apart.
    """

    name = "aspect"
    kinds = ("axes",)
    acts = Acts.FRAME
    keys = Numbers(("percent",))

    def carriers(self, scene: Scene) -> range:
        return range(scene.corexy)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return (scene.off_middle(places.bed_mm) * SHARES)[:, :, None]

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        percent, sd = found.size()  # mm in 100 mm
        words = say("x-larger-than-y" if percent > 0 else "x-smaller-than-y", amount(abs(percent), sd, "%"))
        yield Fault("frame", "axes", percent, sd, "%", words)

    def advice(self, fault: Fault, where: str) -> Care:
        """Return how far squares come out as rectangles, and where to look."""
        title = say("x-prints-larger" if fault.value > 0 else "x-prints-smaller", fault.shown)
        meaning = say("squares-come-out-rectangles-whichever-motor", fault.shown)
        repair = where_seen(fault.size, say("look-whether-belts-run-along-guides"), say("nothing-repair"))
        return Care(title, meaning, fault.size, repair)  # mm in 100 mm
