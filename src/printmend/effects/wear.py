"""Play that grows while it prints, as where something comes loose."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import STAYS, Acts, Of, Places, Scene, Term, Usual, onto_bed
from printmend.effects.keys import Numbers
from printmend.effects.prior import alternatives
from printmend.effects.words import Found, Message, Told, carrier_name

LOOSE = Message("the play of {a} changed by {b} mm while the print went on: something comes loose")
STICKS = Message(
    "the play of {a} changed by {b} mm while the print went on: no printing makes play smaller, so it goes with "
    "the moves, as where an axis sticks and slips"
)
OF_END = ". The model is of the end of the print"


class Wear(Usual):
    """Play of one motor that grows with the length printed."""

    name = "wear"
    cause = "play that grows"  # of an expected error
    of = Of.SESSION  # that stays: a print is mended for the play with which the last one ended
    acts = Acts.DRIVE
    fate = STAYS
    keys = Numbers()

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            yield from alternatives(self.name, motor, [()], (1.0,), positive=True)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, (0.5 * places.side[:, where] * places.done)[:, None])

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        size = float(found.sizes_mm[0])
        kind, say = ("wear", LOOSE) if size > 0 else ("sticking", STICKS)
        words = say(carrier_name(scene, found.where), f"{size:+.2f}")
        yield Told(kind, words + (OF_END if found.acts else ""))
