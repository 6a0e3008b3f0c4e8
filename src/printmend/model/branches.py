"""The learned drive of one motor as a short, readable set of numbers, and the tables they lower to.

With the motor at m, x = (m − middle)/100 mm and φ = 2πm/turn, the branches of the generalised play are

    lower(m) = m + mean(m) − play(m)/2          upper(m) = m + mean(m) + play(m)/2

    mean(m) = Σ_p c_p xᵖ + Σ_k a_k cos kφ + b_k sin kφ + x Σ_k (e_k cos kφ + f_k sin kφ)
    play(m) = Σ_p d_p xᵖ + Σ_k g_k cos kφ + h_k sin kφ,   never below zero

The harmonics of ``mean`` are the pulley (physics.md eq. 2), those of ``play`` the two spans of a loose belt (eq. 7) or
slack on the shaft (eq. 10), the powers in ``play`` lost motion by friction (eq. 9), and the third sum of ``mean`` a
taut elastic belt, whose odd harmonics fade with the distance (eq. 8). An error without a period (a belt of uneven
pitch) is a sum of cosines over the measured span, added to the mean. An error with another period than the turn (an
idler off its centre) is a Fourier series of that period.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.polynomial.chebyshev import chebval

from printmend.machine import Transmission, healthy_transmission
from printmend.path import frozen
from printmend.printer import Printer
from printmend.units import TURN_RAD

SCALE_MM = 100.0  # distance from the middle at which x, in which the powers are taken, is 1


def warp_angle(span_mm: tuple[float, float], motor_mm: np.ndarray) -> np.ndarray:
    """Return π t [N], t the place within ``span_mm``; beyond it the ends hold."""
    return np.asarray(np.pi * np.clip((motor_mm - span_mm[0]) / (span_mm[1] - span_mm[0]), 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class Wave:
    """A polynomial and a Fourier series: ``powers_mm`` [P], ``harmonics`` [H] and their ``cos_mm``, ``sin_mm`` [H]."""

    powers_mm: np.ndarray = field(default_factory=lambda: np.zeros(0))
    harmonics: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    cos_mm: np.ndarray = field(default_factory=lambda: np.zeros(0))
    sin_mm: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        for name in ("powers_mm", "cos_mm", "sin_mm"):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), float)))
        object.__setattr__(self, "harmonics", frozen(np.asarray(self.harmonics, np.int64)))

    @property
    def is_zero(self) -> bool:
        return not (self.powers_mm.any() or self.cos_mm.any() or self.sin_mm.any())

    def polynomial_mm(self, x: np.ndarray) -> np.ndarray:
        """Return Σ c_p xᵖ [N]."""
        total = np.zeros(np.shape(x))
        for value in self.powers_mm[::-1]:
            total = total * x + value
        return total

    def series_mm(self, phase_rad: np.ndarray) -> np.ndarray:
        """Return the Fourier sum [N] at phases of the motor's turn."""
        total = np.zeros(np.shape(phase_rad))
        for k, cos_mm, sin_mm in zip(self.harmonics, self.cos_mm, self.sin_mm, strict=True):
            if cos_mm or sin_mm:
                total += cos_mm * np.cos(k * phase_rad) + sin_mm * np.sin(k * phase_rad)
        return total


