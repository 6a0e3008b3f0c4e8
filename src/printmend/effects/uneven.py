"""A belt or guide with an error that has no period: a Gaussian process of the place along the axis."""

from collections.abc import Iterator, Sequence

import numpy as np

from printmend.effects.effect import Acts, Places, Scene, Term, Usual, held, onto_bed
from printmend.effects.prior import alternatives
from printmend.effects.words import LEAST_SHOWN_MM, Care, Fault, Found, Whole, along_motor_mm, motor_name, where_seen
from printmend.messages import say

COUNT = 40  # cosines: over 200 mm the shortest is 10 mm long
LENGTHS_MM = (4.0, 8.0, 16.0, 32.0, 64.0)
LEAST_POWER = 1e-24  # of a cosine: each has some size, and one of this size is written in no model


class Uneven(Usual):
    """Cosines over the span that was seen, with a smooth process's spectrum of one length (Solin & Särkkä 2020)."""

    name = "uneven"
    kinds = ("warp",)
    acts = Acts.DRIVE
    keys = Whole()

    def terms(self, scene: Scene) -> Iterator[Term]:
        for motor in range(2):
            span = scene.motor_span_mm[motor]
            profiles = (spectrum(span, length, COUNT) for length in LENGTHS_MM)
            yield from alternatives(self.name, motor, [span], *profiles)

    def columns(self, places: Places, where: int, shape: tuple[float, ...], scene: Scene) -> np.ndarray:
        return onto_bed(scene, where, cosines(places.motor_mm[:, where], shape, COUNT))

    def faults(self, found: Found, beside: Sequence[Found], scene: Scene) -> Iterator[Fault]:
        series = cosines(along_motor_mm(scene, found.where), found.shape, COUNT)
        size, sd = found.size(lambda sizes: float(np.abs(series @ sizes).max()))
        if size >= LEAST_SHOWN_MM:
            words = say("fault-uneven", f"{size:.2f}")
            yield Fault(motor_name(scene, found.where), "warp", size, sd, "mm", words)

    def advice(self, fault: Fault, where: str) -> Care:
        """Return how far lines swing, and which part may be worn."""
        size_mm = abs(fault.value)
        title, meaning = (
            say("runs-unevenly-along-way", where),
            say("along-print-swings-up-mm-same", where, f"{size_mm:.2f}"),
        )
        return Care(title, meaning, size_mm, where_seen(size_mm, say("look-along-belt-worn-stretched-stretch")))


def cosines(place_mm: np.ndarray, span_mm: tuple[float, ...], count: int) -> np.ndarray:
    """Return so many cosines over a span [N, K] at places [N]; beyond it they go on as they end."""
    return mirrored(held(place_mm, span_mm), span_mm, count)


def mirrored(place_mm: np.ndarray, span_mm: tuple[float, ...], count: int) -> np.ndarray:
    """Return so many cosines over a span [N, K] at places [N]; beyond it they come back."""
    low, high = span_mm
    share = (place_mm - low) / max(high - low, 1.0)
    return np.asarray(np.cos(np.pi * share[:, None] * np.arange(1, count + 1)))


def spectrum(span_mm: tuple[float, float], length_mm: float, count: int) -> tuple[float, ...]:
    """Return the sizes [K] of a span's cosines in a smooth process of unit size and some length."""
    low, high = span_mm
    waves_rad = np.pi * np.arange(1, count + 1) / max(high - low, 1.0)
    power = 2 * length_mm * np.sqrt(2 * np.pi) / max(high - low, 1.0) * np.exp(-((waves_rad * length_mm) ** 2) / 2)
    return tuple(np.sqrt(np.maximum(power, LEAST_POWER)))
