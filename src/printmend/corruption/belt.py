"""What lies between the pulley and the carriage: belts, their play, their stretch and friction.

The closed loop of a belt leaves its pulley in two opposite spans that move by U1(θ) = ∫h(−t) dt and
U2(θ) = ∫h(π − t) dt. Each belt turns them into the pair (lower, upper) of a `Transmission`.
"""

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from printmend.corruption.check import in_range, refuse
from printmend.messages import say


class Belt(Protocol):
    """A belt: spans in, branches of play out."""

    kind: ClassVar[str]

    def branches_mm(
        self, motor_mm: np.ndarray, span1_mm: np.ndarray, span2_mm: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return (lower, upper) [mm] over the motor positions [N]."""
        ...


@dataclass(frozen=True)
class LooseBelt:
    """Both spans slack: u ← min(max(u, U1 − s1), U2 + s2) (physics.md eq. 7).

    Odd harmonics of the pulley modulate the play: it is U2 − U1 + s1 + s2, which must stay ≥ 0 over a turn.
    """

    slack1_mm: float
    slack2_mm: float
    kind: ClassVar[str] = "loose"

    def __post_init__(self) -> None:
        in_range(self, slack1_mm=(0.0, 1000.0), slack2_mm=(0.0, 1000.0))

    def branches_mm(
        self, motor_mm: np.ndarray, span1_mm: np.ndarray, span2_mm: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = span1_mm - self.slack1_mm, span2_mm + self.slack2_mm
        tightest = (upper - lower).min()
        if tightest < -1e-9:
            refuse(
                self,
                say("slack1-mm-slack2-mm-least-pulley", f"{self.slack1_mm + self.slack2_mm - tightest:.3f}"),
                say("negative-play-mm", f"{self.slack1_mm + self.slack2_mm:.3f}", f"{tightest:.3f}"),
            )
        return lower, np.maximum(lower, upper)


@dataclass(frozen=True)
class Play:
    """Ordinary backlash of constant width b: lower = U1 − b/2, upper = U1 + b/2."""

    play_mm: float
    kind: ClassVar[str] = "play"

    def __post_init__(self) -> None:
        in_range(self, play_mm=(0.0, 1000.0))

    def branches_mm(
        self, motor_mm: np.ndarray, span1_mm: np.ndarray, span2_mm: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        return span1_mm - self.play_mm / 2, span1_mm + self.play_mm / 2


@dataclass(frozen=True)
class ElasticBelt:
    """A taut elastic loop: du/dθ = h_even + ((L2 − L1)/(L1 + L2))·h_odd (physics.md eq. 8).

    L1 is the span from the motor, which sits at ``motor_mm``, to the carriage; ``loop_mm`` = L1 + L2. Odd
    harmonics of the pulley fade with the distance from the motor.
    """

    loop_mm: float
    motor_mm: float = -20.0
    kind: ClassVar[str] = "elastic"

    def __post_init__(self) -> None:
        in_range(self, loop_mm=(10.0, 100_000.0), motor_mm=(-10_000.0, 10_000.0))

    def branches_mm(
        self, motor_mm: np.ndarray, span1_mm: np.ndarray, span2_mm: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        # The carriage's distance from the motor is taken at the nominal position: its own error is 1e-3 of the loop.
        middle = (motor_mm[1:] + motor_mm[:-1]) / 2
        length1 = np.clip(np.abs(middle - self.motor_mm), 0.0, self.loop_mm)
        ratio = (self.loop_mm - 2 * length1) / self.loop_mm
        step1, step2 = np.diff(span1_mm), np.diff(span2_mm)
        steps = (step1 + step2) / 2 + ratio * (step1 - step2) / 2
        position = np.concatenate([[0.0], np.cumsum(steps)])
        position += np.interp(0.0, motor_mm, span1_mm) - np.interp(0.0, motor_mm, position)
        return position, position


@dataclass(frozen=True)
class Friction:
    """Lost motion of a stretching belt against friction: B(x) = (2 F/EA)·L1 L2/(L1 + L2) (physics.md eq. 9).

    Grows with the distance from the motor; widens whatever play there is by B/2 on either side.
    """

    force_n: float
    stiffness_n: float
    loop_mm: float
    motor_mm: float = -20.0
    kind: ClassVar[str] = "friction"

    def __post_init__(self) -> None:
        in_range(
            self,
            force_n=(0.0, 1000.0),
            stiffness_n=(1.0, 1e9),
            loop_mm=(10.0, 100_000.0),
            motor_mm=(-10_000.0, 10_000.0),
        )

    def lost_mm(self, motor_mm: np.ndarray) -> np.ndarray:
        """Return B [mm] at nominal carriage positions [mm]."""
        length1 = np.clip(np.abs(motor_mm - self.motor_mm), 0.0, self.loop_mm)
        return 2 * self.force_n / self.stiffness_n * length1 * (self.loop_mm - length1) / self.loop_mm


BELTS: tuple[type, ...] = (LooseBelt, Play, ElasticBelt)
