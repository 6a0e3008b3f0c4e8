"""What a trace could see of one motor: which angles, and whether the other one moved by itself."""

import numpy as np

from printmend_lab.greybox.drive.design import Contacts, Rows

SECTORS_PER_TURN = 40  # sectors of 9° in which contacts are counted
LEAST_CROSSING_MM = 3.0  # how far the other axis must move by itself, root mean square, for a crooked frame to show
ALL_SEEN = 0.95  # a larger share of the turn counts as all of it
GLIMPSED_TURN = 0.15  # a smaller share of a turn says nothing about a pulley's shape


def crosses(rows: Rows) -> bool:
    """Say whether the other motor moved by itself, not only along with this one."""
    measured = rows.weight > 0
    own, other = rows.own_mm[measured], rows.other_mm[measured]
    own, other = own - own.mean(), other - other.mean()
    together = float(own @ other) / max(float(own @ own), 1e-300)
    return float(np.std(other - together * own)) > LEAST_CROSSING_MM


def seen_share(rows: Rows, touch: Contacts) -> float:
    """Return the share of a motor's turn in which the rows had some contact, given the contacts of its fit."""
    touched = touch.at[(rows.weight > 0) & (touch.side != 0)]
    turns = np.mod(rows.motor_mm[touched] / rows.period_mm, 1.0)
    hit = np.bincount((turns * SECTORS_PER_TURN).astype(np.int64) % SECTORS_PER_TURN, minlength=SECTORS_PER_TURN) > 0
    # The neighbours of a hit count as seen, so that a sparse trace is judged by its gaps and not by its count.
    hit |= np.roll(hit, 1) | np.roll(hit, -1)
    place = rows.motor_mm[touched[touched > 0]]
    # Whatever its neighbours, a span shorter than a turn leaves the rest of the turn unseen.
    return min(float(hit.mean()), float(np.ptp(place)) / rows.period_mm if len(place) else 0.0)
