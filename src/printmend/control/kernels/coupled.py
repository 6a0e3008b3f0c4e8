"""Dynamic programming over two coupled motors, guided by each motor's own least cost to go. Checks: coupled.py.

States as in optimal.py: a motor index m and the place k where the belt stands, for both motors. The cost of a tick is

    w_a e_a² + w_b e_b² + |c| (e_a ± e_b)²          e: the distance of a belt from its target, ± the sign of c

so what each motor would cost alone, with w_a or w_b, never exceeds what both cost together: cost so far + both costs to
go bounds every plan through a state from below. The motors of a CoreXY move both by an even or both by an odd number of
steps. A price on odd indices, which one motor pays to the other, leaves the cost of both as it is; the right one makes
the bound nearly tight.

A state whose bound lies more than a slack above the least of its tick is left out. Along every way bounds grow, by what
the motors' choices lose against their own best. So few choices of a state need to be looked at: those of least loss.

Arrays of both motors have an axis of length 2, padded where one motor has less. All arrays are passed one by one: in a
tuple each access would count references.
"""

import numpy as np

from printmend.jit import entry, inner

# Ticks between the places to which a search may go back.
_CHUNK = 16


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
                for n in range(count):
                    begin, end = max(n - reach, 0), min(n + reach, count - 1)
                    row[n] = before[end] if begin == 0 else behind[begin]
                    if count > window and begin // window != end // window:
                        row[n] = min(row[n], before[end])
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


@inner
def cost_to_go(motor, t, k, m, reach, first, low, high, size, left, right, togo):
    """Return one motor's least cost to go from state (k, m) of tick t."""
    if t + 1 == togo.shape[1]:
        return 0.0
    least = np.inf
    for m1 in range(max(m - reach, 0), min(m + reach + 1, size[motor])):
        k1 = min(max(k, low[motor, m1]), high[motor, m1])
        if left[motor, t + 1] <= k1 < right[motor, t + 1]:
            least = min(least, togo[motor, t + 1, k1 - left[motor, t + 1], m1 - first[motor, k1]])
    return least


