"""Dynamic programming over two coupled motors, guided by each motor's own least cost to go. Checks: coupled.py.

States as in optimal.py: a motor index m and the place k where the belt stands, for both motors. The cost of a tick is

    w_a e_a² + w_b e_b² + |c| (e_a ± e_b)²          e: the distance of a belt from its target, ± the sign of c

so what each motor would cost alone, with w_a or w_b, never exceeds what both cost together: cost so far + both costs to
go bounds every plan through a state from below. The motors of a CoreXY move both by an even or both by an odd number of
steps. A price on odd indices, which one motor pays to the other, leaves the cost of both as it is; the right one makes
the bound nearly tight.

A state whose bound lies more than a slack above the least of its tick is left out. Along every way bounds grow, by what
the motors' choices lose against their own best. So few choices of a state need to be looked at: those of least loss.

Arrays of both motors have an axis of length 2, padded where one motor has less. What is done for a state counts no
references (_nrt): it would take longer than what is done.
"""

from typing import NamedTuple

import numpy as np

from printmend.jit import entry, inner

_CHUNK_TICKS = 16  # between the places to which a search may go back
# A pair of states that was reached, one of each motor.
PAIR = np.dtype(
    [
        ("ids", "i8", 2),  # of the two states
        ("parent", "i8"),  # the state of both motors at the tick before
        ("moves", "i8", 2),  # of the motors from there [steps]
    ]
)
# What is kept of it for the way back.
STEP = np.dtype([("parent", "i4"), ("moves", "i4", 2)])


# Its many parameters are the arrays of one motor's `window`, as Python has them. Long because the sliding minimum over
# a row and the two places at which a belt is caught read the same tick's arrays.
@entry
def arrivals(wanted, weight, price, places, first, last, low, high, left, right, reach, out):
    """Fill out [T + 1, R, W] with the least cost of being in state (k, m) at tick t and of all ticks after it.

    For one motor alone; T targets are those of ticks 1…T, tick 0 is left as it is. Index: k − left[t], m − first[k].
    ``reach``: the most steps of a control. States that must leave the window cost infinity.
    """
    ticks, broad = wanted.shape[0], out.shape[2]
    # What it costs to be drawn back, or pushed on, by a motor that arrives at m.
    back, on = np.empty(low.shape[0]), np.empty(low.shape[0])
    before, behind = np.empty(broad), np.empty(broad)
    for t in range(ticks, 0, -1):
        left0, right0 = left[t], right[t]
        if t < ticks:
            left1, right1 = left[t + 1], right[t + 1]
            for m in range(max(first[left0] - reach, 0), min(last[right0 - 1] + reach + 1, low.shape[0])):
                k = high[m]
                back[m] = out[t + 1, k - left1, m - first[k]] if left1 <= k < right1 else np.inf
                k = low[m]
                on[m] = out[t + 1, k - left1, m - first[k]] if left1 <= k < right1 else np.inf
        for k in range(left0, right0):
            row, m0, m1 = out[t, k - left0], first[k], last[k]
            count = m1 - m0 + 1
            error = places[k] - wanted[t - 1]
            here = weight[t - 1] * error * error
            if t == ticks:
                for n in range(count):
                    row[n] = here + price[t - 1, (m0 + n) & 1]
                continue
            if left1 <= k < right1:
                # The least of a sliding window: blocks of its length, each with its minima from either end.
                stay, window = out[t + 1, k - left1], 2 * reach + 1
                for block in range(0, count, window):
                    stop, least = min(block + window, count), np.inf
                    for n in range(block, stop):
                        least = min(least, stay[n])
                        before[n] = least
                    least = np.inf
                    for n in range(stop - 1, block - 1, -1):
                        least = min(least, stay[n])
                        behind[n] = least
                for n in range(min(reach + 1, count)):
                    row[n] = before[min(n + reach, count - 1)]
                for n in range(reach + 1, count - reach):
                    row[n] = min(behind[n - reach], before[n + reach])
                final = (count - 1) // window * window  # where the last block begins
                for n in range(max(reach + 1, count - reach), count):
                    row[n] = behind[n - reach] if n - reach >= final else min(behind[n - reach], before[count - 1])
            else:
                row[:count] = np.inf
            # Other moves leave the place: back beyond the first of its motor indices, or on beyond the last.
            least_back, least_on = np.inf, np.inf
            for far in range(1, reach + 1):
                n = reach - far
                if m0 >= far:
                    least_back = min(least_back, back[m0 - far])
                if m1 + far < low.shape[0]:
                    least_on = min(least_on, on[m1 + far])
                if n < count:
                    row[n] = min(row[n], least_back)
                    row[count - 1 - n] = min(row[count - 1 - n], least_on)
            for n in range(count):
                row[n] += here + price[t - 1, (m0 + n) & 1]


