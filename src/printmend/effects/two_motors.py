"""One axis that two motors drive, with pulleys that differ."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import Acts, Of, Places, SCALE_MM, Scene, Term, onto_bed, waves
from printmend.effects.prior import alternatives


class TwoMotors:
    """Harmonics of the turn that change along the other bed axis."""

    name = "two_motors"
    of = Of.MACHINE
    acts = Acts.NOT
    from_home = True
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        for axis in range(0 if scene.corexy else 2):
            yield from alternatives(self.name, axis, [()], (1.0, 0.7, 0.5) * 2)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        other = (places.bed_mm[:, 1 - where] - scene.middle_mm[1 - where]) / SCALE_MM
        turn = waves(places.motor_mm[:, where], scene.turns_mm[where], np.arange(1, 4))
        return onto_bed(scene, where, other[:, None] * turn)

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return sizes
