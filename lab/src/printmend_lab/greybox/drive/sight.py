"""What a trace could see of one motor: which angles, which sides, how many reversals, how far."""

from dataclasses import dataclass

import numpy as np

from printmend_lab.greybox.drive.design import Contacts, Rows

SECTORS_PER_TURN = 40  # sectors of 9° in which contacts are counted
LEAST_CROSSING_MM = 3.0  # how far the other axis must move by itself, root mean square, for a crooked frame to show
ALL_SEEN = 0.95  # a larger share of the turn counts as all of it
GLIMPSED_TURN = 0.15  # a smaller share of a turn says nothing about a pulley's shape


@dataclass(frozen=True)
class Sight:
    """What the measured rows could see of one motor.

    ``turns`` is the span of its contacts in turns, without the first row, which is home. ``angles`` is the share of one
    turn in which some contact was measured, ``lower_angles`` and ``upper_angles`` that of either branch; ``forward``
    and ``backward`` count the measured rows in contact with either. ``reversals`` counts how often the motor turned
    back, ``unsure`` the measured rows before the first contact. ``crosses`` says whether the other motor moved by
    itself, too: if not, a crooked frame looks like a wrong scale.
    """

    turns: float
    angles: float
    lower_angles: float
    upper_angles: float
    forward: int
    backward: int
    reversals: int
    unsure: int
    reach_mm: tuple[float, float]
    crosses: bool = True


def crosses(rows: Rows) -> bool:
    """Tell whether the other motor moved by itself, not only along with this one."""
    measured = rows.weight > 0
    own, other = rows.own_mm[measured], rows.other_mm[measured]
    own, other = own - own.mean(), other - other.mean()
    together = float(own @ other) / max(float(own @ own), 1e-300)
    return float(np.std(other - together * own)) > LEAST_CROSSING_MM


def sight(rows: Rows, touch: Contacts) -> Sight:
    """Return what the rows could see of a motor, given the contacts of its fit."""
    measured = rows.weight > 0
    shares, counts = [], []
    seen = np.zeros(SECTORS_PER_TURN, bool)
    for side in (-1, 1):
        used = measured & (touch.side == side)
        turns = np.mod(rows.motor_mm[touch.at[used]] / rows.period_mm, 1.0)
        hit = (
            np.bincount((turns * SECTORS_PER_TURN).astype(np.int64) % SECTORS_PER_TURN, minlength=SECTORS_PER_TURN) > 0
        )
        # The neighbours of a hit count as seen, so that a sparse trace is judged by its gaps and not by its count.
        hit |= np.roll(hit, 1) | np.roll(hit, -1)
        seen |= hit
        shares.append(float(hit.mean()))
        counts.append(int(used.sum()))
    place = rows.motor_mm[touch.at[measured & (touch.side != 0) & (touch.at > 0)]]
    span = float(np.ptp(place)) if len(place) else 0.0
    # Whatever its neighbours, a span shorter than a turn leaves the rest of the turn unseen.
    turns_seen = span / rows.period_mm
    steps = np.diff(rows.motor_mm)
    steps = steps[steps != 0]
    reversals = int((np.sign(steps[1:]) != np.sign(steps[:-1])).sum())
    unsure = int((measured & (touch.at < 0)).sum())
    return Sight(
        turns_seen, min(float(seen.mean()), turns_seen), shares[0], shares[1], counts[0], counts[1], reversals, unsure,
        rows.reach_mm, crosses(rows),
    )  # fmt: skip
