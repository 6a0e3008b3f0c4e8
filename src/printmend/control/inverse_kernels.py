"""Compiled continuous planner: the moves of a G-code file in, the commands that make a broken printer draw them out.

Per motor the state is (m, u): its commanded position and where play has left the belt, kept as an interval lo…hi when
that is uncertain. Going forwards u = lower(m), so m = lower⁻¹(u*); backwards m = upper⁻¹(u*) (physics.md eq. 7, §6).
At a reversal the slack is taken up by a move without extrusion, during which the nozzle stands still.
The same pass simulates the file as it is and as it is written, and adds up the distance to the wanted path.
"""

import numpy as np
from numba import njit

from printmend.control.inverse_curve_kernels import (
    CA,
    CB,
    CURVE,
    LENGTH,
    PLANE,
    R0,
    SWEEP,
    aside_and_along,
    distance,
    is_flat_arc,
    line_distance,
    monotone_end,
    norm,
    place,
    set_arc,
    set_line,
)
from printmend.control.inverse_lookup_kernels import (
    LOWER,
    M_BED,
    M_FRAMED,
    M_SAMPLE,
    M_SHIFTS_ONLY,
    UPPER,
    backward,
    forward,
    from_motors,
    is_taut,
    printed,
    sharpest,
    to_motors,
    wanted,
)
from printmend.gcode.kernels import (
    EVENT_EXCLUDE,
    EVENT_OFFSET,
    FLAG_EXTRUDING,
    FLAG_KNOWN_X1,
    FLAG_KNOWN_Y1,
    FLAG_OPAQUE,
    FLAG_RELATIVE,
    KIND_CCW,
    KIND_CW,
    KIND_EVENT,
    KIND_HOME,
    KIND_LINEAR,
    KIND_SET,
    PIECE_ARC,
    PIECE_LINE,
    PIECE_TRAVEL,
)

CHORD_MM = 0.005  # how far a chord may lie from the wanted path
ALONG = 10.0  # times that: how far it may be ahead or behind, so that the extrusion keeps its density
HOLD_MM = 0.005  # a reversal shorter than this is not worth taking slack up for
MIN_PIECE_MM = 0.05  # firmwares drop or merge shorter moves
SAME_FEED = 0.005  # a change of speed below half a percent is not worth a word
PIECES_A_RECORD = 16384
FILAMENT_AREA_MM2 = 2.405  # of 1.75 mm
MAX_AREA_MM2 = 0.63  # Klipper's max_extrude_cross_section for a 0.4 mm nozzle is 0.64
TINY_ADVANCE_MM = 0.1  # Klipper lets any shorter extrusion pass
SAMPLE_MM = 1.0  # the prediction looks at the path at least this often
WALK_MM = 4.0  # and for the nearest place of the path this far around
ERROR_BINS, ERROR_BIN_MM = 8192, 0.001

# state [STATE] float64
S_M, S_LO, S_HI, S_RAW_LO, S_RAW_HI, S_TRAVEL, S_FEED, S_Z, S_LOW, S_HIGH = 0, 2, 4, 6, 8, 10, 11, 12, 13, 15
STATE = 17
# counts [COUNTS] int64
N_KNOWN, N_ANYWHERE, N_MARK, N_LAYER, N_MOVES, N_PIECES, N_TAKEUPS, N_ANCHORS = range(8)
N_CLAMPED, N_CLAMPED_EXTRUDING, N_UNKNOWN, N_COPIED, N_EXTRUDING = range(8, 13)
COUNTS = 13
# layers [?, LAYER] float64: sums over a layer, before (0) and after (1)
L_Z, L_LENGTH, L_SQUARE, L_MOST = 0, 1, 2, 4
LAYER = 6


@njit(error_model="numpy")
def _note(layers, row, errors, which, error, weight):
    """Add one sample of the contour error."""
    layers[row, L_SQUARE + which] += weight * error * error
    layers[row, L_MOST + which] = max(layers[row, L_MOST + which], error)
    errors[which, min(np.int64(error / ERROR_BIN_MM), ERROR_BINS - 1)] += weight


@njit(error_model="numpy")
def _open_interval(model, state, at):
    """The belts may be anywhere in their play: both intervals become the whole play. ``at`` is S_LO or S_RAW_LO."""
    for k in range(2):
        state[at + k] = forward(model, k, LOWER, state[S_M + k])
        state[at + 2 + k] = forward(model, k, UPPER, state[S_M + k])