@dataclass(frozen=True, eq=False)
class Branches:
    """The fault of one motor's drive. ``reach_mm`` are the measured motor positions. Beyond them, powers above the
    first continue as straight lines, so that they do not explode."""

    period_mm: float
    middle_mm: float
    reach_mm: tuple[float, float]
    mean: Wave = field(default_factory=Wave)
    play: Wave = field(default_factory=Wave)
    elastic: Wave = field(default_factory=Wave)
    warp_mm: np.ndarray = field(default_factory=lambda: np.zeros(0))
    warp_span_mm: tuple[float, float] = (0.0, 1.0)
    second: Wave = field(default_factory=Wave)
    second_mm: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "warp_mm", frozen(np.asarray(self.warp_mm, float)))

    @property
    def is_healthy(self) -> bool:
        waves = (self.mean, self.play, self.elastic, self.second)
        return all(wave.is_zero for wave in waves) and not self.warp_mm.any()

    def shifted(self, by_mm: float) -> "Branches":
        """Move the carriage's origin: add ``by_mm`` to all places, as `Transmission.shifted` does."""
        powers = self.mean.powers_mm if len(self.mean.powers_mm) else np.zeros(1)
        powers = np.concatenate([powers[:1] + by_mm, powers[1:]])
        return replace(self, mean=replace(self.mean, powers_mm=powers))

    def errors_mm(self, motor_mm: np.ndarray, *, turn: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Return (mean, play) [mm] at motor positions [N]: what the drive adds to a healthy motor, and its play ≥ 0.

        Where the positions are evenly spaced with a whole number of ``turn`` entries a turn, one turn is evaluated.
        """
        x = (motor_mm - self.middle_mm) / SCALE_MM
        count = round(turn) if abs(turn - round(turn)) < 1e-9 and 0 < turn < len(motor_mm) else len(motor_mm)
        phase = np.mod(motor_mm[:count], self.period_mm) * (TURN_RAD / self.period_mm)

        def series(wave: Wave) -> np.ndarray:
            return np.resize(wave.series_mm(phase), len(motor_mm))

        mean = self._powers_mm(self.mean, motor_mm) + series(self.mean)
        if self.warp_mm.any():
            # An error without a period is known only where it was measured.
            angle = warp_angle(self.warp_span_mm, np.clip(motor_mm, *self.reach_mm))
            mean = mean + chebval(np.cos(angle), [0.0, *self.warp_mm])  # T_k(cos θ) = cos kθ
        if not self.elastic.is_zero:
            mean = mean + x * series(self.elastic)
        if not self.second.is_zero:
            mean = mean + self.second.series_mm(np.mod(motor_mm, self.second_mm) * (TURN_RAD / self.second_mm))
        play = self._powers_mm(self.play, motor_mm) + series(self.play)
        return mean, np.maximum(play, 0.0)

    def _powers_mm(self, wave: Wave, motor_mm: np.ndarray) -> np.ndarray:
        x = (motor_mm - self.middle_mm) / SCALE_MM
        if len(wave.powers_mm) < 3:
            return wave.polynomial_mm(x)
        inside = np.clip(
            x, (self.reach_mm[0] - self.middle_mm) / SCALE_MM, (self.reach_mm[1] - self.middle_mm) / SCALE_MM
        )
        slope = Wave(wave.powers_mm[1:] * np.arange(1, len(wave.powers_mm)))
        return wave.polynomial_mm(inside) + (x - inside) * slope.polynomial_mm(inside)

    def lower(self, printer: Printer, motor: int) -> Transmission:
        """Return the tables of this drive on the grid of a healthy transmission; both are made non-decreasing."""
        healthy = healthy_transmission(printer, motor)
        if self.is_healthy:
            return healthy
        grid = healthy.motor_mm
        mean, play = self.errors_mm(grid, turn=self.period_mm / healthy.pitch_mm)
        first = int(np.searchsorted(grid, (self.reach_mm[0] + self.reach_mm[1]) / 2))
        lower = rising(grid + mean - play / 2, first)
        if not play.any():
            return replace(healthy, lower_mm=lower, upper_mm=lower)
        return replace(healthy, lower_mm=lower, upper_mm=np.maximum(rising(grid + mean + play / 2, first), lower))


def rising(table_mm: np.ndarray, first: int) -> np.ndarray:
    """Return a table [N] made non-decreasing from entry ``first`` outwards, so that a faulty end does not spread."""
    first = min(max(first, 0), len(table_mm))
    below = np.minimum.accumulate(table_mm[:first][::-1])[::-1]
    above = np.maximum.accumulate(table_mm[first:])
    return np.concatenate([np.minimum(below, above[0]) if len(above) else below, above])
