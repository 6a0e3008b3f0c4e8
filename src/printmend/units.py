"""Unit constants. Inside printmend: mm, s, rad and integer full steps."""

import math

TURN_RAD = 2.0 * math.pi
MM_PER_INCH = 25.4


def radius_mm(mm_per_turn: float) -> float:
    """Return the effective radius [mm] of a pulley that moves its belt by ``mm_per_turn`` a turn."""
    return mm_per_turn / TURN_RAD
