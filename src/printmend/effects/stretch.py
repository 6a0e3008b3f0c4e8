"""What an instrument does not know of itself: its scale, the difference of its axes' scales, their lean."""

from collections.abc import Iterator

import numpy as np

from printmend.effects.effect import GONE, Acts, Of, Places, Scene, Term

ALWAYS = 1e3  # logarithm of its odds: no instrument is exact, though its picture may look so


class Stretch:
    """A linear error of the picture, as uncertain as the instrument says."""

    name = "stretch"
    of = Of.INSTRUMENT
    acts = Acts.NOT
    from_home = True
    fate = GONE
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        if scene.instrument.covariance.any():
            yield Term(self.name, 0, (), (1.0, 1.0, 1.0), ALWAYS)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        values, axes = np.linalg.eigh(scene.instrument.covariance)
        x, y = (places.bed_mm - scene.middle_mm).T
        scale, half, lean = np.stack([x, y], axis=1), np.stack([x, -y], axis=1), np.stack([y, x], axis=1)
        return np.stack([scale, half, lean], axis=2) @ (axes * np.sqrt(np.maximum(values, 0.0)))

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())
