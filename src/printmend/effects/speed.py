"""An error of long, fast moves that short ones do not have."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import LONG_MM, Places, Scene, Shapes, Usual, onto_bed
from printmend.effects.words import Found, Numbers, Told, carrier_name
from printmend.messages import say


class Speed(Usual):
    """Play that grows with the length of the last move, to its whole size at the longest that led to a mark, or at
    `LONG_MM`."""

    name = "speed"
    at_motors = True
    keys = Numbers(("size_mm",), ("long_mm",))

    def shapes(self, where: int, scene: Scene) -> Shapes:
        return [(scene.longest_mm,)]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        (long_mm,) = shape or (LONG_MM,)  # files of older versions have no shape
        fast = np.minimum(places.move_mm / long_mm, 1.0)
        return onto_bed(scene, where, (0.5 * places.side[:, where] * fast)[:, None])

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        size = float(found.sizes_mm[0])
        message = "lies-mm-further-back-after-long" if size > 0 else "lies-mm-further-after-long-fast"
        yield Told("speed", say(message, carrier_name(scene, found.where), f"{abs(size) / 2:.2f}"))
