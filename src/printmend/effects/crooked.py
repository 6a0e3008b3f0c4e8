"""A crooked or dented guide: it pushes the head aside by a Gaussian process of the position along the guide."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Places, Scene, Shapes, along
from printmend.effects.prior import numbers_of
from printmend.effects.process import Process, cosines, plane_waves, rates_rad, share_of_span
from printmend.effects.words import PLACES, Care, Fault, Found
from printmend.messages import say


class Crooked(Process):
    """Cosines over a span of one bed axis, which push along the other.

    None of them has a slope at the ends of its span. A guide may have one at the end of the measurement, so the span is
    longer than the measurement. Otherwise a skewed axis would explain that slope.
    """

    name = "crooked"
    acts = Acts.WAVE

    def shapes(self, where: int, scene: Scene) -> Shapes:
        (low, high), more_mm = scene.bed_span_mm[where], max(numbers_of(self.name, "lengths")) / 2
        return [(low - more_mm, high + more_mm)]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        """Return its cosines; beyond the span they come back, for the waves of a frame have no end."""
        return along(1 - where, cosines(share_of_span(places.bed_mm[:, where], shape), self.count))

    def rows(self, where: int, shape: tuple[float, ...], sizes_mm: np.ndarray) -> np.ndarray:
        """Return its waves as rows [K, 6] of a frame."""
        rates = np.zeros((self.count, 2))
        rates[:, where] = rates_rad(shape, self.count)
        return plane_waves(rates, rates[:, where] * shape[0], 1 - where, sizes_mm)

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        place = np.linspace(*scene.bed_span_mm[found.where], PLACES)
        series = self.series(place, found.shape)
        size, sd = found.size(lambda sizes: float(np.abs(series @ sizes).max()))
        most, names = place[np.abs(series @ found.sizes_mm).argmax()], ("XY"[found.where], "XY"[1 - found.where])
        yield Fault("frame", "crooked", size, sd, "mm", say("fault-crooked", *names, f"{size:.2f}", f"{most:.0f}"))

    def advice(self, fault: Fault, where: str) -> Care:
        """Return the meaning and the repair of a crooked guide."""
        title, meaning = say("guide-crooked-or-dented"), say("head-pushed-aside-mm", fault.shown)
        return Care(title, meaning, fault.size, say("feel-along-guides"))
