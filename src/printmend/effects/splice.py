"""A joint or a dent of the belt: past one place all lies further, reached evenly over a width."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import Acts, Of, about, Places, Scene, Term, onto_bed
from printmend.effects.prior import alternatives

STEP_MM = 5.0  # distance of the places that are tried
WIDTH_MM = 4.0  # that is tried first: others are looked for about it


class Splice:
    """A ramp from 0 to 1 about one place of one belt."""

    name = "splice"
    of = Of.MACHINE
    acts = Acts.DRIVE
    from_home = True
    most = 3

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            low, high = scene.motor_span_mm[motor]
            at = np.arange(low + STEP_MM, high, STEP_MM)
            shapes = [(float(place), WIDTH_MM) for place in at]
            if shapes:
                yield from alternatives(self.name, motor, shapes, (1.0,))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        at, width = shape
        ramp = np.clip((places.motor_mm[:, where] - at) / width + 0.5, 0.0, 1.0)
        return onto_bed(scene, where, ramp[:, None])

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        at, width = shape
        for place in about(at, STEP_MM, round_):
            yield float(place), width
        for factor in about(0.0, 1.4, round_):
            yield at, float(width * np.exp(factor))

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return sizes
