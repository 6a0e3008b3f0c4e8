"""Lost motion that varies along the belt without a pattern, where it rubs or a guide binds: a Gaussian process."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Places, Scene, Term, Usual, onto_bed
from printmend.effects.prior import alternatives
from printmend.effects.uneven import LENGTHS_MM, cosines, spectrum
from printmend.effects.words import LEAST_SHOWN_MM, Care, Fault, Found, Whole, along_motor_mm, motor_name
from printmend.messages import say

COUNT = 24  # cosines: over 200 mm the shortest is 17 mm long
RUB_LENGTHS_MM = LENGTHS_MM[1:]  # that fewer cosines can have


class Rub(Usual):
    """Cosines of one motor's play over the measured span."""

    name = "rub"
    acts = Acts.DRIVE
    keys = Whole()

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            span = scene.motor_span_mm[motor]
            yield from alternatives(self.name, motor, [span], *(spectrum(span, each, COUNT) for each in RUB_LENGTHS_MM))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        lag = 0.5 * places.side[:, [where]] * cosines(places.motor_mm[:, where], shape, COUNT)
        return onto_bed(scene, where, lag)

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        series = cosines(along_motor_mm(scene, found.where), found.shape, COUNT)
        size, sd = found.size(lambda sizes: float(np.ptp(series @ sizes)))
        if size >= LEAST_SHOWN_MM:
            words = say("fault-rub", f"{size:.2f}")
            yield Fault(motor_name(scene, found.where), "rub", size, sd, "mm", words)

    def advice(self, fault: Fault, where: str) -> Care:
        """Return the meaning and the repair of lost motion that varies along the axis."""
        title, meaning = (
            say("axis-binds-or-rubs", where),
            say("lost-motion-changes-along-axis", f"{abs(fault.value):.2f}"),
        )
        return Care(title, meaning, abs(fault.value), say("move-by-hand-feel-where-binds"))
