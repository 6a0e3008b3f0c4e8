"""Play that changes over the turn: a loose belt, or a loose set screw on an uneven pulley (eq. 7, 10)."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Places, Profiles, Scene, Usual, onto_bed, waves
from printmend.effects.play import play_mm
from printmend.effects.prior import harmonics_of, number_of, turning_share
from printmend.effects.pulley import first, harmonic_faults, is_loose
from printmend.effects.words import Care, Fault, Found, Waves, amount, motor_name, those_of
from printmend.messages import say

HARMONICS = harmonics_of("breathing")
PROFILE = HARMONICS ** -number_of("breathing", "falls")  # of their sizes
_SAID = {  # messages by the kind of the fault, and whether play depends on the place, too
    ("loose-belt", False): "fault-loose-belt",
    ("loose-belt", True): "fault-loose-belt-by-place",
    ("play-by-angle", False): "fault-play-by-angle",
    ("play-by-angle", True): "fault-play-by-angle-and-place",
}


class Breathing(Usual):
    """A Fourier series of one motor's play."""

    name = "breathing"
    kinds = ("loose-belt", "play-by-angle")
    acts = Acts.DRIVE
    needs = ("play", "friction")
    keys = Waves(tuple(map(int, HARMONICS)))

    def profiles(self, where: int, scene: Scene) -> Profiles:
        return [np.tile(PROFILE, 2)]

    def share(self, where: int, scene: Scene) -> float | None:
        return turning_share(self.name, scene, where)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        turn = waves(places.motor_mm[:, where], scene.turns_mm[where], first(HARMONICS, shape))
        return onto_bed(scene, where, 0.5 * places.side[:, [where]] * turn)

    def waves_mm(self, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return scene.turns_mm[where] / HARMONICS

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        mean, sd, least, most = play_mm(beside, found.where, scene)
        kind = "loose-belt" if is_loose(found, beside, scene) else "play-by-angle"
        message = _SAID[kind, bool(those_of("friction", beside, found.where))]
        words = say(message, amount(mean, sd), f"{least:.2f}", f"{most:.2f}")
        yield Fault(motor_name(scene, found.where), kind, mean, sd, "mm", words)
        yield from harmonic_faults(found, beside, scene)

    def advice(self, fault: Fault, where: str) -> Care:
        """Return what stands still at a change of direction, and whether the belt or the pulley's screw is loose."""
        if fault.kind == "loose-belt":
            meaning = say("after-each-change-direction-stands-still-2", where, fault.shown)
            repair = say("tighten-belt-pulley-pulls-tight-lets")
            return Care(say("belt-loose-uneven-pulley", where), meaning, fault.size, repair, say("printmend-carries"))
        meaning = say("after-each-change-direction-stands-still-3", where, fault.shown)
        repair, carries = say("tighten-grub-screw-flat-motor-s"), say("printmend-carries-while-stays-loose-screw")
        return Care(say("pulley-loose-shaft", where), meaning, fault.size, repair, carries)
