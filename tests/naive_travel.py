"""Slow, obvious versions of what is planned and promised of travels, on moves of `naive_mend`."""

import itertools

import numpy as np

from printmend.machine import Mechanism, Transmission
from tests.naive_mend import Move

TRIED, SAME_MM, HOLD_MM = 3, 1e-3, 0.01


def motors(belt_mm: np.ndarray, length_mm: np.ndarray, motor_mm: float, after_mm: float, drive: Transmission) -> list:
    """Return where a motor goes at each leg's end, None for the last where its belt has to be brought there.

    ``belt_mm`` [1 + N] is where the belt is wanted at the start and after each leg of ``length_mm`` [N], ``after_mm``
    where the line behind them goes. Every way of crossing the slack once is tried.
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


def arrival(rows: list[Move | None], near_mm: tuple[float, float]) -> tuple[bool, bool, float, float]:
    """Return (seen, moves, z, way) of the travel that ``rows`` begin with, None for what is no straight move.

    It ends where the first filament is fed, 256 rows on at the latest, and is not seen to its end where something else
    than a straight move comes before, or one across the bed whose end is not between ``near_mm`` in x and in y.
    """
    fed = next((n for n, row in enumerate(rows[:256]) if row is not None and row.filament > 0), None)
    if fed is None or any(row is None or (_crosses(row) and not _is_near(row, near_mm)) for row in rows[:fed]):
        return False, False, 0.0, 0.0
    rises = [row.end[2] - row.start[2] for row in rows[:fed] if row.end[2] != row.start[2]]
    way = float(np.sign(rises[-1])) if rises else 0.0
    return True, any(_crosses(row) for row in rows[:fed]), rows[fed].start[2], way


def _crosses(move: Move) -> bool:
    return move.start[:2] != move.end[:2]


def _is_near(move: Move, near_mm: tuple[float, float]) -> bool:
    return all(near_mm[0] <= value <= near_mm[1] for value in move.end[:2])


def arriving_push_mm(mechanism: Mechanism, motor_mm: float, z_mm: float, way: float) -> list[float]:
    """Return where a screw pushes the nozzle [x, y] that has come to a height upwards, downwards, or not at all."""
    drive = mechanism.screw.transmission
    if way:
        motor_mm = (lower if way > 0 else upper)(drive, z_mm)
    return [float(np.interp(motor_mm, drive.motor_mm, push)) for push in mechanism.screw.wobble_mm.T]


def from_home_mm(mechanism: Mechanism, end_mm: np.ndarray, motor_mm: np.ndarray, looks: int = 4000) -> float:
    """Return how far from the line home–end a print may be whose motors go straight from home to ``motor_mm``."""
    printer = mechanism.printer
    home = np.array(printer.home_mm, float)
    begin = np.asarray(printer.to_motor(home), float)
    motors = begin + np.linspace(0, 1, looks + 1)[:, None] * (motor_mm - begin)
    belts = [mechanism.transmissions[k].branches_mm(motors[:, k]) for k in range(2)]
    most = 0.0
    for both in itertools.product(*belts):
        places = mechanism.frame.apply(printer.from_motor(np.column_stack(both)))
        way = end_mm - home
        share = np.clip((places - home) @ way / (way @ way), 0, 1)
        most = max(most, float(np.linalg.norm(places - home - share[:, None] * way, axis=1).max()))
    return most
