"""A joint or a dent of the belt: beyond it, everything is shifted, with a linear ramp over its width."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import STEPS, Acts, Places, Scene, Shapes, Usual, onto_bed, steps
from printmend.effects.prior import apart_of, numbers_of
from printmend.effects.words import Care, Fault, Found, Numbers, amount, motor_name, where_seen
from printmend.messages import say


class AtOnePlace(Usual):
    """An effect at one place of one belt, with a width and a size; the ids of its messages."""

    acts = Acts.DRIVE
    keys = Numbers(shape=("at_mm", "width_mm"))
    words: str
    title: str
    meaning: str
    replace: str

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        at, _ = found.shape
        size, sd = found.size()
        words = say(self.words, f"{at:.0f}", amount(size, sd))
        yield Fault(motor_name(scene, found.where), self.name, size, sd, "mm", words)

    def advice(self, fault: Fault, where: str) -> Care:
        """Return its meaning; if it is large, advise a new belt."""
        title, meaning = say(self.title, where), say(self.meaning, where, fault.shown)
        return Care(title, meaning, fault.size, where_seen(fault.size, say(self.replace)))


class Splice(AtOnePlace):
    """A ramp from 0 to 1 about one place of one belt."""

    name = "splice"
    most = 3
    words = "fault-splice"
    title = "belt-joint-dent"
    meaning = "beyond-place-along-everything-lies-mm"
    replace = "look-along-belt-joint-dent-missing"

    def shapes(self, where: int, scene: Scene) -> Shapes:
        widths = numbers_of(self.name, "widths")  # others are looked for between them
        return [(at, width) for at in steps(*scene.motor_span_mm[where]) for width in widths]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        at, width = shape
        ramp = np.clip((places.motor_mm[:, where] - at) / width + 0.5, 0.0, 1.0)
        return onto_bed(scene, where, ramp[:, None])

    def spacing(self, where: int, shape: tuple[float, ...], scene: Scene) -> tuple[float, ...]:
        low, high = scene.motor_span_mm[where]
        return (high - low) / STEPS, apart_of(self.name, "widths", shape[1])
