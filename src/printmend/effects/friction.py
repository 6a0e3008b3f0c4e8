"""Lost motion that grows with the length of belt that friction stretches (physics.md eq. 9)."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Places, Scene, Shapes, Usual, held, onto_bed
from printmend.effects.play import play_mm
from printmend.effects.words import Care, Fault, Found, Numbers, amount, motor_name, those_of
from printmend.messages import say


class Friction(Usual):
    """Play that changes along one belt, evenly and with the square."""

    name = "friction"
    acts = Acts.DRIVE
    keys = Numbers(("size_mm", "square_mm"))

    def shapes(self, where: int, scene: Scene) -> Shapes:
        return [scene.motor_span_mm[where]]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        x = scene.motor_off_middle(where, places.motor_mm[:, where])
        seen = held(x, scene.motor_off_middle(where, np.array(shape)))  # it continues straight beyond the measured span
        return onto_bed(scene, where, 0.5 * places.side[:, [where]] * np.stack([x, seen * (2 * x - seen)], axis=1))

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        if those_of("breathing", beside, found.where):
            return
        mean, sd, least, most = play_mm(beside, found.where, scene)
        words = say("fault-friction", amount(mean, sd), f"{least:.2f}", f"{most:.2f}")
        yield Fault(motor_name(scene, found.where), "friction", mean, sd, "mm", words)

    def advice(self, fault: Fault, where: str) -> Care:
        """Return how far an axis lags behind, and what makes it run easily."""
        title, repair = say("runs-stiffly-belt-stretches", where), say("clean-oil-guides-look-wheel-bearing")
        meaning = say("after-change-direction-lags-mm-more", where, fault.shown)
        return Care(title, meaning, fault.size, repair, say("printmend-carries"))
