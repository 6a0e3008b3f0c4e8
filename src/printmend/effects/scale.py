"""A motor that moves too far or not far enough: wrong steps per mm, or a pulley of another size."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from printmend.effects.course import course_of, slope_of
from printmend.effects.effect import Acts, Places, Scene, Usual, onto_bed
from printmend.effects.prior import NEAR_SHARE
from printmend.effects.teeth import TOOTH_MM
from printmend.effects.words import Care, Fault, Found, Numbers, amount, motor_name
from printmend.messages import say


class Scale(Usual):
    """An error that grows evenly along one belt, in mm per 100 mm."""

    name = "scale"
    acts = Acts.DRIVE
    keys = Numbers(("percent",))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, scene.motor_off_middle(where, places.motor_mm[:, [where]]))

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        course, slope = course_of(found, beside, scene), slope_of(scene, found.where)
        whole = replace(
            found, sizes_mm=found.sizes_mm + slope @ course.sizes_mm, draws_mm=found.draws_mm + slope @ course.draws_mm
        )
        percent, sd = whole.size()  # mm in 100 mm
        turn_mm, own_mm = scene.turns_mm[found.where], scene.printer.axes[found.where].mm_per_turn
        toothed = abs(turn_mm / TOOTH_MM - round(turn_mm / TOOTH_MM)) < 1e-9  # else an idler's turn, or the belt's
        radius = (turn_mm if toothed else own_mm) / (2 * np.pi)
        digits = 3 if abs(radius * percent / 100) >= 0.001 else 4  # never a number instead of itself
        said = amount(radius * (1 + percent / 100), radius * sd / 100)
        size = amount(abs(percent), sd, "%")
        way = say("large" if percent > 0 else "small")
        words = say("fault-scale", size, way, said, f"{radius:.{digits}f}")
        yield Fault(motor_name(scene, found.where), "scale", percent, sd, "%", words)

    def advice(self, fault: Fault, where: str) -> Care:
        """Return how much too large or too small it prints, and whether the pulley may be a wrong one."""
        is_large = fault.value > 0
        title = say("prints-too", where, fault.shown, say("large" if is_large else "small"))
        meaning = say("every-100-mm-along-come-out", where, fault.shown, say("long" if is_large else "short"))
        repair = say("nothing-repair-correct-steps-per-millimetre")
        if fault.size > 100 * NEAR_SHARE:
            repair = say("look-pulley-s-size-number-teeth")
        return Care(title, meaning, fault.size, repair, say("firmware-can-hold-printmend"))
