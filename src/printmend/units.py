"""Units, sheets of paper, and the statistics of a median. Inside printmend: mm, s, rad and integer full steps."""

import math

TURN_RAD = 2.0 * math.pi
MM_PER_INCH = 25.4
SIGMA_PER_MEDIAN = 1.4826  # standard deviation of Gaussian errors whose median absolute value is 1
SELDOM_SDS = 2.0  # in one case of twenty, noise is off by more standard deviations
A4_MM, LETTER_MM = (210.0, 297.0), (215.9, 279.4)  # width and height of a sheet: ISO 216, ANSI A


def radius_mm(mm_per_turn: float) -> float:
    """Return the effective radius [mm] of a pulley that moves its belt by ``mm_per_turn`` a turn."""
    return mm_per_turn / TURN_RAD
