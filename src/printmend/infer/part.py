"""One effect of a machine with its sizes after a measurement."""

from dataclasses import dataclass

import numpy as np

from printmend.effects.sized import Sized

DRAWS = 96  # machines that are drawn


@dataclass(frozen=True, eq=False)
class Part:
    """One effect at one place with one shape, and the belief about its sizes.

    ``acts_mm`` [P] are the sizes that the model has: their mean in the likeliest set, 0 where that has none.
    ``draws_mm`` [P, D] are those of the drawn machines; ``chance`` is the share of them that have it.
    """

    effect: str
    where: int
    shape: tuple[float, ...]
    acts_mm: np.ndarray
    draws_mm: np.ndarray

    @property
    def chance(self) -> float:
        return float(self.draws_mm.any(axis=0).mean())

    @property
    def mean_mm(self) -> np.ndarray:
        return np.asarray(self.draws_mm.mean(axis=1))

    @property
    def sd_mm(self) -> np.ndarray:
        return np.asarray(self.draws_mm.std(axis=1))

    def acting(self) -> Sized:
        return Sized(self.effect, self.where, self.shape, self.acts_mm)
