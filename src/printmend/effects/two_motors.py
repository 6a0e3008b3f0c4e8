"""One axis that two motors drive, with pulleys that differ."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import SCALE_MM, Places, Scene, Term, Usual, onto_bed, waves
from printmend.effects.prior import alternatives, turning_share
from printmend.effects.words import Found, Told, Waves, carrier_name, span_mm
from printmend.messages import say


class TwoMotors(Usual):
    """Harmonics of the turn that change along the other bed axis."""

    name = "two_motors"
    keys = Waves((1, 2, 3))

    def terms(self, scene: Scene) -> Iterator[Term]:
        for axis in range(0 if scene.corexy else 2):
            yield from alternatives(
                self.name, axis, [()], (1.0, 0.7, 0.5) * 2, share=turning_share(self.name, scene, axis)
            )

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        other = (places.bed_mm[:, 1 - where] - scene.middle_mm[1 - where]) / SCALE_MM
        turn = waves(places.motor_mm[:, where], scene.turns_mm[where], np.arange(1, 4))
        return onto_bed(scene, where, other[:, None] * turn)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        turn = waves(np.linspace(0.0, scene.turns_mm[found.where], 120), scene.turns_mm[found.where], np.arange(1, 4))
        differ_mm = np.abs(turn @ found.sizes_mm).max() * span_mm(scene, 1 - found.where) / SCALE_MM
        other = carrier_name(scene, 1 - found.where)
        words = say("turn-looks-different-two-ends-two", carrier_name(scene, found.where), other, f"{differ_mm:.2f}")
        yield Told("two-motors", words)
