"""A taut belt that stretches: the odd harmonics of its pulley fade along it (physics.md eq. 8)."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import SCALE_MM, Acts, Places, Profiles, Scene, Shapes, Usual, onto_bed, waves
from printmend.effects.prior import harmonics_of, turning_share
from printmend.effects.pulley import SMOOTH, wave_sizes
from printmend.effects.words import NAMED_SIGMAS, Care, Fault, Found, Waves, amount, motor_name
from printmend.messages import parts_of, say

HARMONICS = harmonics_of("elastic")
ELSE_IDLER = "fault-elastic-or-idler"  # message
IDLERS = (ELSE_IDLER, "fault-idler", "fault-idler-of-teeth", "fault-idler-or-pulley")  # messages that name an idler


class Elastic(Usual):
    """Odd harmonics of one motor's turn that grow along the belt."""

    name = "elastic"
    acts = Acts.DRIVE
    keys = Waves(tuple(map(int, HARMONICS)))

    def shapes(self, where: int, scene: Scene) -> Shapes:
        return [scene.motor_span_mm[where]]

    def profiles(self, where: int, scene: Scene) -> Profiles:
        return [np.tile(SMOOTH[HARMONICS.astype(int) - 1], 2)]

    def share(self, where: int, scene: Scene) -> float | None:
        return turning_share(self.name, scene, where)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        x = scene.motor_off_middle(where, places.motor_mm[:, [where]])
        return onto_bed(scene, where, x * waves(places.motor_mm[:, where], scene.turns_mm[where], HARMONICS))

    def waves_mm(self, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return scene.turns_mm[where] / HARMONICS

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        """The largest wave, by how much it changes from one end to the other.

        If only the wave of the pulley's eccentricity changes, an idler of nearly the pulley's size would look the same.
        """
        low, high = found.shape
        sizes, sds = wave_sizes(found)
        largest = int(np.argmax(sizes))
        size, sd = (float(each[largest]) * (high - low) / SCALE_MM for each in (sizes, sds))
        alone = not (sizes > NAMED_SIGMAS * sds)[1:].any()
        words = say(ELSE_IDLER if alone else "fault-elastic", amount(size, sd))
        yield Fault(motor_name(scene, found.where), "elastic", size, sd, "mm", words)

    def advice(self, fault: Fault, where: str) -> Care:
        """Return where along the belt the pulley's error changes, and what else may look so."""
        if any(part.id in IDLERS for part in parts_of(fault.words)):
            title, meaning = say("belt-stretches-idler-wobbles", where), say("pulley-s-error-changes-along-belt")
            return Care(title, meaning, fault.size, say("tighten-belt-unless-tight-look-whether"))
        title, meaning = say("belt-stretches", where), say("pulley-s-error-felt-near-motor")
        return Care(title, meaning, fault.size, say("tighten-belt-unless-tight"))