class Motors(NamedTuple):
    """Both motors' states about a known plan: a pair (k, m) is where the belt stands and the motor's index.

    ``places`` [2, K] are the belts' places and ``first`` [2, K] the least index at each; ``low`` and ``high`` [2, M]
    the k to which an index m pushes and draws the belt, ``size`` [2] how many indices there are; ``left`` and ``right``
    [2, T + 1] the places k within reach of each tick, ``togo`` [2, T + 1, R, W] what `arrivals` made.
    """

    places: np.ndarray
    first: np.ndarray
    low: np.ndarray
    high: np.ndarray
    size: np.ndarray
    left: np.ndarray
    right: np.ndarray
    togo: np.ndarray


class Task(NamedTuple):
    """What is to be followed: targets of both belts [2, T], the weights c of e_a e_b [T], a known plan [2, T + 1, 2].

    A control moves a motor by at most ``reach`` steps and both by at most ``together``; where ``parted``, both by an
    even or both by an odd number.
    """

    wanted: np.ndarray
    cross: np.ndarray
    known: np.ndarray
    reach: int
    together: int
    parted: bool


class Choices(NamedTuple):
    """What one motor can do from a state that it is in at a tick, listed once for each state and tick.

    ``losses``, ``ids`` of where that leads and ``moves`` [2, N, 2, F], the least loss first, the odd moves apart where
    the task is parted; ``many`` [2, N, 2] of them, ``least`` [2, N] the cost to go, ``built`` [2, N] the tick for which
    they were listed last. ``costs`` [F] is scratch.
    """

    losses: np.ndarray
    ids: np.ndarray
    moves: np.ndarray
    many: np.ndarray
    least: np.ndarray
    built: np.ndarray
    costs: np.ndarray


class Reached(NamedTuple):
    """The states of one motor at this tick and the next, ``found`` [2, 2, N, 2], each once: its id is its row.

    ``index`` and ``stamp`` [2, R · W] say which id a state has, and of which tick; ``count`` [2] how many there are.
    """

    found: np.ndarray
    index: np.ndarray
    stamp: np.ndarray
    count: np.ndarray


class Pairs(NamedTuple):
    """The pairs of states that were reached: ``after`` [P] of PAIR.

    ``bounds`` [P] bounds what a plan through each costs; ``slots`` and ``stamp`` [N · N] say where a pair is, if this
    tick has it.
    """

    after: np.ndarray
    bounds: np.ndarray
    slots: np.ndarray
    stamp: np.ndarray


@inner(error_model="python")
def cost_to_go(motors, reach, motor, t, k, m):
    """Return one motor's least cost to go from state (k, m) of tick t."""
    if t + 1 == motors.togo.shape[1]:
        return 0.0
    left, right, least = motors.left[motor, t + 1], motors.right[motor, t + 1], np.inf
    for m1 in range(max(m - reach, 0), min(m + reach + 1, motors.size[motor])):
        k1 = min(max(k, motors.low[motor, m1]), motors.high[motor, m1])
        if left <= k1 < right:
            least = min(least, motors.togo[motor, t + 1, k1 - left, m1 - motors.first[motor, k1]])
    return least


