"""A belt that skipped teeth of its pulley, or a motor that lost steps: everything after it is off by a whole number of
teeth or steps."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import GONE, Places, Scene, onto_bed
from printmend.effects.step import AtOneMoment
from printmend.effects.words import REPAIR_MM, Care, Fault, Found, Told, motor_name
from printmend.messages import say


class Skip(AtOneMoment):
    """A large shift of one belt at one moment, a share of the print. Homing takes it away."""

    name = "skip"
    at_motors = True
    kinds = ("jump", "jumps")
    fate = GONE
    most = 12

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, (places.done > shape[0])[:, None] * 1.0)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        size = f"{found.sizes_mm[0]:+.2f}"
        yield Told("jump", say("skipped-during-test-print-part-may", motor_name(scene, found.where).upper(), size))

    def advice(self, fault: Fault, where: str) -> Care:
        """Return what a lost place does to a print, which no file mends."""
        title, meaning = say("lost-place-during-print", where), say("from-one-point-everything-lies-mm", fault.shown)
        repair, carries = say("tighten-belt-oil-guides-print-slower"), say("software-cannot-carry-nobody-knows-when")
        return Care(title, meaning, max(fault.size, REPAIR_MM), repair, carries)
