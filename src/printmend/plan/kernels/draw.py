"""Compiled pieces of an extruding move: slack taken up, then chords or arcs, and what each of them prints."""

import numpy as np

from printmend.gcode.kernels.layout import (
    FLAG_CHECKSUM,
    FLAG_G53,
    FLAG_INCH,
    FLAG_MIXED,
    FLAG_NUMBERED,
    PIECE_ARC,
    PIECE_LINE,
    PIECE_TRAVEL,
    TELL_MASK,
    TELL_NOTHING,
    TELL_SHIFT,
)
from printmend.jit import inner
from printmend.plan.kernels.chord import (
    arc,
    chord,
    on_arc,
)
from printmend.plan.kernels.curve import (
    distance,
    is_flat_arc,
    norm,
    place,
)
from printmend.plan.kernels.layout import (
    ASTRAY_MM,
    ASTRAY_PER_CHORD,
    CLAMP_MM,
    FASTER_CROSSING,
    HOLD_MM,
    LOOK_CLOSER_MM,
    NEAR_MM,
    SAME_FEED,
)
from printmend.plan.kernels.lookup import (
    LOWER,
    UPPER,
    backward,
    from_motors,
    printed,
    to_motors,
    wanted,
)
from printmend.plan.kernels.predict import (
    note,
    samples_of,
    with_doubt,
)
from printmend.plan.kernels.state import (
    arrive,
    command,
    count_held,
    is_sure,
    middle,
    motor_at,
    open_interval,
    prepare,
)

# Places and weights of Gauss's quadrature with three places: exact for the square of a parabola, a chord's error.
_NO_LINE_BEFORE = FLAG_CHECKSUM | FLAG_G53 | FLAG_INCH | FLAG_MIXED | FLAG_NUMBERED
GAUSS_PLACES = (0.1127016653792583, 0.5, 0.8872983346207417)
GAUSS_WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)


@inner
def put(pieces, n, kind, x, y, z, share, feed):
    """Write piece n without an arc's centre; return the number of the next."""
    p = pieces[n]
    p.kind, p.x, p.y, p.z, p.share, p.feed, p.accel = kind, x, y, z, share, feed, 0.0
    p.c0 = p.c1 = np.nan
    return n + 1


@inner
def _feed(state, record, ratio):
    """Return the F for a command ``ratio`` times as long as its path; a change too small to see keeps the last F."""
    feed = record.feed * min(max(ratio, 0.2), 5.0)
    if abs(feed - record.feed) <= SAME_FEED * record.feed:
        feed = record.feed
    elif abs(feed - state.feed) <= SAME_FEED * feed:
        feed = state.feed
    elif feed > 200.0:
        feed = np.rint(feed)
    state.feed = feed
    return feed


@inner
def _crossing_accel(model, counts, record, d0, d1, loose0, loose1):
    """Return the acceleration [mm/s²] of a command by (d0, d1) mm of the motors; 0 keeps the file's own.

    A ``loose`` motor drives nothing, so it may accelerate as the printer's owner allows. The other one keeps to the
    file's acceleration.
    """
    if not model.head.crossing > record.accel or not record.accel > 0.0:
        return 0.0
    if record.flags & _NO_LINE_BEFORE or (record.flags >> TELL_SHIFT) & TELL_MASK == TELL_NOTHING:
        return 0.0
    if record.next == record.end:  # another statement stands on its line
        return 0.0
    most = model.head.crossing
    x, y = from_motors(model, d0, d1)
    length = norm(x, y)
    for k in range(2):
        way, loose = (abs(d0), loose0) if k == 0 else (abs(d1), loose1)
        limit = model.head.crossing if loose else record.accel
        if way * most > limit * length:
            most = limit * length / way
    if most < FASTER_CROSSING * record.accel:
        return 0.0
    counts.hurried += 1
    return np.rint(most)


# From here on the many parameters are the arrays of one file's way through `mend`, the record in hand, a piece's end.
@inner
def _dead_move(model, state, counts, pieces, n, record, m0, m1, z, quantum, loose):
    """Write a move that extrudes nothing and during which the nozzle stands still, or comes to its place.

    ``loose`` says that no motor drives its belt on this move.
    """
    if m0 == state.mended.m[0] and m1 == state.mended.m[1]:
        return n
    x, y, m0, m1, _ = command(model, m0, m1, record, quantum)
    if abs(m0 - state.mended.m[0]) + abs(m1 - state.mended.m[1]) <= quantum:
        return n
    d0, d1 = m0 - state.mended.m[0], m1 - state.mended.m[1]
    arrive(model, state, m0, m1)
    state.feed = max(state.travel_feed, record.feed)
    n = put(pieces, n, PIECE_TRAVEL, x, y, z, 0.0, state.feed)
    if loose:
        pieces[n - 1].accel = _crossing_accel(model, counts, record, d0, d1, True, True)
    return n


