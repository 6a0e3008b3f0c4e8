"""A distortion of the bed that no single axis explains: a Gaussian process of both coordinates."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Places, Profiles, Scene, Shapes, along, drawn_places
from printmend.effects.prior import numbers_of
from printmend.effects.process import Process, cosines, plane_waves, rates_rad, share_of_span, smooth
from printmend.effects.words import Care, Fault, Found
from printmend.messages import say


class Distortion(Process):
    """Products of cosines over the measured spans of both bed axes, which push along one of them."""

    name = "distortion"
    acts = Acts.WAVE

    def shapes(self, where: int, scene: Scene) -> Shapes:
        return [(*scene.bed_span_mm[0], *scene.bed_span_mm[1])]

    def profiles(self, where: int, scene: Scene) -> Profiles:
        x_mm, y_mm = scene.bed_span_mm
        lengths = numbers_of(self.name, "lengths")
        return [np.outer(smooth(x_mm, each, self.count), smooth(y_mm, each, self.count)).ravel() for each in lengths]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        spans = shape[:2], shape[2:]
        x, y = (cosines(share_of_span(places.bed_mm[:, axis], spans[axis]), self.count) for axis in range(2))
        return along(where, (x[:, :, None] * y[:, None, :]).reshape(len(places), self.count**2))

    def rows(self, where: int, shape: tuple[float, ...], sizes_mm: np.ndarray) -> np.ndarray:
        """Return its waves as rows [2K, 6] of a frame: cos a cos b = (cos(a + b) + cos(a − b)) / 2."""
        one_way = np.meshgrid(rates_rad(shape[:2], self.count), rates_rad(shape[2:], self.count), indexing="ij")
        rates = np.stack(one_way, axis=-1).reshape(-1, 2)
        both = rates, rates * [1.0, -1.0]
        return np.vstack([plane_waves(each, each @ np.array(shape[::2]), where, sizes_mm / 2) for each in both])

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        columns = found.columns(drawn_places(scene), scene)[:, found.where]
        size, sd = found.size(lambda sizes: float(np.abs(columns @ sizes).max()))
        yield Fault("frame", "distortion", size, sd, "mm", say("fault-distortion", "XY"[found.where], f"{size:.2f}"))

    def advice(self, fault: Fault, where: str) -> Care:
        """Return the meaning and the repair of a distortion."""
        title, meaning = say("bed-distorted"), say("prints-off-here-and-there", fault.shown)
        return Care(title, meaning, fault.size, say("look-loose-frame-bed-head"))
