"""A scanner whose lens distorts, or whose sensor line is bowed: the error depends on the position along the sensor."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import GONE, Of, Places, Scene, Term, Usual
from printmend.effects.prior import alternatives, profile_of
from printmend.effects.words import LEAST_SHOWN, PLACES, Found, Numbers, Told
from printmend.messages import say
from printmend.path import distorted


class Lens(Usual):
    """Square and cube of the place along one axis of a picture, and its square across. How large they may be is the
    instrument's: scans at two turns tell it."""

    name = "lens"
    of = Of.INSTRUMENT
    fate = GONE
    keys = Numbers(("square_mm", "cube_mm", "across_mm"))

    def terms(self, scene: Scene) -> Iterator[Term]:
        if sd_mm := scene.instrument.lens_mm:
            for axis in range(2):
                yield from alternatives(self.name, axis, [()], profile_of(self.name), sd_mm=sd_mm)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return distorted(places.bed_mm - np.mean(scene.bed_span_mm, axis=1), where)

    def told(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Told]:
        off_mm = np.zeros((PLACES, 2))
        off_mm[:, found.where] = np.linspace(-0.5, 0.5, PLACES) * np.ptp(scene.bed_span_mm[found.where])
        moved, line = distorted(off_mm, found.where) @ found.sizes_mm, np.hstack([np.ones((PLACES, 1)), off_mm])
        size_mm = float(np.hypot(*(moved - line @ np.linalg.lstsq(line, moved, rcond=None)[0]).T).max())
        if size_mm >= LEAST_SHOWN:
            words = say("scanner-lens-distorts-along-up", "XY"[found.where], f"{size_mm:.2f}")
            yield Told("lens", words, is_harmless=True, may_be_printers=True)
