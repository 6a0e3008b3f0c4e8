"""A pulley that is not round about its shaft: eccentric, oval, cornered (physics.md eq. 2)."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import Acts, Of, Places, Scene, Term, onto_bed, waves
from printmend.effects.prior import alternatives

HARMONICS = np.arange(1.0, 33.0)  # corners of a pulley need so many
FOLDS = (2, 3, 4, 5, 6)  # of symmetric pulleys: oval, three-cornered, …
OFF_FOLD = 0.08  # size of what breaks a symmetry, as a share of the usual


def profiles() -> list[np.ndarray]:
    """Return how the harmonics' sizes may fall [32]: all alike, smooth, eccentric alone, or those of one symmetry."""
    plain = HARMONICS**-2.5
    symmetric = [np.where(HARMONICS % fold == 0, 1.0, OFF_FOLD) * plain for fold in FOLDS]
    return [plain, HARMONICS**-4.0, np.where(HARMONICS == 1, 1.0, OFF_FOLD) * plain, *symmetric]


class Pulley:
    """A Fourier series of one motor's turn."""

    name = "pulley"
    of = Of.MACHINE
    acts = Acts.DRIVE
    from_home = True
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            yield from alternatives(self.name, motor, [()], *(tuple(np.tile(each, 2)) for each in profiles()))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, waves(places.motor_mm[:, where], scene.turns_mm[where], HARMONICS))

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return sizes
