"""Compiled continuous planner: the moves of a G-code file in, the commands that make a broken printer draw them out.

Per motor the state is (m, u): its commanded position and where play has left the belt, kept as an interval lo…hi when
that is uncertain. Going forwards u = lower(m), so m = lower⁻¹(u*); backwards m = upper⁻¹(u*) (physics.md eq. 7, §6).
At a reversal the slack is taken up by a move without extrusion, during which the nozzle stands still.
The same pass simulates the file as it is and as it is written, and adds up the distance to the wanted path.
"""

import numpy as np
from numba import njit

from printmend.control.kernels.inverse_chord import chord
from printmend.control.kernels.inverse_curve import (
    ARC,
    CA,
    CB,
    LENGTH,
    PLANE,
    R0,
    SWEEP,
    distance,
    is_flat_arc,
    monotone_end,
    place,
    set_arc,
    set_line,
    stays_near,
)
from printmend.control.kernels.inverse_layout import (
    ASTRAY_MM,
    CLAMP_MM,
    HOLD_MM,
    L_LENGTH,
    MIN_PIECE_MM,
    N_ANCHORS,
    N_ANYWHERE,
    N_CLAMPED,
    N_CLAMPED_EXTRUDING,
    N_COPIED,
    N_EXTRUDING,
    N_KNOWN,
    N_MOVES,
    N_PIECES,
    N_TAKEUPS,
    N_UNKNOWN,
    PIECES_A_RECORD,
    S_BEYOND,
    S_ERROR,
    S_FEED,
    S_HELD,
    S_HI,
    S_HIGH,
    S_LO,
    S_LOW,
    S_M,
    S_RAW_HI,
    S_RAW_LO,
    S_RAW_M,
    S_SAVED,
    S_TRAVEL,
    SAME_FEED,
    SEEN_MM,
)
from printmend.control.kernels.inverse_lookup import (
    LOWER,
    M_SHIFTS_ONLY,
    UPPER,
    backward,
    from_motors,
    printed,
    to_motors,
    wanted,
)
from printmend.control.kernels.inverse_predict import follow_raw, layer_of, note, predict_raw, samples_of
from printmend.control.kernels.inverse_state import (
    arrive,
    command,
    is_sure,
    middle,
    motor_at,
    open_interval,
    prepare,
    settle_home,
    travel_motor,
)
from printmend.gcode.kernels.layout import (
    EVENT_EXCLUDE,
    EVENT_OFFSET,
    EVENT_RESTORE,
    EVENT_SAVE,
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
    SAVED_SLOTS,
    WORD_X,
    WORD_Y,
)
from printmend.jit import entry

# Gauss's places and weights of three: exact for the square of a parabola, which is what a chord's error is.
NODES = (0.1127016653792583, 0.5, 0.8872983346207417)
WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)


@njit(error_model="numpy", _nrt=False)
def _put(pieces, n, kind, x, y, z, share, feed):
    p = pieces[n]
    p.kind, p.x, p.y, p.z, p.share, p.feed = kind, x, y, z, share, feed
    p.c0 = p.c1 = np.nan
    return n + 1


@njit(error_model="numpy", _nrt=False)
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


@njit(error_model="numpy", _nrt=False)
def _dead_move(model, state, pieces, n, record, m0, m1, z, quantum):
    """Write a move that extrudes nothing and for which the nozzle stands still (or is put in its place)."""
    if m0 == state[S_M] and m1 == state[S_M + 1]:
        return n
    x, y, m0, m1, _ = command(model, m0, m1, record, quantum)
    if abs(m0 - state[S_M]) + abs(m1 - state[S_M + 1]) <= quantum:
        return n
    arrive(model, state, m0, m1)
    state[S_FEED] = max(state[S_TRAVEL], record.feed)
    return _put(pieces, n, PIECE_TRAVEL, x, y, z, 0.0, state[S_FEED])


