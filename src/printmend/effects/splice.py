"""A joint or a dent of the belt: past one place all lies further, reached evenly over a width."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from printmend.effects.effect import STAYS, Acts, Of, Places, Scene, Term, Usual, about, onto_bed
from printmend.effects.keys import Numbers
from printmend.effects.prior import alternatives
from printmend.effects.words import SOON_MM, Care, Fault, Found, amount, motor_name
from printmend.messages import say

STEP_MM = 5.0  # distance of the places that are tried
WIDTH_MM = 4.0  # that is tried first: others are looked for about it

TITLE = partial(say, "belt-joint-dent")
MEANING = partial(say, "beyond-place-along-everything-lies-mm")
REPLACE = partial(say, "look-along-belt-joint-dent-missing")
NO_REPAIR = partial(say, "nothing-replace")


class Splice(Usual):
    """A ramp from 0 to 1 about one place of one belt."""

    name = "splice"
    of = Of.MACHINE
    acts = Acts.DRIVE
    fate = STAYS
    most = 3
    keys = Numbers(shape=("at_mm", "width_mm"))

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            low, high = scene.motor_span_mm[motor]
            at = np.arange(low + STEP_MM, high, STEP_MM)
            shapes = [(float(place), WIDTH_MM) for place in at]
            if shapes:
                yield from alternatives(self.name, motor, shapes, (1.0,))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        at, width = shape
        ramp = np.clip((places.motor_mm[:, where] - at) / width + 0.5, 0.0, 1.0)
        return onto_bed(scene, where, ramp[:, None])

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        at, width = shape
        for place in about(at, STEP_MM, round_):
            yield float(place), width
        for factor in about(0.0, 1.4, round_):
            yield at, float(width * np.exp(factor))

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        at, _ = found.shape
        size, sd = found.size(lambda sizes: float(sizes[0]))
        words = say("fault-splice", f"{at:.0f}", amount(size, sd))
        yield Fault(motor_name(scene, found.where), "splice", size, sd, "mm", words)

    def advice(self, fault: Fault, where: str) -> Care | None:
        """Say what a joint of the belt does, and that the belt is to be replaced where it is large."""
        if fault.kind != "splice":
            return None
        size_mm = abs(fault.value)
        repair = REPLACE() if size_mm >= SOON_MM else NO_REPAIR()
        return Care(TITLE(where), MEANING(where, f"{size_mm:.2f}"), size_mm, repair)
