"""A sheet or a plate that came loose: it shifts and turns as a whole, at one moment of the print."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import GONE, Places, Scene, along_both
from printmend.effects.step import AtOneMoment
from printmend.effects.turn import about_middle, degrees_of
from printmend.effects.words import Found, Numbers, Told
from printmend.messages import say


class Sheet(AtOneMoment):
    """A shift along both axes and a turn about the middle of the bed, in mm per 100 mm, from one moment on."""

    name = "sheet"
    fate = GONE  # once it is clipped
    keys = Numbers(("x_mm", "y_mm", "angle_deg"), ("at_share",))

    def carriers(self, scene: Scene) -> range:
        return range(1)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        moved = np.concatenate([along_both(np.ones((len(places), 1))), about_middle(places, scene)], axis=2)
        return np.asarray(moved * (places.done > shape[0])[:, None, None])

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        x_mm, y_mm, turn = found.sizes_mm
        moved = f"{x_mm:+.2f}", f"{y_mm:+.2f}", degrees_of(turn)
        yield Told("sheet", say("sheet-moved", *moved, f"{100 * found.shape[0]:.0f}"))
