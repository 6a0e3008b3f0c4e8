"""Ripple of belt teeth and of the motor's full steps: vertical fine artefacts."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import Acts, Of, Places, Scene, Term, onto_bed, waves
from printmend.effects.prior import alternatives

TOOTH_MM = 2.0  # of a GT2 belt


class Teeth:
    """A wave of one tooth or of one to four full steps."""

    name = "teeth"
    of = Of.MACHINE
    acts = Acts.DRIVE
    from_home = True
    most = 2

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            step = scene.printer.axes[motor].mm_per_step
            yield from alternatives(self.name, motor, [(TOOTH_MM,), (4 * step,), (2 * step,), (step,)], (1.0, 1.0))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, waves(places.motor_mm[:, where], shape[0], np.ones(1)))

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return sizes
