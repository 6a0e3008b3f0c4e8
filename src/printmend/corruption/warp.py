"""An error that repeats nothing: a belt of uneven pitch, a rail that was hammered straight."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from printmend.corruption.check import in_range, refuse
from printmend.messages import say


@dataclass(frozen=True)
class Warp:
    """The carriage is off by e(m) = Σ_i ``bumps_mm[i]`` · exp(−(m − c_i)²/2w²), c_i = ``first_mm`` + i·w, at place m.

    w = ``spacing_mm``. Smooth, of no period, the same in both directions. The slope of e must stay above −0.9, lest
    the carriage run backwards.
    """

    bumps_mm: tuple[float, ...]
    spacing_mm: float
    first_mm: float = 0.0
    kind: ClassVar[str] = "warp"

    def __post_init__(self) -> None:
        in_range(self, bumps_mm=(-100.0, 100.0), spacing_mm=(1.0, 10_000.0), first_mm=(-10_000.0, 10_000.0))
        if not 1 <= len(self.bumps_mm) <= 10_000:
            refuse(self, say("1-10-000-bumps"), f"{len(self.bumps_mm)}")
        low_mm, high_mm = (
            self.first_mm - 4 * self.spacing_mm,
            self.first_mm + (len(self.bumps_mm) + 3) * self.spacing_mm,
        )
        places = np.linspace(low_mm, high_mm, 20 * (len(self.bumps_mm) + 7) + 1)
        steepest = float(np.gradient(self.error_mm(places), places).min())
        if steepest < -0.9:
            refuse(self, say("bumps-slopes-above-0-9-everywhere"), f"{steepest:.2f}")

    def error_mm(self, motor_mm: np.ndarray) -> np.ndarray:
        """Return e [mm] at nominal places [N] mm."""
        error = np.zeros(np.shape(motor_mm))
        for i, bump in enumerate(self.bumps_mm):
            away = (motor_mm - self.first_mm) / self.spacing_mm - i
            near = np.abs(away) < 8  # exp(−32) is below 1e-13
            error[near] += bump * np.exp(-(away[near] ** 2) / 2)
        return error