@inner(error_model="python")
def list_choices(motors, task, choices, reached, motor, state, t, clock, dearest):
    """List what a motor can do from one of its states at a tick, at a loss of at most ``dearest``."""
    now, then = (clock + 1) & 1, clock & 1
    choices.built[motor, state] = clock
    k, m = reached.found[now, motor, state, 0], reached.found[now, motor, state, 1]
    begin, end = max(m - task.reach, 0), min(m + task.reach + 1, motors.size[motor])
    left, right, cheapest = motors.left[motor, t + 1], motors.right[motor, t + 1], np.inf
    for m1 in range(begin, end):
        k1 = min(max(k, motors.low[motor, m1]), motors.high[motor, m1])
        cost = np.inf
        if left <= k1 < right:
            cost = motors.togo[motor, t + 1, k1 - left, m1 - motors.first[motor, k1]]
        choices.costs[m1 - begin] = cost
        cheapest = min(cheapest, cost)
    choices.least[motor, state] = cheapest
    choices.many[motor, state, 0] = choices.many[motor, state, 1] = 0
    for m1 in range(begin, end):
        loss = choices.costs[m1 - begin] - cheapest
        if not (loss <= dearest and loss < np.inf):
            continue
        k1 = min(max(k, motors.low[motor, m1]), motors.high[motor, m1])
        at = (k1 - left) * motors.togo.shape[3] + m1 - motors.first[motor, k1]
        if reached.stamp[motor, at] != clock:
            count = reached.count[motor]
            if count == reached.found.shape[2]:
                continue
            reached.stamp[motor, at], reached.index[motor, at] = clock, count
            reached.found[then, motor, count, 0], reached.found[then, motor, count, 1] = k1, m1
            reached.count[motor] = count + 1
        part = (m1 - m) & 1 if task.parted else 0
        losses, ids = choices.losses[motor, state, part], choices.ids[motor, state, part]
        moves, n = choices.moves[motor, state, part], choices.many[motor, state, part]
        while n > 0 and losses[n - 1] > loss:
            losses[n], ids[n], moves[n] = losses[n - 1], ids[n - 1], moves[n - 1]
            n -= 1
        losses[n], ids[n], moves[n] = loss, reached.index[motor, at], m1 - m
        choices.many[motor, state, part] += 1


@inner(error_model="python")
def follow_known(motors, task, choices, reached, pairs, kept, bound, t, clock):
    """Make the known plan's next state the first of the pairs; return its bound."""
    first, both, sign = pairs.after[0], 0.0, 1.0 if task.cross[t] >= 0 else -1.0
    for motor in range(2):
        k, m = task.known[motor, t + 1, 0], task.known[motor, t + 1, 1]
        row, column = k - motors.left[motor, t + 1], m - motors.first[motor, k]
        first.ids[motor] = reached.index[motor, row * motors.togo.shape[3] + column]
        first.moves[motor] = m - task.known[motor, t, 1]
        bound += motors.togo[motor, t + 1, row, column] - choices.least[motor, kept[0, motor]]
        both += (motors.places[motor, k] - task.wanted[motor, t]) * (1.0 if motor == 0 else sign)
    bound += abs(task.cross[t]) * both * both
    pairs.bounds[0], first.parent = bound, 0
    pair = first.ids[0] * reached.found.shape[2] + first.ids[1]
    pairs.slots[pair], pairs.stamp[pair] = 0, clock
    return bound


# Its many parameters are the records of the search and the numbers that are others for each state.
@inner(error_model="python")
def pair_choices(motors, task, choices, reached, pairs, kept, s, bound, t, clock, leader, slack, bar, total):
    """Pair what the motors can do from state ``s``: return the least bound, the bar above it, and how many pairs.

    Its numbers are those that a tick carries from state to state; as an array they would be read again each time.
    """
    a, b, then, room = kept[s, 0], kept[s, 1], clock & 1, reached.found.shape[2]
    weight, sign = abs(task.cross[t]), 1.0 if task.cross[t] >= 0 else -1.0
    for part in range(2 if task.parted else 1):
        for i in range(choices.many[0, a, part]):
            so_far = bound + choices.losses[0, a, part, i]
            if so_far > bar:
                break
            next_a, move_a = choices.ids[0, a, part, i], choices.moves[0, a, part, i]
            error_a = motors.places[0, reached.found[then, 0, next_a, 0]] - task.wanted[0, t]
            for j in range(choices.many[1, b, part]):
                value = so_far + choices.losses[1, b, part, j]
                if value > bar:
                    break
                next_b, move_b = choices.ids[1, b, part, j], choices.moves[1, b, part, j]
                if abs(move_a) + abs(move_b) > task.together:
                    continue
                both = error_a + sign * (motors.places[1, reached.found[then, 1, next_b, 0]] - task.wanted[1, t])
                value += weight * both * both
                if value > bar:
                    continue
                pair = next_a * room + next_b
                if pairs.stamp[pair] != clock:
                    if total == pairs.after.shape[0]:
                        continue
                    pairs.stamp[pair], pairs.slots[pair] = clock, total
                    new = pairs.after[total]
                    new.ids[0], new.ids[1], pairs.bounds[total] = next_a, next_b, np.inf
                    total += 1
                n = pairs.slots[pair]
                if value < pairs.bounds[n]:
                    pairs.bounds[n] = value
                    better = pairs.after[n]
                    better.parent, better.moves[0], better.moves[1] = s, move_a, move_b
                    if value < leader:
                        leader = value
                        bar = leader + slack
    return leader, bar, total


