"""Where the belts of a machine touch along a trace: what makes a model with play linear (physics.md §4)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from printmend.machine.kernels import run
from printmend.machine.mechanism import Mechanism


@dataclass(frozen=True, eq=False)
class Contacts:
    """``row`` [N, 2] is the row of each motor's last contact, −1 where unknown; ``side`` [N, 2] its branch,
    −1 pushed forwards and +1 pulled back; ``belt_mm`` [N, 2] where the belts are."""

    row: np.ndarray
    side: np.ndarray
    belt_mm: np.ndarray


def contacts_of(mechanism: Mechanism, motor_mm: np.ndarray) -> Contacts:
    """Follow motors [N, 2] through a machine.

    Nobody knows where in its play a belt starts. So both ends are followed, and a contact counts once they agree.
    """
    rows, sides, belts = [], [], []
    for motor in range(2):
        lower, upper = mechanism.transmissions[motor].branches_mm(motor_mm[:, motor])
        ends = [_followed(float(start), lower, upper) for start in (lower[0], upper[0])]
        (at, side, belt), (other_at, other_side, other_belt) = ends
        same = belt == other_belt
        touched = np.where(at >= 0, at, other_at)
        rows.append(np.where(same, np.maximum(touched, 0), -1))  # a taut belt is where its motor is, from the first row
        sides.append(np.where(same, np.where(at >= 0, side, other_side), 0))
        belts.append((belt + other_belt) / 2)
    return Contacts(np.stack(rows, axis=1), np.stack(sides, axis=1), np.stack(belts, axis=1))


def contacts_from(mechanism: Mechanism, motor_mm: np.ndarray, ways: Sequence[int]) -> Contacts:
    """Follow motors [N, 2] that came to the first row in known ``ways`` [2]: +1 forwards, −1 back, 0 in mid-play."""
    rows, sides, belts = [], [], []
    for motor, way in enumerate(ways):
        lower, upper = mechanism.transmissions[motor].branches_mm(motor_mm[:, motor])
        start = {1: lower[0], -1: upper[0]}.get(way, (lower[0] + upper[0]) / 2)
        at, side, belt = _followed(float(start), lower, upper)
        rows.append(np.where(at < 0, 0 if way else -1, at))
        sides.append(np.where(at < 0, -way, side))
        belts.append(belt)
    return Contacts(np.stack(rows, axis=1), np.stack(sides, axis=1), np.stack(belts, axis=1))


def _followed(start_mm: float, lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    count = len(lower)
    at, side, belt = np.empty(count, np.int64), np.empty(count, np.int8), np.empty(count)
    run.contacts(start_mm, lower, upper, at, side, belt)
    return at, side, belt
