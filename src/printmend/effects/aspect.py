"""One axis of a CoreXY's bed that is stretched: both motors turn for it, so that no pulley explains it."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import SCALE_MM, STAYS, Acts, Of, Places, Scene, Term, along
from printmend.effects.prior import alternatives
from printmend.effects.words import Fault, Found, amount, is_first, those_of


class Aspect:
    """An error that grows evenly along one bed axis, in mm per 100 mm; on other printers it is the motor's."""

    name = "aspect"
    of = Of.MACHINE
    acts = Acts.FRAME
    from_home = True
    fate = STAYS
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        for axis in range(2 * scene.corexy):
            yield from alternatives(self.name, axis, [()], (1.0,))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        own = (places.bed_mm[:, where] - scene.middle_mm[where]) / SCALE_MM
        return along(where, own[:, None])

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        if is_first(found, (self.name,), beside):
            ways = [(each, 1 - 2 * each.where) for each in those_of(self.name, beside)]
            percent = float(sum(way * each.sizes_mm[0] for each, way in ways))  # mm in 100 mm
            sd = float(np.std(sum(way * each.draws_mm[0] for each, way in ways)))
            way = "larger" if percent > 0 else "smaller"
            words = f"X prints {amount(abs(percent), sd, '%')} {way} than Y"
            yield Fault("frame", "axes", percent, sd, "%", words)
