"""A crooked frame (physics.md eq. 14), and a bad Z screw, which pushes layers aside (eq. 15)."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from printmend.corruption.transmission import in_range, refuse
from printmend.effects.bent import POWERS
from printmend.effects.effect import SCALE_MM
from printmend.effects.sized import Sized, frame_of, scene_of_printer
from printmend.machine import Frame, ScrewDrive, Transmission, z_grid_mm
from printmend.messages import say
from printmend.printer import Printer
from printmend.units import TURN_RAD


@dataclass(frozen=True)
class CrookedFrame:
    """x' = x + y tan γ + …: skew and scales about the origin, bows and waves about the bed's middle.

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

    def lower(self, printer: Printer) -> Frame:
        """Return the frame map: the laws of `effects` for skew, bent guides and wavy guides, and both scales."""
        lean = SCALE_MM * math.tan(math.radians(self.skew_deg))
        parts = [Sized("skew", 0, (), np.array([lean])), self._bows()]
        rails = (
            (1, self.x_wave_mm, self.x_wave_period_mm, self.x_wave_phase_rad),
            (0, self.y_wave_mm, self.y_wave_period_mm, self.y_wave_phase_rad),
        )
        for along, size_mm, period_mm, phase_rad in rails:
            angle = phase_rad - TURN_RAD * printer.middle_mm[along] / period_mm
            if size_mm:
                parts.append(Sized("rail", along, (period_mm,), size_mm * np.array([math.sin(angle), math.cos(angle)])))
        frame, at = frame_of(scene_of_printer(printer), parts), Frame.exponents.index
        coefficients = frame.coefficients_mm.copy()
        coefficients[0, at((1, 0))] += (self.x_scale - 1) * SCALE_MM
        coefficients[1, at((0, 1))] += (self.y_scale - 1) * SCALE_MM
        coefficients[0, at((0, 0))] += lean * printer.middle_mm[1] / SCALE_MM  # about y = 0, not the middle
        return replace(frame, coefficients_mm=coefficients)

    def _bows(self) -> Sized:
        sizes = np.zeros((2, len(POWERS)))
        sizes[[0, 1], [POWERS.index((0, 2)), POWERS.index((2, 0))]] = self.x_bow_mm, self.y_bow_mm
        return Sized("bent", 0, (), sizes.ravel())


# A bad Z screw: wrong lead, periodic error, backlash, wobble that pushes layers about (physics.md eq. 15).


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
        """Return Z as arrays. Raise `ConfigError` if the periodic error would move the axis backwards."""
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
