"""How the belts of two motors reach the bed, as a value: CoreXY mixing and a crooked frame, in any unit."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from printmend.jit import record
from printmend.machine.kernels import bed as law
from printmend.machine.kernels import run
from printmend.path import frozen


@dataclass(frozen=True, eq=False)
class BedMap:
    """The way from motors to bed: CoreXY mixing where ``corexy``, then x' = x + Σ a_pq ((x + x0)/Lx)^p ((y + y0)/Ly)^q
    for belts at (x, y), and y' with b_pq (physics.md eq. 13 and 14).

    ``terms`` [2, 10] are a and b in the order of `Frame.exponents`, ``origin`` [2] is (x0, y0) and ``scale`` [2] is
    (Lx, Ly), all in one unit: mm, or full steps. ``waves`` [K, 6] are added: the angle of each a
    unit of the divided places along x and along y, and its cosine and sine in x and in y.
    """

    corexy: bool
    terms: np.ndarray
    origin: np.ndarray
    scale: np.ndarray
    waves: np.ndarray = field(default_factory=lambda: np.zeros((0, law.WAVE_FIELDS)))

    def __post_init__(self) -> None:
        for name in ("terms", "origin", "scale", "waves"):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), float)))

    @cached_property
    def is_straight(self) -> bool:
        """Say whether the frame leaves every place where it is."""
        return not self.terms.any() and not len(self.waves)

    @property
    def record(self) -> np.record:
        """The map as the kernels take it: a record of `kernels.bed.BED`."""
        way = record(law.BED)
        way.corexy, way.framed, way.wave_count = self.corexy, not self.is_straight, len(self.waves)
        way.origin[:], way.scale[:], way.terms[:] = self.origin, self.scale, self.terms
        way.waves[: len(self.waves)] = np.ascontiguousarray(self.waves).view(law.WAVE).ravel()
        return way

    def anchored(self, place: np.ndarray) -> "BedMap":
        """Return the map shifted so that the frame leaves ``place`` [2], where a layer starts, where it is."""
        if self.is_straight:
            return self
        way = self.record
        run.anchor(way, float(place[0]), float(place[1]))
        return replace(self, terms=way.terms)

    def printed(self, belts: np.ndarray) -> np.ndarray:
        """Return the places on the bed [..., 2] of the motors' belts [..., 2]."""
        return self._each(run.printed_each, belts)

    def wanted(self, places: np.ndarray) -> np.ndarray:
        """Return where the motors' belts [..., 2] have to be for places on the bed [..., 2]: the inverse."""
        return self._each(run.wanted_each, places)

    def _each(self, law_each: Callable[..., None], places: np.ndarray) -> np.ndarray:
        places = np.asarray(places, float)
        if self.is_straight and not self.corexy:
            return places
        flat = np.ascontiguousarray(places.reshape(-1, 2))
        out = np.empty(flat.shape)
        law_each(self.record, flat, out)
        return out.reshape(places.shape)

    def slopes(self, belts: np.ndarray) -> np.ndarray:
        """Return the derivatives [N, 2, 2] of the places on the bed by the motors' belts, at belts [N, 2]."""
        out = np.empty((len(belts), 2, 2))
        run.slopes_each(self.record, np.ascontiguousarray(belts, float), out)
        return out
