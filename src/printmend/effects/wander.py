"""A drift of unknown cause: a random walk in time, or a smooth process of the distance travelled."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import OTHERWISE, Of, Places, Profiles, Scene, Shapes, along
from printmend.effects.prior import numbers_of
from printmend.effects.process import Process, cosines, smooth, walk
from printmend.effects.words import Found, Told
from printmend.messages import say


class Wander(Process):
    """Cosines over the print with the spectrum of a random walk, or that of a smooth process of one length."""

    name = "wander"
    of = Of.SESSION
    fate = OTHERWISE

    def shapes(self, where: int, scene: Scene) -> Shapes:
        return [()]

    def profiles(self, where: int, scene: Scene) -> Profiles:
        lengths = [length for length in numbers_of(self.name, "lengths") if scene.way_mm < self.count * length]
        return [walk(self.count), *(smooth((0.0, scene.way_mm), length, self.count) for length in lengths)]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return along(where, cosines(np.clip(places.done, 0.0, 1.0), self.count))

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        size_mm = float(np.sqrt(np.square(found.sizes_mm).sum() / 2))
        yield Told("walk", say("measurement-wanders-mm-fix-what-measures", "XY"[found.where], f"{size_mm:.2f}"))
