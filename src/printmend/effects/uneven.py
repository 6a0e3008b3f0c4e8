"""A belt or guide whose error along the axis repeats nothing: a Gaussian process of its place."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import STAYS, Acts, Of, Places, Scene, Term, Usual, held, onto_bed
from printmend.effects.keys import Whole
from printmend.effects.prior import alternatives
from printmend.effects.words import LEAST_SHOWN_MM, Fault, Found, along_motor_mm, motor_name

COUNT = 40  # cosines: over 200 mm the shortest is 10 mm long
LENGTHS_MM = (4.0, 8.0, 16.0, 32.0, 64.0)


class Uneven(Usual):
    """Cosines over the span that was seen, with a smooth process's spectrum of one length (Solin & Särkkä 2020)."""

    name = "uneven"
    of = Of.MACHINE
    acts = Acts.DRIVE
    fate = STAYS
    keys = Whole()

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            low, high = scene.motor_span_mm[motor]
            waves_rad = np.pi * np.arange(1, COUNT + 1) / max(high - low, 1.0)
            profiles = []
            for length in LENGTHS_MM:
                power = (
                    2 * length * np.sqrt(2 * np.pi) / max(high - low, 1.0) * np.exp(-((waves_rad * length) ** 2) / 2)
                )
                profiles.append(tuple(np.sqrt(np.maximum(power, 1e-12))))
            yield from alternatives(self.name, motor, [(low, high)], *profiles)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        low, high = shape
        place = (held(places.motor_mm[:, where], shape) - low) / max(high - low, 1.0)
        return onto_bed(scene, where, np.cos(np.pi * place[:, None] * np.arange(1, COUNT + 1)))

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        place = (along_motor_mm(scene, found.where) - found.shape[0]) / max(found.shape[1] - found.shape[0], 1.0)
        series = np.cos(np.pi * place[:, None] * np.arange(1, COUNT + 1))
        size, sd = found.size(lambda sizes: float(np.abs(series @ sizes).max()))
        if size >= LEAST_SHOWN_MM:
            words = f"uneven belt or guide that repeats nothing, up to {size:.2f} mm"
            yield Fault(motor_name(scene, found.where), "warp", size, sd, "mm", words)
