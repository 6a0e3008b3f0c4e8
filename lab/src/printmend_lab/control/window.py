"""The states that a search over one motor with play looks at."""

from dataclasses import dataclass

import numpy as np

from printmend.machine import LatticeMotor, PlayTables, run_motors
from printmend_lab.path import Plan


@dataclass(frozen=True, eq=False)
class Window:
    """One motor's states as arrays for the kernels.

    Motor indices count from ``offset`` of the tables. ``places`` [K] are the sorted distinct positions where the play
    can leave the belt. Motor indices first[k]…last[k] leave the belt at place k; a motor at index m pushes it to place
    low[m] at least and high[m] at most. A plan for T targets is looked for among the places left[t] ≤ k < right[t] at
    ticks t = 0…T; it begins at place ``start``.
    """

    offset: int
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


_REACH = 10  # motor steps around a target in which the steepest slope and the widest play set the room of its window
_MARGIN = 100  # motor steps of the tables that are kept beyond all that a plan and its targets reach


def _highest(values: np.ndarray) -> np.ndarray:
    """Return the greatest of the values about each."""
    padded = np.pad(values, _REACH, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * _REACH + 1).max(axis=1)


def window(motor: LatticeMotor, targets: np.ndarray, known: np.ndarray, c_max: int) -> Window:
    """Return the states about the targets [T] and about ``known`` [T + 1], the belt in a plan that works.

    The kernels hold the law of the play in the form of these indices and check none. Raise `RuntimeError` where the
    known plan's belt is at no such place: then `machine.kernels.play` has another law.
    """
    start = motor.origin_steps
    wanted = np.concatenate([[start], targets])
    lower, upper = motor.lower_steps, motor.upper_steps
    # Only the part of the tables that the plan uses, with a margin beyond any room.
    reach = (min(known.min(), wanted.min()), max(known.max(), wanted.max()))
    offset = max(int(np.searchsorted(upper, reach[0])) - _MARGIN, 0)
    part = slice(offset, int(np.searchsorted(lower, reach[1])) + _MARGIN)
    lower, upper = lower[part], upper[part]
    places = np.unique(np.concatenate([lower, upper, [start]]))
    first, last = np.searchsorted(upper, places, "left"), np.searchsorted(lower, places, "right") - 1
    low, high = np.searchsorted(places, lower), np.searchsorted(places, upper)
    if not (places[np.minimum(np.searchsorted(places, known), len(places) - 1)] == known).all():
        raise RuntimeError(f"motor {motor.name}: a belt rests where no branch of its play leaves it")
    # Room for the next place on either side, and for what a target moves while the play is crossed, both as they are
    # near by. Where exhaustive searches were made, more room changed nothing.
    slope = np.diff(lower, append=lower[-1] + 1.0)
    rooms = _highest(slope) + _highest(upper - lower) / (2 * c_max)
    room = rooms[np.minimum(np.searchsorted(lower, wanted), len(rooms) - 1)]
    # Far behind its targets no plan does much better than the known one.
    wanted = np.where(np.abs(wanted - known) > 4 * room, known, wanted)
    left = np.searchsorted(places, np.minimum(wanted, known) - room, "left")
    right = np.searchsorted(places, np.maximum(wanted, known) + room, "right")
    return Window(offset, places, first, last, low, high, left, right, int(np.searchsorted(places, start)))


def followed(tables: PlayTables, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the motors' indices in the tables and the belts' positions, each [T + 1, 2], for their moves [T, 2]."""
    index = np.empty((len(moves) + 1, 2), np.int64)
    index[0] = [motor.start for motor in tables.motors]
    np.cumsum(moves, axis=0, out=index[1:])
    index[1:] += index[0]
    return index, run_motors(tables.motors, moves)


def better(one: Plan, other: Plan, targets: np.ndarray) -> Plan:
    """Return the plan whose imagined print is nearer to the targets, the first of equals."""
    costs = [float(((plan.imagined_steps[1:] - targets) ** 2).sum()) for plan in (one, other)]
    return one if costs[0] <= costs[1] else other
