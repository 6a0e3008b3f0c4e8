"""An axis driven by two motors whose pulleys differ."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import SCALE_MM, Places, Profiles, Scene, Usual, onto_bed, waves
from printmend.effects.prior import harmonics_of, profile_of, turning_share
from printmend.effects.words import PLACES, Found, Told, Waves, carrier_name, span_mm
from printmend.messages import say

HARMONICS = harmonics_of("two_motors")


class TwoMotors(Usual):
    """Harmonics of the turn that change along the other bed axis."""

    name = "two_motors"
    at_motors = True
    keys = Waves(tuple(map(int, HARMONICS)))

    def carriers(self, scene: Scene) -> range:
        return range(0 if scene.corexy else 2)

    def profiles(self, where: int, scene: Scene) -> Profiles:
        return [2 * profile_of(self.name)]

    def share(self, where: int, scene: Scene) -> float | None:
        return turning_share(self.name, scene, where)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        other = scene.off_middle(places.bed_mm)[:, [1 - where]]
        return onto_bed(scene, where, other * waves(places.motor_mm[:, where], scene.turns_mm[where], HARMONICS))

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        turn_mm = scene.turns_mm[found.where]
        turn = waves(np.linspace(0.0, turn_mm, PLACES), turn_mm, HARMONICS)
        differ_mm = np.abs(turn @ found.sizes_mm).max() * span_mm(scene, 1 - found.where) / SCALE_MM
        other = carrier_name(scene, 1 - found.where)
        words = say("turn-looks-different-two-ends-two", carrier_name(scene, found.where), other, f"{differ_mm:.2f}")
        yield Told("two-motors", words)
