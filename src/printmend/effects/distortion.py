"""A distortion of the bed that neither axis makes alone: a Gaussian process of both places."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.crooked import plane_waves
from printmend.effects.effect import Acts, Places, Scene, Term, Usual, along, drawn_places
from printmend.effects.prior import alternatives
from printmend.effects.uneven import mirrored, spectrum
from printmend.effects.words import LEAST_SHOWN_MM, Care, Fault, Found, Whole
from printmend.messages import say

COUNT = 7  # cosines along either axis: over 200 mm the shortest is 57 mm long
LENGTHS_MM = (25.0, 40.0, 65.0)


class Distortion(Usual):
    """Products of cosines over the measured spans of both bed axes, which push along one of them."""

    name = "distortion"
    acts = Acts.WAVE
    keys = Whole()

    def terms(self, scene: Scene) -> Iterator[Term]:
        (x0, x1), (y0, y1) = scene.bed_span_mm
        spectra = [[np.array(spectrum(span, each, COUNT)) for span in scene.bed_span_mm] for each in LENGTHS_MM]
        profiles = [x[:, None] * y for x, y in spectra]
        for axis in range(2):
            yield from alternatives(self.name, axis, [(x0, x1, y0, y1)], *(tuple(each.ravel()) for each in profiles))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        x, y = (mirrored(places.bed_mm[:, axis], shape[2 * axis : 2 * axis + 2], COUNT) for axis in range(2))
        return along(where, (x[:, :, None] * y[:, None, :]).reshape(len(places), x.shape[1] * y.shape[1]))

    def rows(self, where: int, shape: tuple[float, ...], sizes_mm: np.ndarray) -> np.ndarray:
        """Return its waves as rows [2K, 6] of a frame: cos a cos b = (cos(a + b) + cos(a − b)) / 2."""
        low, high = np.reshape(shape, (2, 2)).T
        orders = np.stack(np.meshgrid(*2 * [np.arange(1, COUNT + 1)], indexing="ij"), axis=-1).reshape(-1, 2)
        rates = np.pi * orders / np.maximum(high - low, 1.0)
        both = [plane_waves(each, each @ low, where, sizes_mm / 2) for each in (rates, rates * [1.0, -1.0])]
        return np.vstack(both)

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        columns = found.columns(drawn_places(scene), scene)[:, found.where]
        size, sd = found.size(lambda sizes: float(np.abs(columns @ sizes).max()))
        if size >= LEAST_SHOWN_MM:
            words = say("fault-distortion", "XY"[found.where], f"{size:.2f}")
            yield Fault("frame", "distortion", size, sd, "mm", words)

    def advice(self, fault: Fault, where: str) -> Care:
        """Return the meaning and the repair of a distortion."""
        title, meaning = say("bed-distorted"), say("prints-off-here-and-there", f"{abs(fault.value):.2f}")
        return Care(title, meaning, abs(fault.value), say("look-loose-frame-bed-head"))
