"""A learned Z screw in few numbers: what is kept of it in a saved model (physics.md eq. 15)."""

from dataclasses import dataclass, replace

import numpy as np

from printmend.machine import ScrewDrive, Transmission, healthy_mechanism, z_grid_mm
from printmend.printer import Printer
from printmend.units import TURN_RAD

HARMONICS = 2  # waves of a screw's turn that are kept, of the height and of the push


@dataclass(frozen=True, eq=False)
class ScrewSeries:
    """A screw in few numbers: ``height_mm`` [2·HARMONICS] = (a_1, b_1, a_2, …), and ``push_mm`` [2·HARMONICS, 2] =
    (p_1, q_1, …) for x and y."""

    lead_mm: float
    lead_error: float
    backlash_mm: float
    height_mm: np.ndarray
    push_mm: np.ndarray

    @classmethod
    def healthy(cls, lead_mm: float) -> "ScrewSeries":
        return cls(lead_mm, 0.0, 0.0, np.zeros(2 * HARMONICS), np.zeros((2 * HARMONICS, 2)))

    def tables(self, printer: Printer) -> ScrewDrive:
        """Return it as tables on the micro-steps of Z, without an origin."""
        motor_mm, first_mm, pitch_mm = z_grid_mm(printer)
        waves = waves_of(motor_mm, self.lead_mm, HARMONICS)
        error_mm = self.lead_error * motor_mm + waves @ self.height_mm
        centre = np.maximum.accumulate(motor_mm + error_mm)
        half_mm = self.backlash_mm / 2
        return ScrewDrive(Transmission(first_mm, pitch_mm, centre - half_mm, centre + half_mm), waves @ self.push_mm)

    def lower(self, printer: Printer) -> ScrewDrive:
        """Return it as tables, its origin where the end stop of Z puts it."""
        homed = replace(healthy_mechanism(printer), screw=self.tables(printer)).homed().screw
        assert homed is not None
        return homed


def waves_of(place_mm: np.ndarray, period_mm: float, harmonics: int) -> np.ndarray:
    """Return the columns [N, 2·harmonics] sin θ, cos θ, sin 2θ, … of the turns at places [N]."""
    angle = np.asarray(place_mm, float)[:, None] * (TURN_RAD / period_mm) * np.arange(1, harmonics + 1)
    return np.stack([np.sin(angle), np.cos(angle)], axis=2).reshape(len(angle), -1)
