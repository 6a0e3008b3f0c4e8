"""What lies between the motor's commanded angle and the pulley: a loose set screw, micro-step ripple."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from printmend.corruption.check import in_range, refuse
from printmend.messages import say


@dataclass(frozen=True)
class SetScrew:
    """Rotational slack β of the pulley on its shaft: play before the map (physics.md eq. 10).

    Because the pulley's map is monotone, it equals lower(θ − β/2) and upper(θ + β/2).
    """

    slack_rad: float
    kind: ClassVar[str] = "set-screw"

    def __post_init__(self) -> None:
        in_range(self, slack_rad=(0.0, math.pi))


@dataclass(frozen=True)
class Ripple:
    """Micro-step ripple: the rotor leads or lags by Σ a_i sin(2π s/p_i + φ_i) full steps at step s (eq. 16).

    The usual periods are 4, 2 and 1 full steps.
    """

    amplitude_steps: tuple[float, ...]
    period_steps: tuple[float, ...]
    phase_rad: tuple[float, ...]
    kind: ClassVar[str] = "ripple"

    def __post_init__(self) -> None:
        in_range(self, amplitude_steps=(0.0, 2.0), period_steps=(0.1, 1000.0), phase_rad=(-1e3, 1e3))
        if not len(self.amplitude_steps) == len(self.period_steps) == len(self.phase_rad):
            refuse(self, say("many-amplitudes-periods-phases"), say("lists-different-lengths"))
        slope = sum(a * 2 * math.pi / p for a, p in zip(self.amplitude_steps, self.period_steps, strict=True))
        if slope > 1:
            refuse(self, say("ripple-never-turns-motor-back-2"), f"{slope:.2f}")

    def lead_steps(self, steps: np.ndarray) -> np.ndarray:
        """Return by how many full steps the rotor leads at commanded positions [full steps]."""
        lead = np.zeros(np.shape(steps))
        for a, p, phi in zip(self.amplitude_steps, self.period_steps, self.phase_rad, strict=True):
            lead += a * np.sin(2 * np.pi * steps / p + phi)
        return lead