@njit(error_model="numpy", _nrt=False)
def _draw(model, curve, state, pieces, n, record, kind, t, end, m0, m1, x, y, row, layers, errors):
    """Write the piece of an extruding move from t to end, and add up its error; the caller sets an arc's centre."""
    length = (end - t) * curve[LENGTH]
    from0, from1 = state[S_M], state[S_M + 1]
    end_x, end_y, end_z = place(curve, end)
    samples = samples_of(model, length)
    fine = state[S_ERROR] > SEEN_MM  # a chord bulges: its middle alone would stand for more than its error
    nodes = 3 if fine else 1
    most = 0.0
    for j in range(nodes * samples):
        node = j % 3 if fine else 1
        s = (j // nodes + NODES[node]) / samples
        if kind == PIECE_ARC:  # shifted as a whole: the same place of the shifted curve
            arc_x, arc_y, _ = place(curve, t + s * (end - t))
            a, b = to_motors(model, arc_x - end_x, arc_y - end_y)
            arrive(model, state, m0 + a, m1 + b)
        else:
            arrive(model, state, from0 + s * (m0 - from0), from1 + s * (m1 - from1))
        at_x, at_y = printed(model, middle(state, 0), middle(state, 1))
        error, _ = distance(curve, at_x, at_y)
        most = max(most, error)
        note(layers, row, errors, 1, error, length / samples * (WEIGHTS[node] if fine else 1.0))
    state[S_ERROR] = most
    arrive(model, state, m0, m1)
    if most > SEEN_MM:
        at_x, at_y = printed(model, middle(state, 0), middle(state, 1))
        error, _ = distance(curve, at_x, at_y)
        note(layers, row, errors, 1, error, 0.0)
    ratio = 1.0
    if kind == PIECE_LINE and length > 1e-4:
        from_x, from_y = from_motors(model, from0, from1)
        rise = end_z - place(curve, t)[2]
        ratio = np.sqrt((x - from_x) ** 2 + (y - from_y) ** 2 + rise * rise) / length
    return _put(pieces, n, kind, x, y, end_z, end - t, _feed(state, record, ratio))


@njit(error_model="numpy", _nrt=False)
def _arc(model, curve, state, pieces, n, record, t, stop, mode0, mode1, row, layers, errors, quantum):
    """Write the stretch of an arc as an arc, shifted by the play's sides; nothing where it would not fit."""
    x0, y0, _ = place(curve, t)
    x1, y1, _ = place(curve, stop)
    s0, s1 = wanted(model, x0, y0)
    e0, e1 = wanted(model, x1, y1)
    m0, m1 = motor_at(model, state, 0, mode0, e0), motor_at(model, state, 1, mode1, e1)
    # The stretch must begin and end at the same shift, or the radii would differ.
    if abs(m0 - e0 - (state[S_M] - s0)) > 2.1 * HOLD_MM or abs(m1 - e1 - (state[S_M + 1] - s1)) > 2.1 * HOLD_MM:
        return n
    shift_x, shift_y = from_motors(model, m0 - e0, m1 - e1)
    x, y, m0, m1, clamp = command(model, m0, m1, record, quantum)
    if clamp > quantum:
        return n
    # A quarter's outermost places are its ends: they being inside the bed, all of it is.
    n = _draw(model, curve, state, pieces, n, record, PIECE_ARC, t, stop, m0, m1, x, y, row, layers, errors)
    pieces[n - 1].c0, pieces[n - 1].c1 = curve[CA] + shift_x, curve[CB] + shift_y
    return n


@njit(error_model="numpy", _nrt=False)
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
        unsure = anywhere or not is_sure(state, 0) or not is_sure(state, 1)
        mode0, first0, second0 = prepare(model, state, 0, s0, e0, anywhere)
        mode1, first1, second1 = prepare(model, state, 1, s1, e1, anywhere)
        before = n
        n = _dead_move(model, state, pieces, n, record, first0, first1, z, quantum)
        if anywhere:
            open_interval(model, state, S_M, S_LO, S_HI)
            counts[N_ANYWHERE] = 0
        n = _dead_move(model, state, pieces, n, record, second0, second1, z, quantum)
        counts[N_ANCHORS] += unsure
        counts[N_TAKEUPS] += n > before and not unsure
        if mode0 != 0 and mode1 != 0 and is_flat_arc(curve) and model[M_SHIFTS_ONLY] != 0.0:
            done = _arc(model, curve, state, pieces, n, record, t, stop, mode0, mode1, row, layers, errors, quantum)
            if done > n:
                n, t = done, stop
                continue
        while t < stop:
            end, m0, m1 = chord(model, curve, state, mode0, mode1, t, stop, e0, e1, record.advance)
            x, y, m0, m1, clamp = command(model, m0, m1, record, quantum)
            n = _draw(model, curve, state, pieces, n, record, PIECE_LINE, t, end, m0, m1, x, y, row, layers, errors)
            # Where the way to its start was held back already, only the error tells.
            if clamp > CLAMP_MM or state[S_ERROR] > ASTRAY_MM:
                counts[N_CLAMPED] += 1
                counts[N_CLAMPED_EXTRUDING] += 1
                state[S_BEYOND] = max(state[S_BEYOND], clamp, state[S_ERROR])
                state[S_HELD + (record.layer > 0)] += (end - t) * length
            t = end
    return n


@njit(error_model="numpy", _nrt=False)
def _travel(model, curve, state, counts, pieces, n, record, t, end, quantum):
    """Write a move that draws nothing: only its end must be right."""
    x, y, _ = place(curve, t)
    s0, s1 = wanted(model, x, y)
    x, y, z = place(curve, end)
    e0, e1 = wanted(model, x, y)
    known = counts[N_KNOWN] != 0
    if known:
        m0, m1 = travel_motor(model, state, 0, s0, e0), travel_motor(model, state, 1, s1, e1)
    else:
        m0 = (backward(model, 0, LOWER, e0) + backward(model, 0, UPPER, e0)) / 2
        m1 = (backward(model, 1, LOWER, e1) + backward(model, 1, UPPER, e1)) / 2
    x, y, m0, m1, clamp = command(model, m0, m1, record, quantum)
    counts[N_CLAMPED] += clamp > CLAMP_MM
    arrive(model, state, m0, m1)
    if not known or counts[N_ANYWHERE] != 0:
        open_interval(model, state, S_M, S_LO, S_HI)
    state[S_FEED] = record.feed
    return _put(pieces, n, PIECE_LINE, x, y, z, end - t, record.feed)


@njit(error_model="numpy", _nrt=False)
def _stand(model, state, pieces, n, record, quantum):
    """Write a move that names the place where the head is: that is now another number."""
    x, y, m0, m1, _ = command(model, state[S_M], state[S_M + 1], record, quantum)
    arrive(model, state, m0, m1)
    state[S_FEED] = record.feed
    return _put(pieces, n, PIECE_LINE, x, y, record.z1, 1.0, record.feed)


@njit(error_model="numpy", _nrt=False)
def _event(model, state, counts, r):
    """Follow homing, events and lost places: what is known of the belts afterwards."""
    known = (r.flags & FLAG_KNOWN_X1) != 0 and (r.flags & FLAG_KNOWN_Y1) != 0
    if r.kind == KIND_HOME:
        if r.axes & 3 == 0:
            return
        settle_home(model, state, S_M, S_LO, S_HI, r.axes, r.x1, r.y1)
        settle_home(model, state, S_RAW_M, S_RAW_LO, S_RAW_HI, r.axes, r.x1, r.y1)
        counts[N_KNOWN] = known
        if r.axes & 3 == 3:
            counts[N_ANYWHERE] = 0
    elif r.kind == KIND_SET:
        counts[N_KNOWN] = counts[N_KNOWN] and known
    elif r.kind == KIND_EVENT and r.event == EVENT_SAVE:
        state[S_SAVED + 2 * r.axes] = state[S_M] if counts[N_KNOWN] else np.nan
        state[S_SAVED + 2 * r.axes + 1] = state[S_M + 1]
    elif r.kind == KIND_EVENT and r.event == EVENT_RESTORE:
        m0, m1 = to_motors(model, r.x1 - r.x0, r.y1 - r.y0)
        m0, m1 = state[S_M] + m0, state[S_M + 1] + m1
        sure = counts[N_KNOWN] != 0
        if r.axes < SAVED_SLOTS:
            m0, m1 = state[S_SAVED + 2 * r.axes], state[S_SAVED + 2 * r.axes + 1]
            counts[N_KNOWN] = not np.isnan(m0)
        counts[N_KNOWN] = counts[N_KNOWN] and known
        if counts[N_KNOWN]:
            arrive(model, state, m0, m1)
            follow_raw(model, state, r.x1, r.y1)
        if counts[N_KNOWN] and not sure:
            open_interval(model, state, S_M, S_LO, S_HI)
            open_interval(model, state, S_RAW_M, S_RAW_LO, S_RAW_HI)
    elif r.kind == KIND_EVENT and r.event != EVENT_OFFSET:
        if r.x0 != r.x1 or r.y0 != r.y1:
            known = False  # the firmware went back to a place of the file as it is written now
        counts[N_KNOWN] = counts[N_KNOWN] and known
        if counts[N_KNOWN]:
            open_interval(model, state, S_M, S_LO, S_HI)
            counts[N_ANYWHERE] = counts[N_ANYWHERE] or r.event == EVENT_EXCLUDE


@njit(error_model="numpy", _nrt=False)
def _follow_copied(model, state, counts, r, known):
    """Follow a move that is written as it is: its place is not known, or not all of it can be read."""
    counts[N_COPIED] += 1
    if counts[N_KNOWN] and known:
        m0, m1 = to_motors(model, r.x1, r.y1)
        if r.flags & FLAG_RELATIVE:
            m0, m1 = to_motors(model, r.x1 - r.x0, r.y1 - r.y0)
            m0, m1 = m0 + state[S_M], m1 + state[S_M + 1]
        arrive(model, state, m0, m1)
    counts[N_KNOWN] = counts[N_KNOWN] and known


@entry(error_model="numpy", _nrt=False)
def mend(model, records, begin, count, state, counts, curve, first, pieces, layers, errors, quantum):
    """Plan records[begin:count]; return the record before which it stopped.

    Record i becomes pieces[first[i]:first[i + 1]]; ``first`` int64 [count + 1] counts from the beginning of ``pieces``,
    an array of PIECE. It stops before a record whose pieces may not fit: call again with what is left.
    ``state`` [STATE] and ``counts`` [COUNTS] pass from call to call; ``curve`` [CURVE] is scratch. ``layers``
    [L, LAYER] must have room for counts[N_LAYER] + 2 + (count − begin) rows; ``errors`` [2, ERROR_BINS] are histograms
    of mm of path. ``quantum`` [mm] is the grid of the numbers that will be written.

    A motion record without a piece is to be copied as it is.
    """
    n = 0
    i = begin
    while i < count and n + PIECES_A_RECORD < len(pieces):
        r = records[i]
        first[i] = n
        i += 1
        arc = r.kind == KIND_CW or r.kind == KIND_CCW
        if not arc and r.kind != KIND_LINEAR:
            _event(model, state, counts, r)
            continue
        still = not arc and r.x0 == r.x1 and r.y0 == r.y1
        if still and not r.words & (WORD_X | WORD_Y):
            continue
        known = (r.flags & FLAG_KNOWN_X1) != 0 and (r.flags & FLAG_KNOWN_Y1) != 0
        extruding = r.flags & FLAG_EXTRUDING != 0
        counts[N_MOVES] += 1
        if extruding and known:
            counts[N_EXTRUDING] += 1
            state[S_LOW], state[S_LOW + 1] = min(state[S_LOW], r.x1), min(state[S_LOW + 1], r.y1)
            state[S_HIGH], state[S_HIGH + 1] = max(state[S_HIGH], r.x1), max(state[S_HIGH + 1], r.y1)
        if still and known and counts[N_KNOWN] != 0 and not r.flags & FLAG_OPAQUE:
            n = _stand(model, state, pieces, n, r, quantum)
            continue
        curve[ARC] = curve[PLANE] = 0.0
        if arc:
            set_arc(curve, r.x0, r.y0, r.z0, r.x1, r.y1, r.z1, r.c0, r.c1, r.plane, r.kind == KIND_CW, r.turns)
        else:
            set_line(curve, r.x0, r.y0, r.z0, r.x1, r.y1, r.z1)
        if not known or r.flags & FLAG_OPAQUE or not stays_near(model, curve):
            counts[N_UNKNOWN] += extruding
            _follow_copied(model, state, counts, r, known)
            continue
        sure = counts[N_KNOWN] != 0
        drawn = extruding and sure
        row = 0
        if extruding:
            row = layer_of(state, counts, layers, r)
        elif r.feed > 0:
            state[S_TRAVEL] = r.feed
        predict_raw(model, curve, state, records, count, i - 1, drawn, row, layers, errors)
        if drawn:
            layers[row, L_LENGTH] += curve[LENGTH]
            n = _extrude(model, curve, state, counts, pieces, n, r, row, layers, errors, quantum)
        else:
            counts[N_UNKNOWN] += extruding
            parts = 1
            if arc:  # what draws nothing needs no better than this
                parts = min(max(4, np.int64(abs(curve[SWEEP]) * np.sqrt(curve[R0] / 0.4))), PIECES_A_RECORD // 2)
            for part in range(parts):
                n = _travel(model, curve, state, counts, pieces, n, r, part / parts, (part + 1.0) / parts, quantum)
            counts[N_ANYWHERE] = 0
        if not sure:
            # From here on the place is certain; the file as it is starts with the same uncertainty.
            open_interval(model, state, S_RAW_M, S_RAW_LO, S_RAW_HI)
        counts[N_KNOWN] = 1
    first[i] = n
    counts[N_PIECES] += n
    return i
