"""Plans for motors that must be planned together: both of a CoreXY, and any two behind a crooked frame."""

from dataclasses import dataclass

import numpy as np

from printmend.machine import LatticeMotor, PlayTables, run_motors
from printmend.protocols import WorldModel
from printmend_lab.control.greedy import Greedy
from printmend_lab.control.kernels import coupled as kernels
from printmend_lab.control.lookahead import Lookahead
from printmend_lab.path import Plan

# The states that a search over one motor with play looks at.


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


# Ticks whose costs to go are kept at a time, and ticks beyond them that these costs still count: memory stays bounded,
# and what happens 128 ticks later changes no choice.
_BLOCK_TICKS, _HORIZON_TICKS = 1024, 128


@dataclass(frozen=True)
class Breadth:
    """How many states a search follows from tick to tick.

    Each state has a lower bound of the cost of all plans through it [squared steps]. Followed are those whose bound is
    at most ``slack`` above the least one, or at most ``most`` where the bounds turn out to be loose, and never more
    than ``width`` states.
    """

    slack: float
    most: float
    width: int


def plan_coupled(
    model: WorldModel, tables: PlayTables, targets: np.ndarray, start: np.ndarray, c_max: int, breadth: Breadth
) -> Plan:
    """Plan both motors together for targets [T, 2], T > 0; never worse than `Greedy` and `Lookahead` on the model."""
    greedy = Greedy().plan(model, targets, start, c_max=c_max)
    if tables.is_taut and np.abs(greedy.controls).max() < c_max:
        # Every target had the choice of all its neighbours, and nothing is remembered: nothing can be better.
        return greedy
    known = better(greedy, Lookahead().plan(model, targets, start, c_max=c_max), targets)
    moves = _search(tables, targets, model.printer.to_motor(known.controls.astype(np.int64)), c_max, breadth)
    imagined = tables.bed.printed(run_motors(tables.motors, moves))
    found = model.printer.from_motor(moves).astype(np.int8)
    return better(known, Plan(found, imagined), targets)


def _search(tables: PlayTables, targets: np.ndarray, known: np.ndarray, c_max: int, breadth: Breadth) -> np.ndarray:
    """Return the motors' moves [T, 2] of the cheapest plan found; ``known`` [T, 2] are those of one that works."""
    ticks = len(targets)
    seen, weights = _seen_by_motors(tables, targets)
    index, belts = followed(tables, known)
    reach = 2 * c_max if tables.bed.corexy else c_max
    windows = [window(motor, seen[:, k], belts[:, k], reach) for k, motor in enumerate(tables.motors)]
    prices = np.zeros((2, ticks, 2))
    if tables.bed.corexy:
        prices = _prices(tables, seen, weights, index[1:], belts[1:], windows)
    places, first, low, high, left, right = (
        _padded([getattr(each, name) for each in windows])
        for name in ("places", "first", "low", "high", "left", "right")
    )
    size = np.array([len(each.low) for each in windows])
    at = np.stack([np.searchsorted(each.places, belts[:, motor]) for motor, each in enumerate(windows)])
    plan = np.stack([at, (index - [each.offset for each in windows]).T], axis=2)
    wanted, cross = np.ascontiguousarray(seen.T), np.ascontiguousarray(weights[:, 2])
    alone = np.ascontiguousarray((weights[:, :2] - np.abs(cross)[:, None]).T)
    states, paid, ways = plan[None, :, 0].copy(), np.zeros(1), []
    shape = int((right - left).max()), max(each.longest for each in windows)
    # One array for all blocks: the system takes its time to hand out fresh memory.
    room = np.empty(2 * (min(ticks, _BLOCK_TICKS + _HORIZON_TICKS) + 1) * shape[0] * shape[1])
    for begin in range(0, ticks, _BLOCK_TICKS):
        end, ahead = min(begin + _BLOCK_TICKS, ticks), min(begin + _BLOCK_TICKS + _HORIZON_TICKS, ticks)
        count = ahead - begin + 1
        togo = room[: 2 * count * shape[0] * shape[1]].reshape(2, count, *shape)
        edges = left[:, begin : ahead + 1].copy(), right[:, begin : ahead + 1].copy()
        for motor, each in enumerate(windows):
            kernels.arrivals(
                wanted[motor, begin:ahead], alone[motor, begin:ahead], prices[motor, begin:ahead], each.places,
                each.first, each.last, each.low, each.high, edges[0][motor], edges[1][motor], reach, togo[motor],
            )  # fmt: skip
        motors = kernels.Motors(places, first, low, high, size, *edges, togo)
        task = kernels.Task(
            wanted[:, begin:end].copy(), cross[begin:end], plan[:, begin : end + 1].copy(), reach, 2 * c_max,
            tables.bed.corexy,
        )  # fmt: skip
        states, paid, *way = kernels.follow(states, paid, motors, task, breadth.slack, breadth.most, breadth.width)
        ways.append(way)
    moves, state = np.empty((ticks, 2), np.int8), int(np.argmin(paid))
    for n, way in reversed(list(enumerate(ways))):
        state = kernels.way_back(*way, state, moves[n * _BLOCK_TICKS : (n + 1) * _BLOCK_TICKS])
    return moves.astype(np.int64)


