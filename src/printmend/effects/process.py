"""Errors without a pattern: Gaussian processes of a position or of time, as cosines over the measured span.

Over a span of length L they are cos(πks), s from 0 to 1, with sizes by the spectral density at πk/L (Solin & Särkkä
2020, Hilbert space methods for reduced-rank Gaussian process regression).
"""

import numpy as np

from printmend.effects.effect import TINY_MM, Acts, Profiles, Scene, Shapes, Usual, held
from printmend.effects.prior import number_of, numbers_of
from printmend.effects.words import Whole

LEAST_SPAN_MM = 1.0  # a shorter span counts as so long


class Process(Usual):
    """A smooth process of a motor's position or, for the waves of a frame, of the position along a bed axis.

    Its shape is the measured span. The table of priors gives the number of its cosines, and an alternative for each
    length.
    """

    keys = Whole()

    @property
    def count(self) -> int:
        """How many cosines it has."""
        return int(number_of(self.name, "cosines"))

    def shapes(self, where: int, scene: Scene) -> Shapes:
        return [(scene.bed_span_mm if self.acts is Acts.WAVE else scene.motor_span_mm)[where]]

    def profiles(self, where: int, scene: Scene) -> Profiles:
        ((low, high),) = self.shapes(where, scene)
        return [smooth((low, high), length, self.count) for length in numbers_of(self.name, "lengths")]

    def series(self, place_mm: np.ndarray, span_mm: tuple[float, ...]) -> np.ndarray:
        """Return its cosines [N, K] at places [N]; beyond the span they stay as they are at its ends."""
        return cosines(share_of_span(held(place_mm, span_mm), span_mm), self.count)


def share_of_span(place_mm: np.ndarray, span_mm: tuple[float, ...]) -> np.ndarray:
    """Return how far along a span places [N] are, 0 to 1 within it."""
    low, high = span_mm
    return np.asarray((place_mm - low) / max(high - low, LEAST_SPAN_MM))


def cosines(share: np.ndarray, count: int) -> np.ndarray:
    """Return the first ``count`` cosines [N, K] at shares [N] of a span; beyond it they repeat, mirrored."""
    return np.asarray(np.cos(np.pi * share[:, None] * np.arange(1, count + 1)))


def rates_rad(span_mm: tuple[float, ...], count: int) -> np.ndarray:
    """Return the rates [K] of a span's cosines, in rad/mm."""
    low, high = span_mm
    return np.asarray(np.pi * np.arange(1, count + 1) / max(high - low, LEAST_SPAN_MM))


def smooth(span_mm: tuple[float, float], length_mm: float, count: int) -> tuple[float, ...]:
    """Return the sizes [K] of a span's cosines in a smooth process of unit size: its kernel is exp(−d²/2ℓ²)."""
    low, high = span_mm
    falls = np.exp(-((rates_rad(span_mm, count) * length_mm) ** 2) / 2)
    power = 2 * length_mm * np.sqrt(2 * np.pi) / max(high - low, LEAST_SPAN_MM) * falls
    return tuple(np.sqrt(np.maximum(power, TINY_MM**2)))


def walk(count: int) -> tuple[float, ...]:
    """Return the sizes [K] of a random walk's cosines: their power falls with the square of the rate."""
    return tuple(1.0 / np.arange(1, count + 1))


def plane_waves(rates: np.ndarray, phase_rad: np.ndarray, axis: int, sizes_mm: np.ndarray) -> np.ndarray:
    """Return waves cos(r·place − phase) [K] with rates r [K, 2] in rad/mm that push along an axis, as rows [K, 6]."""
    out = np.zeros((len(rates), 6))
    out[:, 0] = np.arctan2(rates[:, 1], rates[:, 0]) * 2 / np.pi
    out[:, 1] = 2 * np.pi / np.hypot(*rates.T)
    out[:, 2 + 2 * axis], out[:, 3 + 2 * axis] = sizes_mm * np.cos(phase_rad), sizes_mm * np.sin(phase_rad)
    return out