@inner
def sweep(
    t0, t1, clock, slack, reach, together, parted, places, first, low, high, size, left, right, wanted, cross, togo,
    known, found, index, stamp, losses, ids, moves, many, least, built, costs, slots, slot_stamp, after, after_bounds,
    kept, bounds, kept_count, way, base, used,
):  # fmt: skip
    """Go over ticks t0 to t1; return how many states are kept, how much of ``way`` is used, and the least bound.

    ``kept`` [N, 2] are the ids of the states in ``found`` [clock & 1], with their ``bounds``, the known plan's first.
    What one motor can do from a state that it is in at a tick is listed once: ``losses``, ``ids`` of where that leads
    and ``moves`` [2, N, 2, F], the least loss first, the odd moves apart where ``parted``; ``many`` [2, N, 2] of them,
    ``least`` [2, N] the cost to go. All in one loop: to pass the arrays on takes longer than what is done with them.
    """
    room, lowest = found.shape[2], np.inf
    for n in range(kept_count):
        lowest = min(lowest, bounds[n])
    for t in range(t0, t1):
        now, after_now = clock & 1, 1 - (clock & 1)
        clock += 1
        best, count_a, count_b, total = 0, 0, 0, 0
        weight, sign = abs(cross[t]), 1.0 if cross[t] >= 0 else -1.0
        for n in range(kept_count):
            if bounds[n] < bounds[best]:
                best = n
        bar, leader, reference = np.inf, np.inf, bounds[best]
        for turn in range(kept_count + 1):
            # The known plan, then the most promising state, which sets the bar, then the others.
            s = 0 if turn == 0 else best if turn == 1 else turn - 2 if turn - 2 < best else turn - 1
            bound = bounds[s]
            if bound > bar and turn > 0:
                continue
            for motor in range(2):
                state = kept[s, motor]
                if built[motor, state] == clock:
                    continue
                built[motor, state] = clock
                k, m = found[now, motor, state, 0], found[now, motor, state, 1]
                begin, end = max(m - reach, 0), min(m + reach + 1, size[motor])
                left1, right1 = left[motor, t + 1], right[motor, t + 1]
                dearest, cheapest = bar - reference, np.inf
                for m1 in range(begin, end):
                    k1 = min(max(k, low[motor, m1]), high[motor, m1])
                    cost = np.inf
                    if left1 <= k1 < right1:
                        cost = togo[motor, t + 1, k1 - left1, m1 - first[motor, k1]]
                    costs[m1 - begin] = cost
                    cheapest = min(cheapest, cost)
                least[motor, state] = cheapest
                many[motor, state, 0] = many[motor, state, 1] = 0
                for m1 in range(begin, end):
                    loss = costs[m1 - begin] - cheapest
                    if not (loss <= dearest and loss < np.inf):
                        continue
                    k1 = min(max(k, low[motor, m1]), high[motor, m1])
                    at = (k1 - left1) * togo.shape[3] + m1 - first[motor, k1]
                    if stamp[motor, at] != clock:
                        count = count_a if motor == 0 else count_b
                        if count == room:
                            continue
                        stamp[motor, at], index[motor, at] = clock, count
                        found[after_now, motor, count, 0], found[after_now, motor, count, 1] = k1, m1
                        if motor == 0:
                            count_a += 1
                        else:
                            count_b += 1
                    part = (m1 - m) & 1 if parted else 0
                    n = many[motor, state, part]
                    while n > 0 and losses[motor, state, part, n - 1] > loss:
                        losses[motor, state, part, n] = losses[motor, state, part, n - 1]
                        ids[motor, state, part, n] = ids[motor, state, part, n - 1]
                        moves[motor, state, part, n] = moves[motor, state, part, n - 1]
                        n -= 1
                    losses[motor, state, part, n] = loss
                    ids[motor, state, part, n], moves[motor, state, part, n] = index[motor, at], m1 - m
                    many[motor, state, part] += 1
            if turn == 0:
                both, leader = 0.0, bound
                for motor in range(2):
                    k, m = known[motor, t + 1, 0], known[motor, t + 1, 1]
                    row, column = k - left[motor, t + 1], m - first[motor, k]
                    after[0, motor] = index[motor, row * togo.shape[3] + column]
                    after[0, 3 + motor] = m - known[motor, t, 1]
                    leader += togo[motor, t + 1, row, column] - least[motor, kept[0, motor]]
                    both += (places[motor, k] - wanted[motor, t]) * (1.0 if motor == 0 else sign)
                leader += weight * both * both
                bar, total, after_bounds[0], after[0, 2] = leader + slack, 1, leader, 0
                pair = after[0, 0] * room + after[0, 1]
                slots[pair], slot_stamp[pair] = 0, clock
                continue
            a, b = kept[s, 0], kept[s, 1]
            for part in range(2 if parted else 1):
                for i in range(many[0, a, part]):
                    so_far = bound + losses[0, a, part, i]
                    if so_far > bar:
                        break
                    next_a, move_a = ids[0, a, part, i], moves[0, a, part, i]
                    error_a = places[0, found[after_now, 0, next_a, 0]] - wanted[0, t]
                    for j in range(many[1, b, part]):
                        value = so_far + losses[1, b, part, j]
                        if value > bar:
                            break
                        next_b, move_b = ids[1, b, part, j], moves[1, b, part, j]
                        if abs(move_a) + abs(move_b) > together:
                            continue
                        both = error_a + sign * (places[1, found[after_now, 1, next_b, 0]] - wanted[1, t])
                        value += weight * both * both
                        if value > bar:
                            continue
                        pair = next_a * room + next_b
                        if slot_stamp[pair] != clock:
                            if total == after.shape[0]:
                                continue
                            slot_stamp[pair], slots[pair] = clock, total
                            after[total, 0], after[total, 1], after_bounds[total] = next_a, next_b, np.inf
                            total += 1
                        n = slots[pair]
                        if value < after_bounds[n]:
                            after_bounds[n] = value
                            after[n, 2], after[n, 3], after[n, 4] = s, move_a, move_b
                            if value < leader:
                                leader = value
                                bar = leader + slack
        if total > kept.shape[0]:
            bar = min(bar, np.partition(after_bounds[:total], kept.shape[0] - 1)[kept.shape[0] - 1])
        base[t], kept_count, lowest = used, 0, leader
        for n in range(total):
            if n == 0 or (after_bounds[n] <= bar and kept_count < kept.shape[0]):
                kept[kept_count, 0], kept[kept_count, 1] = after[n, 0], after[n, 1]
                bounds[kept_count] = after_bounds[n]
                way[used, 0], way[used, 1], way[used, 2] = after[n, 2], after[n, 3], after[n, 4]
                kept_count, used = kept_count + 1, used + 1
    return kept_count, used, lowest


