"""Play that grows during the print, because something comes loose."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Of, Places, Scene, onto_bed
from printmend.effects.play import Play
from printmend.effects.words import Fault, Found, Told, carrier_name, those_of
from printmend.messages import say, together

OF_END = say("model-end-print")


class Wear(Play):
    """Play of one motor that grows with the length printed."""

    name = "wear"
    below = ""
    of = Of.SESSION  # that stays: a print is mended for the play with which the last one ended

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, (0.5 * places.side[:, where] * places.done)[:, None])

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        if not those_of("play", beside, found.where):
            yield from super().faults(found, beside, scene)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        size = float(found.sizes_mm[0])
        grew = size > 0
        message = "play-changed-mm-while-print-went-3" if grew else "play-changed-mm-while-print-went"
        words = say(message, carrier_name(scene, found.where), f"{abs(size):.2f}")
        yield Told("wear" if grew else "sticking", together(". ", [words, OF_END]) if found.acts else words)
