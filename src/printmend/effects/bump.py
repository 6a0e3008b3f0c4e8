"""A dent or a missing tooth of the belt: about one place the carriage is ahead or behind, and nowhere else."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from printmend.effects.effect import STAYS, Acts, Of, Places, Scene, Term, Usual, about, onto_bed
from printmend.effects.keys import Numbers
from printmend.effects.prior import alternatives
from printmend.effects.words import SOON_MM, Care, Fault, Found, amount, motor_name
from printmend.messages import say

SPACING = 2.0  # distance of the places that are tried, in widths
WIDTHS_MM = (1.0, 2.5)  # of the bell; a smooth belt error is as good where it is wider

TITLE = partial(say, "belt-dent-missing-tooth")
MEANING = partial(say, "lines-bulge-at-one-place")
REPLACE = partial(say, "look-for-dent-missing-tooth")
NO_REPAIR = partial(say, "nothing-replace")


class Bump(Usual):
    """A bell about one place of one belt."""

    name = "bump"
    of = Of.MACHINE
    acts = Acts.DRIVE
    fate = STAYS
    most = 2
    keys = Numbers(shape=("at_mm", "width_mm"))

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            low, high = scene.motor_span_mm[motor]
            shapes = [(float(at), width) for width in WIDTHS_MM for at in np.arange(low, high, SPACING * width)]
            if shapes:
                yield from alternatives(self.name, motor, shapes, (1.0,))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        at, width = shape
        bell = np.exp(-0.5 * ((places.motor_mm[:, [where]] - at) / width) ** 2)
        return onto_bed(scene, where, bell)

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        at, width = shape
        for place in about(at, SPACING * width, round_):
            yield float(place), width
        for factor in about(0.0, 0.7, round_):
            yield at, float(width * np.exp(factor))

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        at, _ = found.shape
        size, sd = found.size(lambda sizes: float(sizes[0]))
        words = say("fault-bump", f"{at:.0f}", amount(size, sd))
        yield Fault(motor_name(scene, found.where), "bump", size, sd, "mm", words)

    def advice(self, fault: Fault, where: str) -> Care | None:
        """Say what a dent of the belt does, and that the belt is to be replaced where it is large."""
        if fault.kind != "bump":
            return None
        size_mm = abs(fault.value)
        repair = REPLACE() if size_mm >= SOON_MM else NO_REPAIR()
        return Care(TITLE(where), MEANING(where, f"{size_mm:.2f}"), size_mm, repair)