# Its many parameters are the four records of `follow` and the numbers that change hands from chunk to chunk.
@inner(error_model="python", _nrt=True)
def sweep(t0, t1, clock, slack, motors, task, choices, reached, pairs, kept, bounds, kept_count, way, base, used):
    """Go over ticks t0 to t1; return how many states are kept, how much of ``way`` is used, and the least bound.

    ``kept`` [N, 2] are the ids of the states in ``reached.found`` [clock & 1], with their ``bounds``, the known plan's
    first; ``way`` [?] of STEP and ``base`` [T] are what `follow` returns. These change hands at every chunk of ticks.
    """
    lowest = np.inf
    for n in range(kept_count):
        lowest = min(lowest, bounds[n])
    for t in range(t0, t1):
        clock += 1
        best, total = 0, 0
        reached.count[0] = reached.count[1] = 0
        for n in range(kept_count):
            if bounds[n] < bounds[best]:
                best = n
        bar, leader, reference = np.inf, np.inf, bounds[best]
        for turn in range(kept_count + 1):
            # The known plan, then the most promising state, which sets the bar, then the others.
            s = 0 if turn == 0 else best if turn == 1 else turn - 2 if turn - 2 < best else turn - 1
            if bounds[s] > bar and turn > 0:
                continue
            for motor in range(2):
                if choices.built[motor, kept[s, motor]] != clock:
                    list_choices(
                        motors, task, choices, reached, motor, kept[s, motor], t, clock, bar - reference
                    )  # fmt: skip
            if turn == 0:
                leader = follow_known(motors, task, choices, reached, pairs, kept, bounds[0], t, clock)
                bar, total = leader + slack, 1
            else:
                leader, bar, total = pair_choices(
                    motors, task, choices, reached, pairs, kept, s, bounds[s], t, clock, leader, slack, bar, total
                )
        if total > kept.shape[0]:
            bar = min(bar, np.partition(pairs.bounds[:total], kept.shape[0] - 1)[kept.shape[0] - 1])
        base[t], kept_count, lowest = used, 0, leader
        for n in range(total):
            if n == 0 or (pairs.bounds[n] <= bar and kept_count < kept.shape[0]):
                pair, step = pairs.after[n], way[used]
                kept[kept_count, 0], kept[kept_count, 1] = pair.ids[0], pair.ids[1]
                bounds[kept_count] = pairs.bounds[n]
                step.parent, step.moves[0], step.moves[1] = pair.parent, pair.moves[0], pair.moves[1]
                kept_count, used = kept_count + 1, used + 1
    return kept_count, used, lowest


