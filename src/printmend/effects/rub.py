"""Lost motion that varies along the belt without a pattern, where the belt rubs or a guide binds: a Gaussian
process."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Places, Scene, onto_bed
from printmend.effects.process import Process
from printmend.effects.words import Care, Fault, Found, along_motor_mm, motor_name
from printmend.messages import say


class Rub(Process):
    """Cosines of one motor's play over the measured span."""

    name = "rub"
    acts = Acts.DRIVE

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        lag = 0.5 * places.side[:, [where]] * self.series(places.motor_mm[:, where], shape)
        return onto_bed(scene, where, lag)

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        series = self.series(along_motor_mm(scene, found.where), found.shape)
        size, sd = found.size(lambda sizes: float(np.ptp(series @ sizes)))
        yield Fault(motor_name(scene, found.where), "rub", size, sd, "mm", say("fault-rub", f"{size:.2f}"))

    def advice(self, fault: Fault, where: str) -> Care:
        """Return the meaning and the repair of lost motion that varies along the axis."""
        title, meaning = say("axis-binds-or-rubs", where), say("lost-motion-changes-along-axis", fault.shown)
        return Care(title, meaning, fault.size, say("move-by-hand-feel-where-binds"))
