"""A belt or guide with an error without a period: a Gaussian process of the position along the axis."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.course import course_of, fit_of
from printmend.effects.effect import Acts, Places, Scene, onto_bed
from printmend.effects.process import Process
from printmend.effects.words import Care, Fault, Found, motor_name, those_of, where_seen
from printmend.messages import say


class Uneven(Process):
    """Cosines over the span that was seen, with a smooth process's spectrum of one length (Solin & Särkkä 2020)."""

    name = "uneven"
    kinds = ("warp",)
    acts = Acts.DRIVE

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, self.series(places.motor_mm[:, where], shape))

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        told = fit_of(scene, found.where, 3 if those_of("bend", beside, found.where) else 1)
        size, sd = course_of(found, beside, scene).size(lambda course: float(np.abs(course - told @ course).max()))
        yield Fault(motor_name(scene, found.where), "warp", size, sd, "mm", say("fault-uneven", f"{size:.2f}"))

    def advice(self, fault: Fault, where: str) -> Care:
        """Return how far lines swing, and which part may be worn."""
        title, meaning = say("runs-unevenly-along-way", where), say("along-print-swings-up-mm-same", where, fault.shown)
        return Care(title, meaning, fault.size, where_seen(fault.size, say("look-along-belt-worn-stretched-stretch")))
