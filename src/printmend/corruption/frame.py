"""A crooked frame: skew, axis scale, rails that are not straight (physics.md eq. 14)."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from printmend.corruption.check import in_range
from printmend.machine import Frame
from printmend.units import TURN_RAD


@dataclass(frozen=True)
class CrookedFrame:
    """x' = x + y tan γ + … about the bed's middle.

    ``x_bow_mm``: how far the X coordinate is pushed at the ends of Y travel (at y = middle ± 100 mm);
    ``y_bow_mm`` likewise. A wavy rail pushes X by ``x_wave_mm`` sin(2πy/``x_wave_period_mm`` + ``x_wave_phase_rad``),
    y from the bed's middle; ``y_wave_mm`` likewise pushes Y along x.
    """

    skew_deg: float = 0.0
    x_scale: float = 1.0
    y_scale: float = 1.0
    x_bow_mm: float = 0.0
    y_bow_mm: float = 0.0
    x_wave_mm: float = 0.0
    x_wave_period_mm: float = 150.0
    x_wave_phase_rad: float = 0.0
    y_wave_mm: float = 0.0
    y_wave_period_mm: float = 150.0
    y_wave_phase_rad: float = 0.0
    kind: ClassVar[str] = "frame"

    def __post_init__(self) -> None:
        in_range(
            self,
            skew_deg=(-20.0, 20.0),
            x_scale=(0.5, 2.0),
            y_scale=(0.5, 2.0),
            x_bow_mm=(-10.0, 10.0),
            y_bow_mm=(-10.0, 10.0),
            x_wave_mm=(-2.0, 2.0),
            x_wave_period_mm=(40.0, 1000.0),
            x_wave_phase_rad=(-10.0, 10.0),
            y_wave_mm=(-2.0, 2.0),
            y_wave_period_mm=(40.0, 1000.0),
            y_wave_phase_rad=(-10.0, 10.0),
        )

    def lower(self, middle_mm: tuple[float, float]) -> Frame:
        """Return the frame map; bows are measured from the bed's middle ``middle_mm``."""
        scale_mm = 100.0
        x0, y0 = middle_mm[0] / scale_mm, middle_mm[1] / scale_mm
        coefficients = np.zeros((2, len(Frame.exponents)))
        at = Frame.exponents.index
        coefficients[0, at((1, 0))] = (self.x_scale - 1) * scale_mm
        coefficients[1, at((0, 1))] = (self.y_scale - 1) * scale_mm
        coefficients[0, at((0, 1))] = math.tan(math.radians(self.skew_deg)) * scale_mm
        # bow·(y − y0)², expanded
        coefficients[0, at((0, 2))] += self.x_bow_mm
        coefficients[0, at((0, 1))] += -2 * y0 * self.x_bow_mm
        coefficients[0, at((0, 0))] += y0**2 * self.x_bow_mm
        coefficients[1, at((2, 0))] += self.y_bow_mm
        coefficients[1, at((1, 0))] += -2 * x0 * self.y_bow_mm
        coefficients[1, at((0, 0))] += x0**2 * self.y_bow_mm
        rails = (
            (0, 1, self.x_wave_mm, self.x_wave_period_mm, self.x_wave_phase_rad),
            (1, 0, self.y_wave_mm, self.y_wave_period_mm, self.y_wave_phase_rad),
        )
        waves = np.zeros((0, 6))
        for pushed, along, size_mm, period_mm, phase_rad in rails:
            if size_mm:
                angle = phase_rad - TURN_RAD * middle_mm[along] / period_mm
                wave = np.array([along, period_mm, 0.0, 0.0, 0.0, 0.0])
                wave[2 + 2 * pushed : 4 + 2 * pushed] = size_mm * math.sin(angle), size_mm * math.cos(angle)
                waves = np.vstack([waves, wave])
        return Frame(coefficients, scale_mm, waves)
