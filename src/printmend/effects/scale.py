"""A motor that goes too far or not far enough: steps per mm, or a pulley of another size."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import Acts, Of, Places, SCALE_MM, Scene, Term, onto_bed
from printmend.effects.prior import alternatives


class Scale:
    """An error that grows evenly along one belt, in mm per 100 mm."""

    name = "scale"
    of = Of.MACHINE
    acts = Acts.DRIVE
    from_home = True
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            yield from alternatives(self.name, motor, [()], (1.0,))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        x = (places.motor_mm[:, where] - scene.motor_middle_mm(where)) / SCALE_MM
        return onto_bed(scene, where, x[:, None])

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return sizes
