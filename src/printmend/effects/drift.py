"""A belt, or on a CoreXY an axis, that shifts evenly while it prints."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Of, Places, Scene, Term, carrier
from printmend.effects.prior import alternatives
from printmend.effects.words import Found, Message, Told, carrier_name

STAYS = 0.4  # chance that it is there in the next print: an end stop that moved stays, a slipped motor is homed

DRIFTED = Message("{a} drifted evenly during the print, by {b} mm from the first point to the last")


class Drift:
    """A shift that grows with the length printed."""

    name = "drift"
    of = Of.SESSION
    acts = Acts.NOT
    from_home = True
    most = 1

    def terms(self, scene: Scene) -> Iterator[Term]:
        for where in range(4 if scene.corexy else 2):
            yield from alternatives(self.name, where, [()], (1.0,))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        course = places.done
        return carrier(scene, where, course[:, None])

    def finer(self, shape: tuple[float, ...], round_: int) -> Iterator[tuple[float, ...]]:
        return iter(())

    def again(self, sizes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return sizes * (rng.uniform(size=sizes.shape[1]) < STAYS)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        yield Told("linear", DRIFTED(carrier_name(scene, found.where), f"{found.sizes_mm[0]:+.2f}"))
