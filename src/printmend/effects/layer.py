"""Layers that are offset from one another, each by its own amount."""

import numpy as np

from printmend.effects.effect import MOST_LAYERS, OTHERWISE, Of, Places, Profiles, Scene, Shapes, Usual, along
from printmend.effects.words import Whole


class Layer(Usual):
    """A shift of each layer along one bed axis; its shape is the lowest and the highest layer, and how many."""

    name = "layer"
    of = Of.SESSION
    fate = OTHERWISE
    keys = Whole()

    def carriers(self, scene: Scene) -> range:
        return range(2 if scene.layers else 0)

    def shapes(self, where: int, scene: Scene) -> Shapes:
        return [scene.layers]

    def profiles(self, where: int, scene: Scene) -> Profiles:
        return [np.ones(int(scene.layers[2]))]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        low_mm, high_mm, count = shape
        if not 0 < count <= MOST_LAYERS:
            raise ValueError(count)
        pitch_mm = (high_mm - low_mm) / max(count - 1, 1)
        number = np.round((places.heights_mm(scene) - low_mm) / pitch_mm) % count
        return along(where, (number[:, None] == np.arange(count)).astype(float))
