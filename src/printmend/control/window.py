"""The states that a search over one motor with play looks at."""

from dataclasses import dataclass

import numpy as np

from printmend.path import Plan
from printmend.protocols import PlayTables


@dataclass(frozen=True, eq=False)
class Window:
    """One motor's states as arrays for the kernels.

    ``places`` [K]: the sorted distinct positions where the play can leave the belt. Motor indices first[k]…last[k] leave
    it at place k; a motor at m pushes it to low[m] at least and high[m] at most. A plan for T targets stays at places
    left[t] ≤ k < right[t] at ticks t = 0…T; it begins at place ``start``.
    """

    places: np.ndarray
    first: np.ndarray
    last: np.ndarray
    low: np.ndarray
    high: np.ndarray
    left: np.ndarray
    right: np.ndarray
    start: int

    @property
    def longest(self) -> int:
        """The most motor indices of any place in the window."""
        used = slice(int(self.left.min()), int(self.right.max()))
        return int((self.last - self.first)[used].max()) + 1

    @property
    def height(self) -> int:
        """The most places of any tick."""
        return int((self.right - self.left).max())


def window(tables: PlayTables, motor: int, targets: np.ndarray, start: float, known: np.ndarray, c_max: int) -> Window:
    """Return the states about the targets [T] and about ``known`` [T + 1], the belt's positions in a plan that works."""
    lower, upper = tables.lower_steps[motor], tables.upper_steps[motor]
    places = np.unique(np.concatenate([lower, upper, [start]]))
    first, last = np.searchsorted(upper, places, "left"), np.searchsorted(lower, places, "right") - 1
    low, high = np.searchsorted(places, lower), np.searchsorted(places, upper)
    used = slice(int(first[np.searchsorted(places, known.min())]), int(last[np.searchsorted(places, known.max())]) + 1)
    # Room for the nearest places on either side, and for what a target moves while the play is crossed.
    steepest = float(np.diff(lower[used]).max(initial=1.0))
    room = 1.5 * steepest + float((upper - lower)[used].max()) / (2 * c_max)
    wanted = np.concatenate([[start], targets])
    # Far behind its targets no plan does much better than the known one.
    wanted = np.where(np.abs(wanted - known) > 4 * room, known, wanted)
    left = np.searchsorted(places, np.minimum(wanted, known) - room, "left")
    right = np.searchsorted(places, np.maximum(wanted, known) + room, "right")
    return Window(places, first, last, low, high, left, right, int(np.searchsorted(places, start)))


def better(one: Plan, other: Plan, targets: np.ndarray) -> Plan:
    """Return the plan whose imagined print is nearer to the targets, the first of equals."""
    costs = [float(((plan.imagined_steps[1:] - targets) ** 2).sum()) for plan in (one, other)]
    return one if costs[0] <= costs[1] else other
