"""A taut belt that stretches: odd harmonics of its pulley fade along it (physics.md eq. 8)."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import Acts, Of, Places, SCALE_MM, Scene, Term, held, onto_bed, waves
from printmend.effects.prior import alternatives

HARMONICS = np.array([1.0, 3.0, 5.0])


class Elastic:
    """Odd harmonics of one motor's turn that grow along the belt."""

    name = "elastic"
    of = Of.MACHINE
    acts = Acts.DRIVE
    from_home = True
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        profile = tuple(np.tile(HARMONICS**-2.5, 2))
        for motor in range(2):
            yield from alternatives(self.name, motor, [scene.motor_span_mm[motor]], profile)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        x = (held(places.motor_mm[:, where], shape) - scene.motor_middle_mm(where)) / SCALE_MM
        turn = waves(places.motor_mm[:, where], scene.turns_mm[where], HARMONICS)
        return onto_bed(scene, where, x[:, None] * turn)

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return sizes
