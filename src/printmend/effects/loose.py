"""A loose nozzle or head: it lags behind every move, by the same amount in every direction."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Places, Scene, Usual
from printmend.effects.words import Found, Told
from printmend.messages import say


class Loose(Usual):
    """Play that is round: the head is behind by half of it, along the last move."""

    name = "loose"
    positive = True

    def carriers(self, scene: Scene) -> range:
        return range(all(high > low for low, high in scene.bed_span_mm))  # along one line it is the same as play

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return -0.5 * places.headings()[:, :, None]

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        yield Told("loose", say("head-loose-lags-every-way", f"{abs(found.sizes_mm[0]):.2f}"))