@njit(error_model="numpy")
def _middle(state, k):
    return (state[S_LO + k] + state[S_HI + k]) / 2


@njit(error_model="numpy")
def _is_sure(state, k):
    return state[S_HI + k] - state[S_LO + k] <= HOLD_MM


@njit(error_model="numpy")
def _command(model, state, counts, m0, m1, record, quantum):
    """Round and clamp the command for motors (m0, m1): return (x, y, m0, m1, how far it was clamped)."""
    x, y = from_motors(model, m0, m1)
    low_x, high_x = min(model[M_BED], record.x0, record.x1), max(model[M_BED + 1], record.x0, record.x1)
    low_y, high_y = min(model[M_BED + 2], record.y0, record.y1), max(model[M_BED + 3], record.y0, record.y1)
    inside_x, inside_y = min(max(x, low_x), high_x), min(max(y, low_y), high_y)
    clamp = max(abs(inside_x - x), abs(inside_y - y))
    # What is written unchanged must be the same number: the writer then leaves it as it is.
    x = record.x1 if abs(inside_x - record.x1) <= quantum / 2 else np.rint(inside_x / quantum) * quantum
    y = record.y1 if abs(inside_y - record.y1) <= quantum / 2 else np.rint(inside_y / quantum) * quantum
    m0, m1 = to_motors(model, x, y)
    return x, y, m0, m1, clamp


@njit(error_model="numpy")
def _pull(model, state, at, m0, m1):
    """Move the motors to (m0, m1) and the belts with them (physics.md eq. 7); ``at`` is S_LO or S_RAW_LO."""
    for k in range(2):
        m = m0 if k == 0 else m1
        lower = forward(model, k, LOWER, m)
        upper = lower if is_taut(model, k) else forward(model, k, UPPER, m)
        state[at + k] = min(max(state[at + k], lower), upper)
        state[at + 2 + k] = min(max(state[at + 2 + k], lower), upper)


@njit(error_model="numpy")
def _arrive(model, state, m0, m1):
    """Move the motors, and what they pull."""
    state[S_M], state[S_M + 1] = m0, m1
    _pull(model, state, S_LO, m0, m1)


@njit(error_model="numpy")
def _put(pieces, n, kind, x, y, z, share, feed):
    p = pieces[n]
    p.kind, p.x, p.y, p.z, p.share, p.feed = kind, x, y, z, share, feed
    p.c0 = p.c1 = np.nan
    return n + 1


@njit(error_model="numpy")
def _feed(state, record, ratio):
    """Return the F that keeps the speed along the wanted path; a change that nobody can see is not written."""
    feed = record.feed * min(max(ratio, 0.2), 5.0)
    if abs(feed - record.feed) <= SAME_FEED * record.feed:
        feed = record.feed
    elif abs(feed - state[S_FEED]) <= SAME_FEED * feed:
        feed = state[S_FEED]
    elif feed > 200.0:
        feed = np.rint(feed)
    state[S_FEED] = feed
    return feed


@njit(error_model="numpy")
def _dead_move(model, state, counts, pieces, n, record, m0, m1, z, quantum):
    """Write a move that extrudes nothing and for which the nozzle stands still (or is put in its place)."""
    x, y, m0, m1, _ = _command(model, state, counts, m0, m1, record, quantum)
    if abs(m0 - state[S_M]) + abs(m1 - state[S_M + 1]) <= quantum:
        return n
    _arrive(model, state, m0, m1)
    state[S_FEED] = max(state[S_TRAVEL], record.feed)
    return _put(pieces, n, PIECE_TRAVEL, x, y, z, 0.0, state[S_FEED])