# Long because what was left out in a chunk of ticks may have to be gone over again: what it began with is kept here.
@entry
def follow(states, paid, motors, task, slack, most, width):
    """Follow the states whose bounds are near the least, at most ``width``, for T targets.

    ``states`` [N, 2, 2] are (k, m) of both motors, the known plan's first, ``paid`` [N] what they have cost so far.

    Near means ``slack``. Where the least bound grew by more than the slack over two chunks of ticks, what was left out
    in them might have come out ahead: they are gone over again with that much slack, up to ``most``.

    Return the states and costs of the last tick, and the way there: states 0…N of tick t + 1 are those from base[t]
    on, whose parents are among tick t's states.
    """
    ticks, fan, room, corner = task.wanted.shape[1], 2 * task.reach + 1, 2 * width, motors.togo[0, 0].size
    choices = Choices(
        np.empty((2, room, 2, fan)), np.empty((2, room, 2, fan), np.int64), np.empty((2, room, 2, fan), np.int64),
        np.empty((2, room, 2), np.int64), np.empty((2, room)), np.full((2, room), -1), np.empty(fan),
    )  # fmt: skip
    found, index = np.empty((2, 2, room, 2), np.int64), np.empty((2, corner), np.int64)
    reached = Reached(found, index, np.full((2, corner), -1), np.zeros(2, np.int64))
    slots, stamp = np.empty(room * room, np.int32), np.full(room * room, -1, np.int32)
    pairs = Pairs(np.empty(16 * width, PAIR), np.empty(16 * width), slots, stamp)
    kept, bounds = np.empty((width, 2), np.int64), np.empty(width)
    way, base = np.empty(32 * ticks, STEP), np.empty(ticks, np.int64)
    # Typed: the sweep would be compiled once more for a literal zero.
    kept_count, clock, used, lowest = states.shape[0], np.int64(0), np.int64(0), np.inf
    for n in range(kept_count):
        bounds[n] = paid[n]
        for motor in range(2):
            k, m = states[n, motor, 0], states[n, motor, 1]
            kept[n, motor], found[0, motor, n, 0], found[0, motor, n, 1] = n, k, m
            bounds[n] += cost_to_go(motors, task.reach, motor, 0, k, m)
        lowest = min(lowest, bounds[n])
    chunks = (ticks + _CHUNK_TICKS - 1) // _CHUNK_TICKS
    slacks, starts = np.full(chunks, slack), np.empty(chunks)
    # What there was at the start of the last two chunks.
    saved, saved_bounds, saved_count = np.empty((2, width, 2, 2), np.int64), np.empty((2, width)), np.empty(2, np.int64)
    chunk, newest = 0, 0
    while chunk < chunks:
        starts[chunk], saved_count[chunk % 2] = lowest, kept_count
        for n in range(kept_count):
            saved_bounds[chunk % 2, n] = bounds[n]
            for motor in range(2):
                saved[chunk % 2, n, motor] = found[clock & 1, motor, kept[n, motor]]
        t0, t1 = chunk * _CHUNK_TICKS, min((chunk + 1) * _CHUNK_TICKS, ticks)
        if used + _CHUNK_TICKS * width > way.shape[0]:
            longer = np.empty(2 * way.shape[0] + _CHUNK_TICKS * width, STEP)
            for n in range(used):
                longer[n] = way[n]
            way = longer
        kept_count, used, lowest = sweep(
            t0,
            t1,
            clock,
            slacks[chunk],
            motors,
            task,
            choices,
            reached,
            pairs,
            kept,
            bounds,
            kept_count,
            way,
            base,
            used,
        )
        clock += t1 - t0
        begin = max(chunk - 1, 0)
        narrow = min(slacks[begin], slacks[chunk])
        if chunk == newest and lowest - starts[begin] > narrow and narrow < most:
            slacks[begin] = slacks[chunk] = min(lowest - starts[begin], most)
            chunk, kept_count, used, lowest = begin, saved_count[begin % 2], base[begin * _CHUNK_TICKS], starts[begin]
            for n in range(kept_count):
                bounds[n] = saved_bounds[begin % 2, n]
                for motor in range(2):
                    kept[n, motor] = n
                    found[clock & 1, motor, n] = saved[begin % 2, n, motor]
        else:
            chunk += 1
            newest = max(newest, chunk)
    states, paid = np.empty((kept_count, 2, 2), np.int64), np.empty(kept_count)
    for n in range(kept_count):
        paid[n] = bounds[n]
        for motor in range(2):
            k, m = found[clock & 1, motor, kept[n, motor], 0], found[clock & 1, motor, kept[n, motor], 1]
            states[n, motor, 0], states[n, motor, 1] = k, m
            paid[n] -= cost_to_go(motors, task.reach, motor, ticks, k, m)
    return states, paid, base, way[:used]


@entry
def way_back(base, way, state, out):
    """Fill out [T, 2] with both motors' moves that lead to ``state`` of the last tick; return its first ancestor."""
    for t in range(base.shape[0] - 1, -1, -1):
        step = way[base[t] + state]
        out[t, 0], out[t, 1] = step.moves[0], step.moves[1]
        state = step.parent
    return state
