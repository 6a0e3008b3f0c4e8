"""Play that grows while it prints, as where something comes loose."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Of, Places, Scene, Usual, onto_bed
from printmend.effects.words import Found, Told, carrier_name
from printmend.messages import say, together

OF_END = say("model-end-print")


class Wear(Usual):
    """Play of one motor that grows with the length printed."""

    name = "wear"
    of = Of.SESSION  # that stays: a print is mended for the play with which the last one ended
    acts = Acts.DRIVE
    positive = True

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, (0.5 * places.side[:, where] * places.done)[:, None])

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        size = float(found.sizes_mm[0])
        grew = size > 0
        message = "play-changed-mm-while-print-went-3" if grew else "play-changed-mm-while-print-went"
        words = say(message, carrier_name(scene, found.where), f"{abs(size):.2f}")
        yield Told("wear" if grew else "sticking", together(". ", [words, OF_END]) if found.acts else words)