@inner
def draw(model, curve, state, pieces, n, record, kind, t, end, m0, m1, x, y, row, layers, errors):
    """Write the piece of an extruding move from t to end, and add up its error; ``state`` holds an arc's centre."""
    length = (end - t) * curve.length
    from0, from1 = state.mended.m[0], state.mended.m[1]
    _, _, end_z = place(curve, end)
    from_x, from_y = from_motors(model, from0, from1)
    samples = samples_of(model, length)
    fine = state.error > LOOK_CLOSER_MM  # a chord bulges: its middle alone would stand for more than its error
    places = 3 if fine else 1
    most = 0.0
    for j in range(places * samples):
        gauss = j % 3 if fine else 1
        s = (j // places + GAUSS_PLACES[gauss]) / samples
        if kind == PIECE_ARC:
            arc_x, arc_y = on_arc(from_x, from_y, x, y, state.arc_center, state.arc_sweep, s)
            a, b = to_motors(model, arc_x, arc_y)
            arrive(model, state, a, b)
        else:
            arrive(model, state, from0 + s * (m0 - from0), from1 + s * (m1 - from1))
        at_x, at_y = printed(model, middle(state, 0), middle(state, 1))
        error, _ = distance(curve, at_x, at_y)
        most = max(most, error)
        error = with_doubt(state.mended, error)
        note(layers, row, errors, 1, error, length / samples * (GAUSS_WEIGHTS[gauss] if fine else 1.0))
    state.error = most
    arrive(model, state, m0, m1)
    if most > LOOK_CLOSER_MM:
        at_x, at_y = printed(model, middle(state, 0), middle(state, 1))
        error, _ = distance(curve, at_x, at_y)
        note(layers, row, errors, 1, error, 0.0)
    ratio = 1.0
    if kind == PIECE_LINE and length > 1e-4:
        rise = end_z - place(curve, t)[2]
        ratio = np.sqrt((x - from_x) ** 2 + (y - from_y) ** 2 + rise * rise) / length
    n = put(pieces, n, kind, x, y, end_z, (end - t) * curve.share, _feed(state, record, ratio))
    if kind == PIECE_ARC:
        pieces[n - 1].c0, pieces[n - 1].c1 = state.arc_center[0], state.arc_center[1]
    return n


@inner
def _arc(model, curve, state, pieces, n, record, t, stop, mode0, mode1, row, layers, errors, quantum):
    """Write the stretch of an arc as an arc, shifted by the play's sides; nothing where it would not fit."""
    x0, y0, _ = place(curve, t)
    x1, y1, _ = place(curve, stop)
    s0, s1 = wanted(model, x0, y0)
    e0, e1 = wanted(model, x1, y1)
    m0, m1 = motor_at(model, state, 0, mode0, e0), motor_at(model, state, 1, mode1, e1)
    # The stretch must begin and end at the same shift, or the radii would differ.
    if (
        abs(m0 - e0 - (state.mended.m[0] - s0)) > 2.1 * HOLD_MM
        or abs(m1 - e1 - (state.mended.m[1] - s1)) > 2.1 * HOLD_MM
    ):
        return n
    shift_x, shift_y = from_motors(model, m0 - e0, m1 - e1)
    x, y, m0, m1, clamp = command(model, m0, m1, record, quantum)
    if clamp > quantum:
        return n
    # A quarter's outermost places are its ends: they being inside the bed, all of it is.
    state.arc_center[0], state.arc_center[1] = curve.ca + shift_x, curve.cb + shift_y
    state.arc_sweep = (stop - t) * curve.sweep
    return draw(model, curve, state, pieces, n, record, PIECE_ARC, t, stop, m0, m1, x, y, row, layers, errors)


@inner
def _next_turn_place(run, k, s):
    """Pass the turns of motor k that end at s of the run or before; return where the next one begins, bends or ends."""
    turns, next_turn = run.turns[k], run.turn[k]
    while turns[next_turn].end <= s + NEAR_MM:
        run.trend[k] = turns[next_turn].trend
        next_turn += 1
    run.turn[k] = next_turn
    turn = turns[next_turn]
    if turn.begin > s + NEAR_MM:
        return turn.begin
    return turn.corner if s + NEAR_MM < turn.corner < turn.end else turn.end


@inner
def _overshoot(run, k, s):
    """Return how far motor k's belt must overshoot at s of the run, where its next turn begins."""
    turn = run.turns[k, run.turn[k]]
    return turn.tip if abs(turn.begin - s) <= NEAR_MM else 0.0


@inner
def _engage(model, state, counts, run, k, start, end, s, stop, begin, span):
    """Choose how motor k goes from belt ``start`` to ``end``, from s to ``stop`` of the run; as `prepare`.

    ``begin`` and ``span`` say where on the run the curve begins, and how long it is.
    """
    m = state.mended.m[k]
    turn = run.turns[k, run.turn[k]]
    state.crossing[k] = 0.0
    anywhere = counts.anywhere != 0
    if turn.begin > s + NEAR_MM or anywhere or not is_sure(state, k):
        hold = 2.0 * model.head.chord
        return prepare(model, state, k, start, end, anywhere, run.trend[k], hold)
    if np.isnan(turn.motor_begin):
        trend, rise = turn.trend, turn.rise
        now = middle(state, k)
        if trend * rise > 0.0:
            now += rise
        to = backward(model, k, LOWER if trend > 0 else UPPER, now)
        turn.motor_begin, turn.motor_end = m, to if trend * (to - m) > 0.0 else m
        counts.takeups += 1
    at, to, corner = turn.begin, turn.end, turn.corner
    m_at, m_to = turn.motor_begin, turn.motor_end
    if at < corner < to:
        m_corner = m_at + turn.share * (m_to - m_at)
        if s > corner - NEAR_MM:
            at, m_at = corner, m_corner
        else:
            to, m_to = corner, m_corner
    # A place nearly here counts as here: a crossing stretched to reach it would send the motor too far.
    at, to = s if abs(at - s) <= NEAR_MM else at, stop if abs(to - stop) <= NEAR_MM else to
    slope = (m_to - m_at) / (to - at)
    state.cross[k] = m_at + slope * (begin - at)
    state.crossing[k] = slope * span
    return 0, m, m


# Long because a stretch is engaged, drawn as arcs or chords, and judged with the same dozen numbers.
@inner
def extrude(model, curve, state, counts, pieces, n, record, row, layers, errors, quantum, run, begin, span):
    """Write an extruding move: slack, then chords (or arcs) along each stretch in which no motor turns back.

    ``begin`` and ``span`` say where on the ``run`` the curve begins, and how long it is there.
    """
    t = 0.0
    length = curve.length
    while t < 1.0:
        s = begin + t * span
        stop = (min(_next_turn_place(run, 0, s), _next_turn_place(run, 1, s)) - begin) / span
        if not (1.0 - stop) * span > NEAR_MM:
            stop = 1.0
        x, y, z = place(curve, t)
        s0, s1 = wanted(model, x, y)
        x, y, _ = place(curve, stop)
        e0, e1 = wanted(model, x, y)
        last = begin + stop * span
        e0, e1 = e0 + _overshoot(run, 0, last), e1 + _overshoot(run, 1, last)
        anywhere = counts.anywhere != 0
        unsure = anywhere or not is_sure(state, 0) or not is_sure(state, 1)
        mode0, first0, second0 = _engage(model, state, counts, run, 0, s0, e0, s, last, begin, span)
        mode1, first1, second1 = _engage(model, state, counts, run, 1, s1, e1, s, last, begin, span)
        before = n
        n = _dead_move(model, state, counts, pieces, n, record, first0, first1, z, quantum, False)
        if anywhere:
            open_interval(model, state.mended)
            counts.anywhere = 0
        n = _dead_move(model, state, counts, pieces, n, record, second0, second1, z, quantum, not unsure)
        for k in range(2):
            if state.crossing[k] == 0.0:
                state.cross[k] = state.mended.m[k]
        counts.anchors += unsure
        counts.takeups += n > before and not unsure
        counts.stops += n > before and s > 0.0
        if mode0 != 0 and mode1 != 0 and is_flat_arc(curve) and model.head.shifts_only != 0.0:
            done = _arc(model, curve, state, pieces, n, record, t, stop, mode0, mode1, row, layers, errors, quantum)
            if done > n:
                n, t = done, stop
                continue
        is_arc = mode0 != 0 and mode1 != 0 and is_flat_arc(curve)
        while t < stop:
            if is_arc:
                end, m0, m1 = arc(model, curve, state, mode0, mode1, t, stop, e0, e1, record, quantum)
                if end > t:
                    x, y, m0, m1, _ = command(model, m0, m1, record, quantum)
                    n = draw(
                        model, curve, state, pieces, n, record, PIECE_ARC, t, end, m0, m1, x, y, row, layers, errors
                    )
                    t = end
                    continue
            end, m0, m1 = chord(model, curve, state, mode0, mode1, t, stop, e0, e1, record.advance * curve.share)
            x, y, m0, m1, clamp = command(model, m0, m1, record, quantum)
            d0, d1 = m0 - state.mended.m[0], m1 - state.mended.m[1]
            n = draw(model, curve, state, pieces, n, record, PIECE_LINE, t, end, m0, m1, x, y, row, layers, errors)
            loose0, loose1 = state.crossing[0] != 0.0, state.crossing[1] != 0.0
            if loose0 or loose1:
                pieces[n - 1].accel = _crossing_accel(model, counts, record, d0, d1, loose0, loose1)
            # If the edge of the bed held back the way to its start already, only the error shows it.
            if clamp > CLAMP_MM or state.error > max(ASTRAY_MM, ASTRAY_PER_CHORD * model.head.chord):
                count_held(counts, record, True)
                state.beyond = max(state.beyond, clamp, state.error)
                state.held[1 if record.layer > 0 else 0] += (end - t) * length
            elif state.error > 3.0 * model.head.chord:
                counts.coarse += 1
            t = end
    return n
