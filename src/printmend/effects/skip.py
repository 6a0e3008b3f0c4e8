"""A belt that skipped teeth of its pulley, or a motor that lost steps: everything after it is off by a whole number."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import GONE, Of, Places, Scene, Term, Usual, about, onto_bed
from printmend.effects.prior import shared
from printmend.effects.step import APART, breaks
from printmend.effects.words import REPAIR_MM, Care, Fault, Found, Numbers, Told, motor_name
from printmend.messages import say

MILD = (1.0, 0.35)  # shares of the usual size to try: an electrical turn is less than a tooth


class Skip(Usual):
    """A large shift of one belt at one moment, a share of the print. Homing takes it away."""

    name = "skip"
    kinds = ("jump", "jumps")
    of = Of.SESSION
    fate = GONE
    most = 12
    keys = Numbers(shape=("at_share",))

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            yield from shared(self.name, motor, [(each,) for each in breaks(scene)], MILD)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, (places.done > shape[0])[:, None] * 1.0)

    def finer(self, where: int, shape: tuple[float, ...], round_: int, scene: Scene) -> Iterator[tuple[float, ...]]:
        yield from ((float(each),) for each in about(shape[0], APART, round_) if each > scene.unseen_share)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        size = f"{found.sizes_mm[0]:+.2f}"
        yield Told("jump", say("skipped-during-test-print-part-may", motor_name(scene, found.where).upper(), size))

    def advice(self, fault: Fault, where: str) -> Care:
        """Return what a lost place does to a print, which no file mends."""
        size_mm = abs(fault.value)
        title, meaning = (
            say("lost-place-during-print", where),
            say("from-one-point-everything-lies-mm", f"{size_mm:.2f}"),
        )
        repair, carries = say("tighten-belt-oil-guides-print-slower"), say("software-cannot-carry-nobody-knows-when")
        return Care(title, meaning, max(size_mm, REPAIR_MM), repair, carries)
