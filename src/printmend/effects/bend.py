"""A scale that changes along the axis, as where a belt is not parallel to its rail."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.course import course_of, fit_of
from printmend.effects.effect import Acts, Places, Scene, Shapes, Usual, held, onto_bed
from printmend.effects.words import LEAST_SHOWN, Care, Fault, Found, Numbers, motor_name
from printmend.messages import say


class Bend(Usual):
    """Square and cube of the place along one belt."""

    name = "bend"
    kinds = ("drift",)
    acts = Acts.DRIVE
    keys = Numbers(("square_mm", "cube_mm"))

    def shapes(self, where: int, scene: Scene) -> Shapes:
        return [scene.motor_span_mm[where]]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        x = scene.motor_off_middle(where, places.motor_mm[:, where])
        seen = held(x, scene.motor_off_middle(where, np.array(shape)))  # it continues straight beyond the measured span
        columns = [seen**power + power * seen ** (power - 1) * (x - seen) for power in (2, 3)]
        return onto_bed(scene, where, np.stack(columns, axis=1))

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        line, bent = (fit_of(scene, found.where, degree) for degree in (1, 3))
        size, sd = course_of(found, beside, scene).size(lambda course: float(np.abs((bent - line) @ course).max()))
        if size >= LEAST_SHOWN:
            yield Fault(motor_name(scene, found.where), "drift", size, sd, "mm", say("fault-bend", f"{size:.2f}"))

    def advice(self, fault: Fault, where: str) -> Care:
        """Return by how much the scale changes along the axis, and where to look for the cause."""
        meaning = say("scale-changes-along-up-mm", where, fault.shown)
        repair = say("look-along-belt-guide-bend-place")
        return Care(say("stretches-unevenly-along-bed", where), meaning, fault.size, repair)