@entry
def search(
    states, paid, reach, together, parted, slack, most, width,
    places, first, low, high, size, left, right, wanted, cross, togo, known,
):  # fmt: skip
    """Follow the states whose bounds are near the least, at most ``width``, for T targets.

    ``states`` [N, 2, 2] are (k, m) of both motors, the known plan's first, ``paid`` [N] what they have cost so far. A
    control moves a motor by at most ``reach`` and both by at most ``together``; where ``parted``, both by an even or
    both by an odd number. The motors' tables end at ``size`` [2]; ``known`` [2, T + 1, 2] are the known plan's states.

    Near means ``slack``. Where the least bound grew by more than the slack over two chunks of ticks, what was left out
    in them might have come out ahead: they are gone over again with that much slack, up to ``most``.

    Return the states and costs of the last tick, and the way there: states 0…N of tick t + 1 are the rows from base[t]
    of (their parents among tick t's states, the moves of a, of b).
    """
    ticks, fan, room = wanted.shape[1], 2 * reach + 1, 2 * width
    losses, costs, least = np.empty((2, room, 2, fan)), np.empty(fan), np.empty((2, room))
    ids, moves = np.empty((2, room, 2, fan), np.int64), np.empty((2, room, 2, fan), np.int64)
    many, built, found = np.empty((2, room, 2), np.int64), np.full((2, room), -1), np.empty((2, 2, room, 2), np.int64)
    index, stamp = np.empty((2, togo[0, 0].size), np.int64), np.full((2, togo[0, 0].size), -1)
    slots, slot_stamp = np.empty(room * room, np.int32), np.full(room * room, -1, np.int32)
    kept, bounds = np.empty((width, 2), np.int64), np.empty(width)
    after, after_bounds = np.empty((16 * width, 5), np.int64), np.empty(16 * width)
    way, base = np.empty((32 * ticks, 3), np.int32), np.empty(ticks, np.int64)
    # Typed: the sweep would be compiled once more for a literal zero.
    kept_count, clock, used, lowest = states.shape[0], np.int64(0), np.int64(0), np.inf
    for n in range(kept_count):
        bounds[n] = paid[n]
        for motor in range(2):
            k, m = states[n, motor, 0], states[n, motor, 1]
            kept[n, motor], found[0, motor, n, 0], found[0, motor, n, 1] = n, k, m
            bounds[n] += cost_to_go(motor, 0, k, m, reach, first, low, high, size, left, right, togo)
        lowest = min(lowest, bounds[n])
    chunks = (ticks + _CHUNK - 1) // _CHUNK
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
        t0, t1 = chunk * _CHUNK, min((chunk + 1) * _CHUNK, ticks)
        if used + _CHUNK * width > way.shape[0]:
            longer = np.empty((2 * way.shape[0] + _CHUNK * width, 3), np.int32)
            longer[:used] = way[:used]
            way = longer
        kept_count, used, lowest = sweep(
            t0, t1, clock, slacks[chunk], reach, together, parted, places, first, low, high, size, left, right, wanted,
            cross, togo, known, found, index, stamp, losses, ids, moves, many, least, built, costs, slots, slot_stamp,
            after, after_bounds, kept, bounds, kept_count, way, base, used,
        )  # fmt: skip
        clock += t1 - t0
        begin = max(chunk - 1, 0)
        narrow = min(slacks[begin], slacks[chunk])
        if chunk == newest and lowest - starts[begin] > narrow and narrow < most:
            slacks[begin] = slacks[chunk] = min(lowest - starts[begin], most)
            chunk, kept_count, used, lowest = begin, saved_count[begin % 2], base[begin * _CHUNK], starts[begin]
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
            paid[n] -= cost_to_go(motor, ticks, k, m, reach, first, low, high, size, left, right, togo)
    return states, paid, base, way[:used]


@entry
def way_back(base, way, state, out):
    """Fill out [T, 2] with both motors' moves that lead to ``state`` of the last tick; return its first ancestor."""
    for t in range(base.shape[0] - 1, -1, -1):
        at = base[t] + state
        out[t, 0], out[t, 1] = way[at, 1], way[at, 2]
        state = way[at, 0]
    return state
