"""What a trace could see of one motor: angles, sides, reversals, reach."""

from dataclasses import dataclass

import numpy as np

from printmend.errors import TraceError
from printmend.learn.drive.design import Contacts, Rows

SECTORS = 40
CROSSES_MM = 3.0  # by how much the other axis must move by itself, root mean square, for the frame to show
MOST_LOOKED_AT = 4000
MOVES_MM = 20.0  # beyond any play
GAINS = (0.2, 5.0)  # of the worst pulleys, and then some
TOGETHER = 0.5
SEEN = 0.95  # a larger share of the turn counts as all of it
GLIMPSED = 0.15  # a smaller share says nothing of a pulley's shape


@dataclass(frozen=True)
class Sight:
    """What the measured rows say about one motor.

    ``turns`` the span of its positions in turns; ``angles`` the share of one turn in which some contact was measured,
    ``lower_angles`` and ``upper_angles`` the same for each branch; ``forward`` and ``backward`` the measured rows in
    contact with each; ``reversals`` how often the motor turned back; ``unsure`` the measured rows before the first
    contact; ``crosses`` whether the other motor moved by itself, too: else a crooked frame looks like a wrong scale.
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


def check_follows(rows: Rows, name: str) -> None:
    """Raise `TraceError` where the measured positions do not go with the motor: they are of something else.

    By ranks and quantiles, which single wrong points do not move; a motor that hardly moved proves nothing.
    """
    measured = np.flatnonzero(rows.weight > 0)
    if len(measured) > MOST_LOOKED_AT:
        measured = measured[np.linspace(0, len(measured) - 1, MOST_LOOKED_AT).astype(np.int64)]
    motor, belt = rows.motor_mm[measured], rows.measured_mm[measured]
    moved, followed = (float(np.diff(np.quantile(each, (0.1, 0.9)))[0]) for each in (motor, belt))
    if moved < MOVES_MM:
        return
    ranks = [np.argsort(np.argsort(each)) for each in (motor, belt)]
    together = float(np.corrcoef(ranks[0], ranks[1])[0, 1])
    least, most = GAINS
    if together < TOGETHER or not least < followed / moved < most:
        came = f"moves of {followed / moved:.2f} mm a commanded millimetre, rank correlation {together:.2f}"
        raise TraceError(
            "trace", wanted=f"measured positions that follow the commands along {name.upper()}", came=came,
            todo="check that each row has its own point, that x and y are in millimetres, not swapped, not mirrored",
        )  # fmt: skip


def crosses(rows: Rows) -> bool:
    """Tell whether the other motor moved by itself, not only along with this one."""
    measured = rows.weight > 0
    own, other = rows.own_mm[measured], rows.other_mm[measured]
    own, other = own - own.mean(), other - other.mean()
    together = float(own @ other) / max(float(own @ own), 1e-300)
    return float(np.std(other - together * own)) > CROSSES_MM


def sight(rows: Rows, touch: Contacts) -> Sight:
    """Return what the rows could see, given the contacts of the fit."""
    measured = rows.weight > 0
    shares, counts = [], []
    seen = np.zeros(SECTORS, bool)
    for side in (-1, 1):
        used = measured & (touch.side == side)
        turns = np.mod(rows.motor_mm[touch.at[used]] / rows.period_mm, 1.0)
        hit = np.bincount((turns * SECTORS).astype(np.int64) % SECTORS, minlength=SECTORS) > 0
        # a sparse trace is judged by its gaps, not by its count: neighbours of a hit are seen too
        hit |= np.roll(hit, 1) | np.roll(hit, -1)
        seen |= hit
        shares.append(float(hit.mean()))
        counts.append(int(used.sum()))
    place = rows.motor_mm[touch.at[measured & (touch.side != 0)]]
    span = float(np.ptp(place)) if len(place) else 0.0
    # neighbours or not, a span shorter than a turn leaves the rest of it unseen
    turns_seen = span / rows.period_mm
    steps = np.diff(rows.motor_mm)
    steps = steps[steps != 0]
    reversals = int((np.sign(steps[1:]) != np.sign(steps[:-1])).sum())
    unsure = int((measured & (touch.at < 0)).sum())
    return Sight(
        turns_seen, min(float(seen.mean()), turns_seen), shares[0], shares[1], counts[0], counts[1], reversals, unsure,
        rows.reach_mm, crosses(rows),
    )  # fmt: skip
