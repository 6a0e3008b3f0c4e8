"""Lost motion that builds up over some millimetres after a reversal, as when a cable or a wheel winds up, or a head
tilts."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Places, Scene, Shapes, Usual, onto_bed
from printmend.effects.prior import apart_of, numbers_of
from printmend.effects.words import Found, Numbers, Told, carrier_name
from printmend.messages import say


class SoftPlay(Usual):
    """Friction against a spring (Dahl 1968): after a reversal a belt falls behind by degrees, over a length; below 0 it
    runs ahead, as the tip of a head does that tilts.

    Its lag z, from −1 to 1 of half the size, follows dz/ds = (±1 − z)/length along the motor's way s. After strokes
    that ended c₁ < c₂ < … mm ago it is ±(1 − 2 exp(−c₁/length) + 2 exp(−c₂/length) − …). The last known stroke counts
    by half, as if the ones before it had as likely brought 0 as 2.
    """

    name = "soft_play"
    at_motors = True
    keys = Numbers(("size_mm",), ("length_mm",))

    def shapes(self, where: int, scene: Scene) -> Shapes:
        return [(length_mm,) for length_mm in numbers_of(self.name, "lengths")]

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        lag = 0.5 * places.side[:, where].astype(float)
        if places.strokes_mm is not None:
            left = np.exp(-places.strokes_mm[:, where] / shape[0])
            signs = 2.0 * (-1.0) ** np.arange(1, left.shape[1] + 1)
            signs[-1] /= 2
            lag *= 1 + left @ signs
        return onto_bed(scene, where, lag[:, None])

    def spacing(self, where: int, shape: tuple[float, ...], scene: Scene) -> tuple[float, ...]:
        return (apart_of(self.name, "lengths", shape[0]),)

    def is_possible(self, where: int, shape: tuple[float, ...], scene: Scene) -> bool:
        return shape[0] >= min(numbers_of(self.name, "lengths"))

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        size, most = float(found.sizes_mm[0]), f"{2 * found.shape[0]:.0f}"
        message = "falls-behind-by-degrees" if size > 0 else "runs-ahead-by-degrees"
        yield Told("soft-play", say(message, carrier_name(scene, found.where), f"{abs(size):.2f}", most))