def _padded(pair: list[np.ndarray]) -> np.ndarray:
    """Return two arrays as one [2, N], the shorter one continued with its last value."""
    length = max(map(len, pair))
    return np.stack([np.pad(each, (0, length - len(each)), mode="edge") for each in pair])


def _seen_by_motors(tables: PlayTables, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where the targets are for the motors' belts [T, 2], and the weights [T, 3] of e_a², e_b² and 2 e_a e_b.

    Near a target the squared error is eᵀ JᵀJ e in the belts' distances e, with J the derivatives of the place on the
    bed by the belts.
    """
    seen = tables.bed.wanted(targets)
    slopes = tables.bed.slopes(seen)
    squares = np.swapaxes(slopes, -1, -2) @ slopes
    return seen, np.ascontiguousarray(np.stack([squares[:, 0, 0], squares[:, 1, 1], squares[:, 0, 1]], axis=1))


def _prices(
    tables: PlayTables,
    seen: np.ndarray,
    weights: np.ndarray,
    index: np.ndarray,
    belts: np.ndarray,
    windows: list[Window],
) -> np.ndarray:
    """Return prices [2, T, 2] that a CoreXY's motors pay at each tick for an even and for an odd motor index.

    A CoreXY's motors make a = x + y and b = x − y full steps, so both indices are even or both are odd. The search
    bounds a plan's cost by what either motor would pay alone, and alone it would choose its parity freely. A price for
    an odd index that one motor pays and the other one gets leaves the sum for both as it is, whatever its size, but
    makes either motor feel the other's wish: the bounds come nearer to the truth (a Lagrange multiplier).

    In a known plan (motor indices and belts, [T, 2] each) the ticks count at which a belt is pushed or drawn. Where one
    motor's target is nearer to an odd place and the other's to an even one, the price is what giving way costs the one
    that loses less. Even and odd are counted from the offset of each motor's window.
    """
    price = np.zeros((2, len(seen)))
    for motor, each in enumerate(tables.motors):
        for branch in (each.upper_steps, each.lower_steps):
            at = np.flatnonzero(belts[:, motor] == branch[index[:, motor]])
            wanted = seen[at, motor, None]
            near = np.clip(np.searchsorted(branch, wanted) + np.arange(-2, 2), 0, len(branch) - 1)
            missed = weights[at, motor, None] * (branch[near] - wanted) ** 2
            odd = ((near + each.first_step) & 1).astype(bool)
            costs = [np.where(which, missed, np.inf).min(axis=1) for which in (odd, ~odd)]
            price[motor, at] = costs[0] - costs[1]
    a, b = price
    agreed = np.where(a * b < 0, np.sign(b) * np.minimum(np.abs(a), np.abs(b)), 0.0)
    paid = np.zeros((2, len(seen), 2))
    for motor, sign in enumerate((1.0, -1.0)):
        paid[motor, :, 1 ^ ((windows[motor].offset + tables.motors[motor].first_step) & 1)] = sign * agreed
    return paid
