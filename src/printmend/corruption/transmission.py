"""What lies between the motor and the carriage, but for the pulley: set screw, ripple, belts, play, stretch, friction.

Also errors that repeat nothing, as of a belt of uneven pitch, and the gains of the paper's published simulator.

The closed loop of a belt leaves its pulley in two opposite spans that move by U1(θ) = ∫h(−t) dt and
U2(θ) = ∫h(π − t) dt. Each belt turns them into the pair (lower, upper) of a `Transmission`.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from printmend.corruption.check import in_range, refuse
from printmend.messages import say


@dataclass(frozen=True)
class GainTable:
    """One row of the published ``all_data``: entry p − 1 is the gain of a step at nominal position p.

    The same in both directions and not conservative (physics.md §8.1).
    """

    gains: tuple[float, ...]
    kind: ClassVar[str] = "gain-table"

    def __post_init__(self) -> None:
        in_range(self, gains=(-100.0, 100.0))
        if not 2 <= len(self.gains) <= 100_000:
            refuse(self, say("2-100-000-gains-published-tables"), f"{len(self.gains)}")


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
