"""An error of long, fast moves that short ones do not have."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import LONG_MM, Places, Scene, Usual, onto_bed
from printmend.effects.words import Found, Told, carrier_name
from printmend.messages import say


class Speed(Usual):
    """Play that grows with the length of the last move, to its whole size at `LONG_MM`."""

    name = "speed"
    at_motors = True

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        fast = np.minimum(places.move_mm / LONG_MM, 1.0)
        return onto_bed(scene, where, (0.5 * places.side[:, where] * fast)[:, None])

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        size = float(found.sizes_mm[0])
        message = "lies-mm-further-back-after-long" if size > 0 else "lies-mm-further-after-long-fast"
        yield Told("speed", say(message, carrier_name(scene, found.where), f"{abs(size) / 2:.2f}"))
