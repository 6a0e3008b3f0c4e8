"""Follow a machine along a trace: where its motors stop, and where its belts make contact (physics.md §4)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from printmend.machine.kernels import run
from printmend.machine.mechanism import Mechanism


def drive_belts(mechanism: Mechanism, motors_mm: np.ndarray, belts_mm: np.ndarray) -> np.ndarray:
    """Move the motors through ``motors_mm`` [N, M]; return their belts [N, M] mm.

    M is 2, or 3 with Z. The belts may begin anywhere, ``belts_mm`` [M]: the first row clips them into their play.
    Without a screw the third column is returned as it is.
    """
    belts = np.array(motors_mm, float)
    for k, table in enumerate(mechanism.motors[: belts.shape[1]]):
        out = np.empty(len(belts))
        run.follow(float(belts_mm[k]), *table.branches_mm(belts[:, k]), out)
        belts[:, k] = out
    return belts


def reach_bed(mechanism: Mechanism, motors_mm: np.ndarray, belts_mm: np.ndarray) -> np.ndarray:
    """Return the nozzle's places [N, M] mm for belts [N, M]: through the frame, and pushed by the screw.

    The screw's push depends on its motor's position, in ``motors_mm`` [N, M].
    """
    places = mechanism.bed.printed(belts_mm[:, :2])
    if belts_mm.shape[1] == 2:
        return places
    if mechanism.screw is not None:
        places = places + mechanism.screw.wobble_at_mm(motors_mm[:, 2])
    return np.concatenate([places, belts_mm[:, 2:]], axis=1)


def print_path(mechanism: Mechanism, motors_mm: np.ndarray, belts_mm: np.ndarray) -> np.ndarray:
    """Return the places [N, M] mm printed at motor positions [N, M] mm, with belts that begin at ``belts_mm`` [M]."""
    return reach_bed(mechanism, motors_mm, drive_belts(mechanism, motors_mm, belts_mm))


def print_from_home(mechanism: Mechanism, places_mm: np.ndarray) -> np.ndarray:
    """Return where a machine prints commanded places [N, 2] mm, with heights [N, 3], one after the other from home.

    The machine's origin is used as it is: a learned machine gives bed positions.
    """
    printer, axes = mechanism.printer, places_mm.shape[1]
    home_mm = np.array([*printer.home_mm, printer.z.home_mm])
    motors_mm = np.concatenate([home_mm[None, :axes], places_mm])
    motors_mm[:, :2] = printer.to_motor(motors_mm[:, :2])
    at_home_mm = np.array([*mechanism.bed.wanted(home_mm[:2]), home_mm[2]])
    return print_path(mechanism, motors_mm, at_home_mm[:axes])[1:]


@dataclass(frozen=True, eq=False)
class Contacts:
    """``row`` [N, 2] is the row of each motor's last contact, −1 where unknown; ``side`` [N, 2] its branch,
    −1 pushed forwards and +1 pulled back; ``belt_mm`` [N, 2] where the belts are."""

    row: np.ndarray
    side: np.ndarray
    belt_mm: np.ndarray


def contacts_of(mechanism: Mechanism, motor_mm: np.ndarray, more_mm: np.ndarray | None = None) -> Contacts:
    """Follow motors [N, 2] through a machine, and return their `Contacts`.

    A belt starts at an unknown place in its play. So both extremes are followed, and a contact counts once they agree.
    ``more_mm`` [N, 2] is each belt's additional play at each place.
    """
    rows, sides, belts = [], [], []
    for motor in range(2):
        lower, upper = mechanism.transmissions[motor].branches_mm(motor_mm[:, motor])
        if more_mm is not None:
            half = np.maximum(more_mm[:, motor], lower - upper) / 2  # play cannot be negative
            lower, upper = lower - half, upper + half
        ends = [_followed(float(start), lower, upper) for start in (lower[0], upper[0])]
        (at, side, belt), (other_at, other_side, other_belt) = ends
        same = belt == other_belt
        touched = np.where(at >= 0, at, other_at)
        rows.append(np.where(same, np.maximum(touched, 0), -1))  # a taut belt is where its motor is, from the first row
        sides.append(np.where(same, np.where(at >= 0, side, other_side), 0))
        belts.append((belt + other_belt) / 2)
    return Contacts(np.stack(rows, axis=1), np.stack(sides, axis=1), np.stack(belts, axis=1))


def contacts_from(mechanism: Mechanism, motor_mm: np.ndarray, ways: Sequence[int]) -> Contacts:
    """Follow motors [N, 2] that reached the first row in known ``ways`` [2]: +1 forwards, −1 back, 0 in mid-play."""
    rows, sides, belts = [], [], []
    for motor, way in enumerate(ways):
        lower, upper = mechanism.transmissions[motor].branches_mm(motor_mm[:, motor])
        start = {1: lower[0], -1: upper[0]}.get(way, (lower[0] + upper[0]) / 2)
        at, side, belt = _followed(float(start), lower, upper)
        rows.append(np.where(at < 0, 0 if way else -1, at))
        sides.append(np.where(at < 0, -way, side))
        belts.append(belt)
    return Contacts(np.stack(rows, axis=1), np.stack(sides, axis=1), np.stack(belts, axis=1))


def share_behind(places_mm: np.ndarray, play_mm: float) -> np.ndarray:
    """Return the lag of a part with this play at each place [N] of its drive, as a share of half the play: 1 while it
    is pushed forwards, −1 while it is pulled back. It begins in mid-play."""
    half_mm = play_mm / 2
    _, _, follows_mm = _followed(float(places_mm[0]), places_mm - half_mm, places_mm + half_mm)
    return (places_mm - follows_mm) / half_mm


def _followed(start_mm: float, lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    count = len(lower)
    at, side, belt = np.empty(count, np.int64), np.empty(count, np.int8), np.empty(count)
    run.contacts(start_mm, lower, upper, at, side, belt)
    return at, side, belt
