"""What happens suddenly: the belt skips teeth of its pulley, the motor misses steps (physics.md eq. 11).

Both come at random places of a motor's travel, drawn from a seed: a Poisson process of ``rate_per_m`` jumps per metre
that the motor turns, either way. A jump takes effect at the first tick or way-point at which its place is reached.
No planner can foresee it, so jumps are no part of a `Mechanism`: the twin adds them.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from printmend.corruption.check import in_range, whole_in_range
from printmend.printer import Axis


@dataclass(frozen=True)
class ToothSkips:
    """The belt jumps by a tooth: from then on the carriage is ± ``pitch_mm`` from where it was (10 full steps)."""

    rate_per_m: float
    seed: int = 0
    pitch_mm: float = 2.0
    kind: ClassVar[str] = "tooth-skips"

    def __post_init__(self) -> None:
        in_range(self, rate_per_m=(0.0, 1000.0), pitch_mm=(0.1, 20.0))
        whole_in_range(self, seed=(0, 2**63 - 1))

    def signs(self, travel_mm: np.ndarray) -> np.ndarray:
        """Return the sum of the signs of the jumps at each entry [N] of cumulative travel [N + 1, from 0] mm."""
        return _signs(self.rate_per_m, (self.seed, 0), travel_mm)


@dataclass(frozen=True)
class MissedSteps:
    """The motor falls behind or runs ahead by ``steps`` full steps (4, one electrical turn): its angle is lost."""

    rate_per_m: float
    seed: int = 0
    steps: int = 4
    kind: ClassVar[str] = "missed-steps"

    def __post_init__(self) -> None:
        in_range(self, rate_per_m=(0.0, 1000.0))
        whole_in_range(self, seed=(0, 2**63 - 1), steps=(1, 1000))

    def signs(self, travel_mm: np.ndarray) -> np.ndarray:
        """As `ToothSkips.signs`."""
        return _signs(self.rate_per_m, (self.seed, 1), travel_mm)


class Jumps(NamedTuple):
    """The jumps of one motor's drive."""

    skips: ToothSkips | None = None
    missed: MissedSteps | None = None

    def along(self, motor_mm: np.ndarray, axis: Axis) -> tuple[np.ndarray, np.ndarray]:
        """Return, over a motor's commanded path [N + 1] mm, by how much the motor and the belt are off [N + 1] mm.

        The travel is the path's own: way-points between which the motor runs straight.
        """
        travel_mm = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(motor_mm)))])
        motor, belt = np.zeros(len(motor_mm)), np.zeros(len(motor_mm))
        if self.missed is not None:
            motor[1:] = np.cumsum(self.missed.signs(travel_mm)) * (self.missed.steps * axis.mm_per_step)
        if self.skips is not None:
            belt[1:] = np.cumsum(self.skips.signs(travel_mm)) * self.skips.pitch_mm
        return motor, belt


def places_mm(rate_per_m: float, seed: tuple[int, int], travel_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the places [E] mm of the jumps within a travel and their signs [E]; a longer travel only adds to them."""
    if rate_per_m <= 0 or travel_mm <= 0:
        return np.empty(0), np.empty(0)
    gaps, signs = np.random.default_rng((*seed, 0)), np.random.default_rng((*seed, 1))
    places = np.empty(0)
    while len(places) == 0 or places[-1] <= travel_mm:
        more = np.cumsum(gaps.exponential(1000.0 / rate_per_m, 64)) + (places[-1] if len(places) else 0.0)
        places = np.concatenate([places, more])
    return places[places <= travel_mm], signs.choice([-1.0, 1.0], len(places))[places <= travel_mm]


def _signs(rate_per_m: float, seed: tuple[int, int], travel_mm: np.ndarray) -> np.ndarray:
    places, signs = places_mm(rate_per_m, seed, float(travel_mm[-1]))
    sums = np.zeros(len(travel_mm) - 1)
    np.add.at(sums, np.searchsorted(travel_mm[1:], places, side="left"), signs)
    return sums