@njit(error_model="numpy")
def _prepare(model, state, k, start, end, anywhere):
    """Choose how motor k goes from belt position ``start`` to ``end``.

    Returns (mode, first, second): mode 1 pushes (lower), −1 pulls (upper), 0 stands still; ``first`` and ``second``
    are the motor positions of two dead moves that make the belt engaged, equal to where it is when none is needed.
    """
    m = state[S_M + k]
    forwards = end > start
    if not anywhere and _is_sure(state, k) and abs(_middle(state, k) - start) <= 1.5 * HOLD_MM:
        now = _middle(state, k)
        way = end - now
        if abs(way) < 1e-9:
            return 0, m, m
        branch = LOWER if way > 0 else UPPER
        engaged = backward(model, k, branch, now)
        if abs(engaged - m) > HOLD_MM:
            if abs(way) <= HOLD_MM:
                return 0, m, m
            return (1 if way > 0 else -1), m, engaged
        return (1 if way > 0 else -1), m, m
    # Uncertain, or not where it should be: come from the far side, so that the belt is engaged and at ``start``.
    if end == start:
        forwards = m <= (backward(model, k, LOWER, start) + backward(model, k, UPPER, start)) / 2
    far, near = (UPPER, LOWER) if forwards else (LOWER, UPPER)
    second = backward(model, k, near, start)
    first = m
    if forwards and (anywhere or state[S_HI + k] > start + HOLD_MM):
        first = min(m, backward(model, k, far, start))
    elif not forwards and (anywhere or state[S_LO + k] < start - HOLD_MM):
        first = max(m, backward(model, k, far, start))
    if end == start:
        return 0, first, second
    return (1 if forwards else -1), first, second


@njit(error_model="numpy")
def _motor_at(model, state, k, mode, u):
    if mode > 0:
        return max(backward(model, k, LOWER, u), state[S_M + k])
    if mode < 0:
        return min(backward(model, k, UPPER, u), state[S_M + k])
    return state[S_M + k]


@njit(error_model="numpy")
def _followed(model, state, k, mode, m):
    now = _middle(state, k)
    if mode > 0:
        return max(now, forward(model, k, LOWER, m))
    if mode < 0:
        return min(now, forward(model, k, UPPER, m))
    return now


@njit(error_model="numpy")
def _score(model, curve, state, mode0, mode1, t, end, m0, m1, start_error):
    """Return the largest error of a chord as a multiple of what is allowed."""
    length = (end - t) * curve[LENGTH]
    samples = max(3, np.int64(np.ceil(length / model[M_SAMPLE])))
    held = 1.0 + (mode0 == 0) + (mode1 == 0)
    worst = 0.0
    for i in range(1, samples + 1):
        s = i / (samples + 1)
        a = _followed(model, state, 0, mode0, state[S_M] + s * (m0 - state[S_M]))
        b = _followed(model, state, 1, mode1, state[S_M + 1] + s * (m1 - state[S_M + 1]))
        x, y = printed(model, a, b)
        aside, along = aside_and_along(curve, x, y, t + s * (end - t))
        spare = (1.0 - s) * start_error
        worst = max(worst, aside / (CHORD_MM * held + spare), along / (ALONG * CHORD_MM + spare))
    return worst


@njit(error_model="numpy")
def _ends(model, curve, state, mode0, mode1, t):
    x, y, _ = place(curve, t)
    u0, u1 = wanted(model, x, y)
    return _motor_at(model, state, 0, mode0, u0), _motor_at(model, state, 1, mode1, u1)


