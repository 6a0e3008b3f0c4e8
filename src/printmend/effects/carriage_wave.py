"""A wave from the screw or belt of a scanner's carriage, along one axis of the picture."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import GONE, Of, Places, Scene, Term, Usual, periods_apart_mm, waves
from printmend.effects.prior import alternatives, periods_of
from printmend.effects.words import Found, Told, Waves
from printmend.messages import say


class CarriageWave(Usual):
    """A wave along one axis of a picture. If that lies turned on the bed, the wave crosses those of a pulley at an
    angle. The instrument bounds its size. Two turned scans separate them."""

    name = "carriage_wave"
    of = Of.INSTRUMENT
    fate = GONE
    most = 2
    keys = Waves(shape=("period_mm",))

    def terms(self, scene: Scene) -> Iterator[Term]:
        if not (sd_mm := scene.instrument.carriage_mm):
            return
        for axis in range(2):
            periods = periods_of(self.name, scene.bed_span_mm[axis])
            yield from alternatives(self.name, axis, [(each,) for each in periods], (1.0, 1.0), sd_mm=sd_mm)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        way = scene.instrument.ways[where]
        return waves(places.bed_mm @ way, shape[0])[:, None, :] * way[:, None]

    def spacing(self, where: int, shape: tuple[float, ...], scene: Scene) -> tuple[float, ...]:
        return (periods_apart_mm(shape[0], scene.bed_span_mm[where]),)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        size_mm = float(np.linalg.norm(found.sizes_mm)) / 2**0.5
        message = "wave-of-scanner-carriage" if scene.instrument.is_settled else "wave-mm-scanner-carriage-makes-too"
        words = say(message, "XY"[found.where], f"{size_mm:.3f}")
        yield Told("carriage", words, is_harmless=True, may_be_printers=True)
