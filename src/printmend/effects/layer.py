"""Layers that are offset from one another, each by its own amount."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import MOST_LAYERS, OTHERWISE, Of, Places, Scene, Term, Usual, along
from printmend.effects.prior import alternatives
from printmend.effects.words import Whole


class Layer(Usual):
    """A shift of each layer along one bed axis; its shape is the lowest and the highest layer, and how many."""

    name = "layer"
    of = Of.SESSION
    fate = OTHERWISE
    keys = Whole()

    def terms(self, scene: Scene) -> Iterator[Term]:
        if scene.layers:
            for axis in range(2):
                yield from alternatives(self.name, axis, [scene.layers], (1.0,) * int(scene.layers[2]))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        low_mm, high_mm, count = shape
        if not 0 < count <= MOST_LAYERS:
            raise ValueError(count)
        pitch_mm = (high_mm - low_mm) / max(count - 1, 1)
        number = np.round((places.heights_mm(scene) - low_mm) / pitch_mm) % count
        return along(where, (number[:, None] == np.arange(count)).astype(float))
