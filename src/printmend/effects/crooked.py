"""A crooked or dented guide without a pattern: it pushes the head aside by a Gaussian process of the place on it."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Places, Scene, Term, Usual, along
from printmend.effects.prior import alternatives
from printmend.effects.uneven import COUNT, LENGTHS_MM, mirrored, spectrum
from printmend.effects.words import LEAST_SHOWN_MM, PLACES, Care, Fault, Found, Whole
from printmend.messages import say


class Crooked(Usual):
    """Cosines over the measured span of one bed axis, which push along the other."""

    name = "crooked"
    acts = Acts.WAVE
    keys = Whole()

    def terms(self, scene: Scene) -> Iterator[Term]:
        for axis in range(2):
            span = scene.bed_span_mm[axis]
            yield from alternatives(self.name, axis, [span], *(spectrum(span, each, COUNT) for each in LENGTHS_MM))

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return along(1 - where, mirrored(places.bed_mm[:, where], shape, COUNT))

    def rows(self, where: int, shape: tuple[float, ...], sizes_mm: np.ndarray) -> np.ndarray:
        """Return its waves as rows [K, 6] of a frame."""
        rates = np.zeros((COUNT, 2))
        rates[:, where] = np.pi * np.arange(1, COUNT + 1) / max(shape[1] - shape[0], 1.0)
        return plane_waves(rates, rates[:, where] * shape[0], 1 - where, sizes_mm)

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        place = np.linspace(found.shape[0], found.shape[1], PLACES)
        series = mirrored(place, found.shape, COUNT)
        size, sd = found.size(lambda sizes: float(np.abs(series @ sizes).max()))
        if size >= LEAST_SHOWN_MM:
            most, names = place[np.abs(series @ found.sizes_mm).argmax()], ("XY"[found.where], "XY"[1 - found.where])
            words = say("fault-crooked", *names, f"{size:.2f}", f"{most:.0f}")
            yield Fault("frame", "crooked", size, sd, "mm", words)

    def advice(self, fault: Fault, where: str) -> Care:
        """Return the meaning and the repair of a crooked guide."""
        title, meaning = say("guide-crooked-or-dented"), say("head-pushed-aside-mm", f"{abs(fault.value):.2f}")
        return Care(title, meaning, abs(fault.value), say("feel-along-guides"))


def plane_waves(rates: np.ndarray, phase_rad: np.ndarray, axis: int, sizes_mm: np.ndarray) -> np.ndarray:
    """Return waves cos(r·place − phase) [K] with rates r [K, 2] in rad/mm that push along an axis, as rows [K, 6]."""
    out = np.zeros((len(rates), 6))
    out[:, 0] = np.arctan2(rates[:, 1], rates[:, 0]) * 2 / np.pi
    out[:, 1] = 2 * np.pi / np.hypot(*rates.T)
    out[:, 2 + 2 * axis], out[:, 3 + 2 * axis] = sizes_mm * np.cos(phase_rad), sizes_mm * np.sin(phase_rad)
    return out
