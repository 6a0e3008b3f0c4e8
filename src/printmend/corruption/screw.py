"""A bad Z screw: wrong lead, periodic error, backlash, wobble that pushes layers about (physics.md eq. 15)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from printmend.corruption.check import in_range, refuse
from printmend.machine import ScrewDrive, Transmission, z_grid_mm
from printmend.messages import say
from printmend.printer import Printer
from printmend.units import TURN_RAD


@dataclass(frozen=True)
class Screw:
    """z = (1 + ``lead_error``) m + a sin(θ + φ) with θ = 2πm/lead; (dx, dy) = κe (cos, sin)(θ + ψ).

    m is the commanded height, the lead the printer's ``z.mm_per_turn``. ``backlash_mm`` is play of the nut, half of
    it to either side; it matters where Z goes up and down (Z-hops).
    """

    lead_error: float = 0.0
    periodic_mm: float = 0.0
    periodic_phase_rad: float = 0.0
    wobble_mm: float = 0.0
    wobble_phase_rad: float = 0.0
    backlash_mm: float = 0.0
    kind: ClassVar[str] = "screw"

    def __post_init__(self) -> None:
        in_range(
            self,
            lead_error=(-0.5, 1.0),
            periodic_mm=(0.0, 10.0),
            periodic_phase_rad=(-1e3, 1e3),
            wobble_mm=(0.0, 10.0),
            wobble_phase_rad=(-1e3, 1e3),
            backlash_mm=(0.0, 10.0),
        )

    def lower(self, printer: Printer) -> ScrewDrive:
        """Return Z as arrays. Raise `ConfigError` where the periodic error would turn the axis back."""
        axis = printer.z
        if self.periodic_mm * TURN_RAD / axis.mm_per_turn > 1 + self.lead_error:
            limit_mm = (1 + self.lead_error) * axis.mm_per_turn / TURN_RAD
            refuse(
                self, say("periodic-mm-up-lead-mm", f"{limit_mm:.3g}", f"{axis.mm_per_turn:g}"), f"{self.periodic_mm}"
            )
        motor_mm, first_mm, pitch_mm = z_grid_mm(printer)
        angle = motor_mm * (TURN_RAD / axis.mm_per_turn)
        height = motor_mm + self.lead_error * motor_mm
        if self.periodic_mm > 0:
            height = height + self.periodic_mm * np.sin(angle + self.periodic_phase_rad)
        half_mm = self.backlash_mm / 2
        phase = angle + self.wobble_phase_rad
        return ScrewDrive(
            Transmission(first_mm, pitch_mm, height - half_mm, height + half_mm),
            self.wobble_mm * np.stack([np.cos(phase), np.sin(phase)], axis=1),
        )