@njit(error_model="numpy")
def _chord(model, curve, state, mode0, mode1, t, stop, advance):
    """Return the end of the longest admissible chord from t, by growing and shrinking a guess from the curvature."""
    length = curve[LENGTH]
    whole = stop - t
    m0, m1 = _ends(model, curve, state, mode0, mode1, stop)
    d0, d1 = abs(m0 - state[S_M]), abs(m1 - state[S_M + 1])
    ahead0 = state[S_M] + min(d0, 12.0) * np.sign(m0 - state[S_M])
    ahead1 = state[S_M + 1] + min(d1, 12.0) * np.sign(m1 - state[S_M + 1])
    bend0, bend1 = sharpest(model, 0, state[S_M], ahead0), sharpest(model, 1, state[S_M + 1], ahead1)
    bound = norm(bend0 * d0 * d0, bend1 * d1 * d1)
    if is_flat_arc(curve):
        bound += whole * abs(curve[SWEEP]) * whole * length
    elif model[M_FRAMED] != 0.0:
        bound += 1e-4 * whole * whole * length * length  # rails bow by less
    step = whole
    if bound > 8.0 * CHORD_MM or d0 > 12.0 or d1 > 12.0:
        shortest = max(MIN_PIECE_MM, length / (PIECES_A_RECORD // 2)) / length
        x, y = printed(model, _middle(state, 0), _middle(state, 1))
        aside, along = aside_and_along(curve, x, y, t)
        start_error = aside + along
        if bound > 0.0:
            step = min(whole, max(shortest, 2.0 * whole * np.sqrt(8.0 * CHORD_MM / bound)))
        good = 0.0
        for _ in range(24):
            m0, m1 = _ends(model, curve, state, mode0, mode1, t + step)
            score = _score(model, curve, state, mode0, mode1, t, t + step, m0, m1, start_error)
            if score <= 1.0:
                good = step
                if step >= whole or score > 0.7:
                    break
                step = min(whole, step * min(3.0, 0.97 / np.sqrt(max(score, 1e-3))))
            else:
                if good > 0.0 or step <= shortest:
                    break
                step = max(shortest, step * max(0.15, 0.93 / np.sqrt(score)))
        step = good if good > 0.0 else step
        rest = whole - step
        if rest < 0.5 * shortest:
            step = whole
        elif rest < step:
            step = whole / 2  # two equal chords instead of one and a rest
    if advance > 0.0:
        # Klipper refuses more than MAX_AREA_MM2 of plastic a millimetre, except in the shortest of moves.
        m0, m1 = _ends(model, curve, state, mode0, mode1, t + step)
        x, y = from_motors(model, m0 - state[S_M], m1 - state[S_M + 1])
        part = step * advance
        if part > TINY_ADVANCE_MM and part * FILAMENT_AREA_MM2 > MAX_AREA_MM2 * norm(x, y):
            if advance * FILAMENT_AREA_MM2 <= MAX_AREA_MM2 * length:
                step = min(step, TINY_ADVANCE_MM / advance)
    return stop if stop - t - step < 1e-12 else t + step


@njit(error_model="numpy")
def _draw(model, curve, state, pieces, n, record, kind, t, end, m0, m1, x, y, row, layers, errors):
    """Write the piece of an extruding move from t to end and add up its error; centre for an arc is set by the caller."""
    length = (end - t) * curve[LENGTH]
    px, py = from_motors(model, state[S_M], state[S_M + 1])
    samples = max(1, np.int64(np.ceil(length / SAMPLE_MM)))
    from0, from1 = state[S_M], state[S_M + 1]
    rise = (place(curve, end)[2] - place(curve, t)[2]) if curve[PLANE] == 0.0 or kind == PIECE_LINE else 0.0
    for j in range(samples):
        s = (j + 0.5) / samples
        a, b = from0 + s * (m0 - from0), from1 + s * (m1 - from1)
        if kind == PIECE_ARC:  # an arc that stays an arc: the same place of the shifted curve
            ax, ay, _ = place(curve, t + s * (end - t))
            bx, by, _ = place(curve, end)
            q0, q1 = to_motors(model, ax - bx, ay - by)
            a, b = m0 + q0, m1 + q1
        _arrive(model, state, a, b)
        ex, ey = printed(model, _middle(state, 0), _middle(state, 1))
        error, _ = distance(curve, ex, ey)
        _note(layers, row, errors, 1, error, length / samples)
    _arrive(model, state, m0, m1)
    commanded = np.sqrt((x - px) ** 2 + (y - py) ** 2 + rise * rise)
    if kind == PIECE_ARC:
        commanded = length
    ratio = commanded / length if length > 1e-4 else 1.0
    _, _, z = place(curve, end)
    return _put(pieces, n, kind, x, y, z, end - t, _feed(state, record, ratio))


@njit(error_model="numpy")
def _extrude(model, curve, state, counts, pieces, n, record, row, layers, errors, quantum):
    """Write an extruding move: slack, then chords (or arcs) along each stretch in which no motor turns back."""
    t = 0.0
    length = curve[LENGTH]
    while t < 1.0:
        stop = monotone_end(model, curve, t)
        if stop < 1.0 and (stop - t) * length < MIN_PIECE_MM:
            stop = monotone_end(model, curve, stop)
        if (1.0 - stop) * length < MIN_PIECE_MM:
            stop = 1.0
        x, y, z = place(curve, t)
        s0, s1 = wanted(model, x, y)
        x, y, _ = place(curve, stop)
        e0, e1 = wanted(model, x, y)
        anywhere = counts[N_ANYWHERE] != 0
        unsure = anywhere or not _is_sure(state, 0) or not _is_sure(state, 1)
        mode0, first0, second0 = _prepare(model, state, 0, s0, e0, anywhere)
        mode1, first1, second1 = _prepare(model, state, 1, s1, e1, anywhere)
        before = n
        if abs(first0 - state[S_M]) + abs(first1 - state[S_M + 1]) > 0.0:
            n = _dead_move(model, state, counts, pieces, n, record, first0, first1, z, quantum)
        if anywhere:
            _open_interval(model, state, S_LO)
            counts[N_ANYWHERE] = 0
        n = _dead_move(model, state, counts, pieces, n, record, second0, second1, z, quantum)
        counts[N_ANCHORS] += unsure
        counts[N_TAKEUPS] += n > before and not unsure
        if model[M_SHIFTS_ONLY] != 0.0 and is_flat_arc(curve) and mode0 != 0 and mode1 != 0:
            done = _arc(
                model, curve, state, counts, pieces, n, record, t, stop, mode0, mode1, row, layers, errors, quantum
            )
            if done > n:
                n, t = done, stop
                continue
        while t < stop:
            end = _chord(model, curve, state, mode0, mode1, t, stop, record.advance)
            m0, m1 = _ends(model, curve, state, mode0, mode1, end)
            x, y, m0, m1, clamp = _command(model, state, counts, m0, m1, record, quantum)
            if clamp > quantum:
                counts[N_CLAMPED] += 1
                counts[N_CLAMPED_EXTRUDING] += 1
            n = _draw(model, curve, state, pieces, n, record, PIECE_LINE, t, end, m0, m1, x, y, row, layers, errors)
            t = end
    return n


@njit(error_model="numpy")
def _arc(model, curve, state, counts, pieces, n, record, t, stop, mode0, mode1, row, layers, errors, quantum):
    """Write the stretch of an arc as an arc, shifted by the play's sides; nothing where it would not fit."""
    x0, y0, _ = place(curve, t)
    x1, y1, _ = place(curve, stop)
    s0, s1 = wanted(model, x0, y0)
    e0, e1 = wanted(model, x1, y1)
    m0, m1 = _motor_at(model, state, 0, mode0, e0), _motor_at(model, state, 1, mode1, e1)
    # The stretch must begin and end at the same shift, or the radii would differ.
    if abs(m0 - e0 - (state[S_M] - s0)) > 2.1 * HOLD_MM or abs(m1 - e1 - (state[S_M + 1] - s1)) > 2.1 * HOLD_MM:
        return n
    shift_x, shift_y = from_motors(model, m0 - e0, m1 - e1)
    x, y, m0, m1, clamp = _command(model, state, counts, m0, m1, record, quantum)
    if clamp > quantum:
        return n
    # A quarter's outermost place lies at its ends: they being inside, all of it is.
    n = _draw(model, curve, state, pieces, n, record, PIECE_ARC, t, stop, m0, m1, x, y, row, layers, errors)
    pieces[n - 1].c0, pieces[n - 1].c1 = curve[CA] + shift_x, curve[CB] + shift_y
    return n


@njit(error_model="numpy")
def _travel_motor(model, state, k, start, end):
    """Return the motor position that brings the belt to ``end`` on a move that draws nothing."""
    m, now = state[S_M + k], _middle(state, k)
    if _is_sure(state, k):
        way = end - now
        if abs(way) < 1e-9:
            return m
        branch = LOWER if way > 0 else UPPER
        if abs(way) <= HOLD_MM and abs(backward(model, k, branch, now) - m) > HOLD_MM:
            return m
        return backward(model, k, branch, end)
    if abs(end - start) < 1e-9 and state[S_LO + k] - HOLD_MM <= end <= state[S_HI + k] + HOLD_MM:
        return m
    return backward(model, k, LOWER if end > now else UPPER, end)


@njit(error_model="numpy")
def _travel(model, curve, state, counts, pieces, n, record, t, end, quantum):
    """Write a move that draws nothing: only its end must be right."""
    x, y, _ = place(curve, t)
    s0, s1 = wanted(model, x, y)
    x, y, z = place(curve, end)
    e0, e1 = wanted(model, x, y)
    if counts[N_KNOWN]:
        m0, m1 = _travel_motor(model, state, 0, s0, e0), _travel_motor(model, state, 1, s1, e1)
    else:
        m0 = (backward(model, 0, LOWER, e0) + backward(model, 0, UPPER, e0)) / 2
        m1 = (backward(model, 1, LOWER, e1) + backward(model, 1, UPPER, e1)) / 2
    x, y, m0, m1, clamp = _command(model, state, counts, m0, m1, record, quantum)
    counts[N_CLAMPED] += clamp > quantum
    _arrive(model, state, m0, m1)
    if not counts[N_KNOWN] or counts[N_ANYWHERE]:
        _open_interval(model, state, S_LO)
    state[S_FEED] = record.feed
    return _put(pieces, n, PIECE_LINE, x, y, z, end - t, record.feed)


@njit(error_model="numpy")
def _nearest(records, count, i, curve, x, y):
    """Return the distance of a printed place to the wanted path around record i, along which it may be ahead or behind."""
    best, t = distance(curve, x, y)
    if 0.0 <= t <= 1.0:
        return best
    step = 1 if t > 1.0 else -1
    walked = 0.0
    j = i + step
    while 0 <= j < count and walked < WALK_MM:
        r = records[j]
        if r.kind == KIND_LINEAR and r.flags & FLAG_EXTRUDING:
            d, foot = line_distance(r.x0, r.y0, r.x1, r.y1, x, y)
            best = min(best, d)
            if 0.0 < foot < 1.0 or (foot >= 1.0) != (step > 0):
                break
            walked += norm(r.x1 - r.x0, r.y1 - r.y0)
        elif r.x0 != r.x1 or r.y0 != r.y1 or r.kind == KIND_CW or r.kind == KIND_CCW:
            break
        j += step
    return best


@njit(error_model="numpy")
def _raw(model, curve, state, records, count, i, extruding, sure, row, layers, errors):
    """Print a move as the file has it, for the prediction."""
    arc = curve[0] != 0.0
    if extruding:
        samples = max(1, np.int64(np.ceil(curve[LENGTH] / SAMPLE_MM)))
    else:
        samples = 16 if arc else 0
    for j in range(samples + 1):
        x, y, _ = place(curve, (j + 0.5) / samples if j < samples else 1.0)
        m0, m1 = to_motors(model, x, y)
        _pull(model, state, S_RAW_LO, m0, m1)
        if extruding and sure and j < samples:
            a, b = (state[S_RAW_LO] + state[S_RAW_HI]) / 2, (state[S_RAW_LO + 1] + state[S_RAW_HI + 1]) / 2
            px, py = printed(model, a, b)
            _note(layers, row, errors, 0, _nearest(records, count, i, curve, px, py), curve[LENGTH] / samples)


@njit(error_model="numpy")
def _layer(state, counts, layers, record):
    """Return the row of the layer that an extruding record belongs to: by the slicer's comments, else by height."""
    marked = record.layer > 0
    if marked:
        new = record.layer != counts[N_MARK]
    elif record.z0 == record.z1:
        new = abs(record.z1 - state[S_Z]) > 1e-3
    else:
        new = abs(record.z1 - state[S_Z]) > 0.05
    if new or counts[N_LAYER] < 0:
        counts[N_LAYER] += 1
        counts[N_MARK] = record.layer
        state[S_Z] = record.z1
        layers[counts[N_LAYER]] = 0.0
        layers[counts[N_LAYER], L_Z] = record.z1
    return counts[N_LAYER]


@njit(error_model="numpy")
def _event(model, state, counts, r):
    """Follow homing, events and lost places: what is known of the belts afterwards."""
    known = (r.flags & FLAG_KNOWN_X1) != 0 and (r.flags & FLAG_KNOWN_Y1) != 0
    if r.kind == KIND_HOME:
        if r.axes & 3 == 0:
            return
        state[S_M], state[S_M + 1] = to_motors(model, r.x1, r.y1)
        # The end stop tells where the carriage is, not on which side of the play the belt rests.
        _open_interval(model, state, S_LO)
        _open_interval(model, state, S_RAW_LO)
        counts[N_KNOWN], counts[N_ANYWHERE] = known, 0
    elif r.kind == KIND_SET:
        counts[N_KNOWN] = counts[N_KNOWN] and known
    elif r.kind == KIND_EVENT and r.event != EVENT_OFFSET:
        if r.x0 != r.x1 or r.y0 != r.y1:
            known = False  # the firmware went back to a place of the file as it is written now
        counts[N_KNOWN] = counts[N_KNOWN] and known
        if counts[N_KNOWN]:
            _open_interval(model, state, S_LO)
            counts[N_ANYWHERE] = counts[N_ANYWHERE] or r.event == EVENT_EXCLUDE


@njit(cache=True, nogil=True, error_model="numpy")
def mend(model, records, begin, count, state, counts, first, pieces, layers, errors, quantum):
    """Plan records[begin:count]; return the record before which it stopped.

    Record i becomes pieces[first[i]:first[i + 1]]; ``first`` int64 [count + 1] counts from the beginning of ``pieces``,
    an array of PIECE. It stops before a record whose pieces may not fit: call again with what is left.
    ``state`` [STATE] and ``counts`` [COUNTS] pass from call to call. ``layers`` [L, LAYER] must have room for
    counts[N_LAYER] + 2 + (count − begin) rows; ``errors`` [2, ERROR_BINS] are histograms of mm of path. ``quantum`` [mm]
    is the grid of the numbers that will be written.

    A motion record without a piece is to be copied as it is.
    """
    curve = np.zeros(CURVE)
    n = 0
    i = begin
    while i < count and n + PIECES_A_RECORD < len(pieces):
        r = records[i]
        first[i] = n
        if r.kind != KIND_LINEAR and r.kind != KIND_CW and r.kind != KIND_CCW:
            _event(model, state, counts, r)
            i += 1
            continue
        arc = r.kind != KIND_LINEAR
        if not arc and r.x0 == r.x1 and r.y0 == r.y1:
            i += 1
            continue
        known = (r.flags & FLAG_KNOWN_X1) != 0 and (r.flags & FLAG_KNOWN_Y1) != 0
        extruding = r.flags & FLAG_EXTRUDING != 0
        counts[N_MOVES] += 1
        counts[N_EXTRUDING] += extruding
        if not known or r.flags & FLAG_OPAQUE:
            counts[N_UNKNOWN] += extruding
            counts[N_COPIED] += 1
            if counts[N_KNOWN] and known:  # written as it is
                if r.flags & FLAG_RELATIVE:
                    d0, d1 = to_motors(model, r.x1 - r.x0, r.y1 - r.y0)
                    _arrive(model, state, state[S_M] + d0, state[S_M + 1] + d1)
                else:
                    m0, m1 = to_motors(model, r.x1, r.y1)
                    _arrive(model, state, m0, m1)
            counts[N_KNOWN] = counts[N_KNOWN] and known
            i += 1
            continue
        if arc:
            set_arc(curve, r.x0, r.y0, r.z0, r.x1, r.y1, r.z1, r.c0, r.c1, r.plane, r.kind == KIND_CW, r.turns)
        else:
            curve[PLANE] = 0.0
            set_line(curve, r.x0, r.y0, r.z0, r.x1, r.y1, r.z1)
        sure = counts[N_KNOWN] != 0
        row = 0
        if extruding:
            row = _layer(state, counts, layers, r)
            state[S_LOW], state[S_LOW + 1] = min(state[S_LOW], r.x0, r.x1), min(state[S_LOW + 1], r.y0, r.y1)
            state[S_HIGH], state[S_HIGH + 1] = max(state[S_HIGH], r.x0, r.x1), max(state[S_HIGH + 1], r.y0, r.y1)
            if sure:
                layers[row, L_LENGTH] += curve[LENGTH]
        elif r.feed > 0:
            state[S_TRAVEL] = r.feed
        _raw(model, curve, state, records, count, i, extruding, sure, row, layers, errors)
        if extruding and sure:
            n = _extrude(model, curve, state, counts, pieces, n, r, row, layers, errors, quantum)
        else:
            counts[N_UNKNOWN] += extruding
            parts = 1
            if arc:  # what draws nothing needs no better than this
                parts = min(max(4, np.int64(abs(curve[SWEEP]) * np.sqrt(curve[R0] / 0.4))), PIECES_A_RECORD // 2)
            for part in range(parts):
                end = (part + 1.0) / parts
                n = _travel(model, curve, state, counts, pieces, n, r, part / parts, end, quantum)
        if not sure:
            # From here on the place is certain; the file as it is starts with the same uncertainty.
            m0, m1 = to_motors(model, r.x1, r.y1)
            for k in range(2):
                m = m0 if k == 0 else m1
                state[S_RAW_LO + k], state[S_RAW_HI + k] = forward(model, k, LOWER, m), forward(model, k, UPPER, m)
        counts[N_KNOWN] = 1
        if not extruding:
            counts[N_ANYWHERE] = 0
        i += 1
    first[i] = n
    counts[N_PIECES] += n
    return i
