"""Slow, obvious version of how far a motor follows a travel of several legs: every way of crossing once is tried."""

import numpy as np

from printmend.machine import Transmission

TRIED, SAME_MM, HOLD_MM = 3, 1e-3, 0.01


def motors(belt_mm: np.ndarray, length_mm: np.ndarray, motor_mm: float, after_mm: float, drive: Transmission) -> list:
    """Return where a motor goes at each leg's end, None for the last where its belt has to be brought there.

    ``belt_mm`` [1 + N] is where the belt is wanted at the start and after each leg of ``length_mm`` [N], ``after_mm``
    where the line behind them goes.
    """
    low, high = lower(drive, belt_mm[0]), upper(drive, belt_mm[0])
    lag = np.clip((motor_mm - (low + high) / 2) / ((low - high) / 2), -1, 1)
    ahead = after_mm - belt_mm[-1]
    first = np.sign(ahead) if abs(ahead) > HOLD_MM else (1 if lag > 0 else -1)
    longest_first = sorted(range(len(length_mm)), key=lambda leg: (-length_mm[leg], leg))
    for side in (first, -first):
        for crossed in longest_first[:TRIED]:
            way = [
                one_side(drive, u, belt_mm[-1], side) if leg >= crossed else between(drive, u, lag)
                for leg, u in enumerate(belt_mm[1:])
            ]
            if abs(dragged(drive, belt_mm[0], [motor_mm, *way]) - belt_mm[-1]) <= SAME_MM:
                return way
    return [between(drive, u, lag) for u in belt_mm[1:-1]] + [None]


def lower(drive: Transmission, belt_mm: float) -> float:
    return float(np.interp(belt_mm, drive.lower_mm, drive.motor_mm))


def upper(drive: Transmission, belt_mm: float) -> float:
    return float(np.interp(belt_mm, drive.upper_mm, drive.motor_mm))


def between(drive: Transmission, belt_mm: float, lag: float) -> float:
    return float(np.interp(lag, [-1, 1], [upper(drive, belt_mm), lower(drive, belt_mm)]))


def one_side(drive: Transmission, belt_mm: float, end_mm: float, side: float) -> float:
    """Return where a motor pushes or pulls its belt to a place, no further than its end where its slack holds that."""
    if 0 < side * (belt_mm - end_mm) <= lower(drive, end_mm) - upper(drive, end_mm):
        belt_mm = end_mm
    return lower(drive, belt_mm) if side > 0 else upper(drive, belt_mm)


def dragged(drive: Transmission, belt_mm: float, motor_mm: list[float]) -> float:
    """Return where a belt ends whose motor goes from place to place, by clipping."""
    for m in motor_mm:
        low, high = (float(np.interp(m, drive.motor_mm, table)) for table in (drive.lower_mm, drive.upper_mm))
        belt_mm = min(max(belt_mm, low), high)
    return belt_mm
