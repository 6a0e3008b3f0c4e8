"""Compiled continuous planner: the moves of a G-code file in, the commands that make a broken printer draw them out.

Per motor the state is (m, u): its commanded position and where play has left the belt, kept as an interval lo…hi when
that is uncertain. Going forwards u = lower(m), so m = lower⁻¹(u*); backwards m = upper⁻¹(u*) (physics.md eq. 22).
At a reversal the slack is crossed while the nozzle prints on, where the path leaves room for that (`turns`); else it is
taken up by a move without extrusion, during which the nozzle stands still.
The same pass simulates the file as it is and as it is written, and adds up the distance to the wanted path.
"""

import numpy as np

from printmend.gcode.kernels.layout import (
    FLAG_CURVE,
    FLAG_EXTRUDING,
    FLAG_KNOWN_X0,
    FLAG_KNOWN_X1,
    FLAG_KNOWN_Y0,
    FLAG_KNOWN_Y1,
    FLAG_KNOWN_Z1,
    FLAG_OPAQUE,
    FLAG_RELATIVE,
    KIND_CCW,
    KIND_CW,
    KIND_LINEAR,
    PIECE_LINE,
    PIECE_TRAVEL,
    ROLE_MASK,
    ROLE_OUTER,
    ROLE_SHIFT,
    WORD_E,
    WORD_X,
    WORD_Y,
    WORD_Z,
)
from printmend.jit import entry, inner
from printmend.plan.kernels.curve import (
    line_distance,
    place,
    set_line,
    stays_near,
    trace,
)
from printmend.plan.kernels.draw import (
    draw,
    extrude,
    put,
)
from printmend.plan.kernels.event import (
    event,
    follow_copied,
)
from printmend.plan.kernels.height import (
    ZED,
    aim,
    commanded,
    find,
    follow_copied_height,
    height_event,
    is_flat,
    is_too_long,
    lift,
    lift_raw,
    note_height,
    parts_of,
    push,
)
from printmend.plan.kernels.layout import (
    CHORDS_A_RECORD,
    CLAMP_MM,
    HOLD_MM,
    PIECES_A_RECORD,
    UNKNOWN_LINES,
)
from printmend.plan.kernels.lookup import (
    LOWER,
    TRAVEL,
    UPPER,
    backward,
    forward,
    from_motors,
    printed,
    to_motors,
    wanted,
)
from printmend.plan.kernels.predict import (
    layer_of,
    note,
    predict_raw,
)
from printmend.plan.kernels.state import (
    arrive,
    command,
    count_held,
    middle,
    motor_at,
    open_interval,
    prepare,
    travel_motor,
)
from printmend.plan.kernels.travel import arrival, arriving_push, plan_travel
from printmend.plan.kernels.turns import survey

LOOKS_FROM_HOME = 256  # places of a line from home that are looked at: 1.2 mm apart at most on a bed of 220 mm


# The kernels here, in `draw` and in `predict` have many parameters: the arrays of one file's way through the planner,
# which `Planner` allocates once, and the record in hand.
@inner
def _come_from_unknown(model, state, counts, pieces, n, record, e0, e1, z, quantum):
    """Come from an unknown place to just before belts (e0, e1); return (n, m0, m1), the motors to go on from.

    Then both belts are engaged before anything is extruded, even before a prime on the spot. Each motor comes from the
    side on which the bed has room. If neither side has, the belt is at least known.
    """
    x = y = m0 = m1 = to0 = to1 = 0.0
    least = np.inf
    for sides in range(4):
        far0, far1 = sides & 1, sides >> 1  # LOWER or UPPER: which branch each motor pushes in the end
        f0, f1 = backward(model, 0, far0, e0), backward(model, 1, far1, e1)
        _, _, f0, f1, beyond = command(model, f0, f1, record, quantum)
        n0 = backward(model, 0, 1 - far0, forward(model, 0, far0, f0))
        n1 = backward(model, 1, 1 - far1, forward(model, 1, far1, f1))
        at_x, at_y, n0, n1, short = command(model, n0, n1, record, quantum)
        if beyond + 100.0 * short < least - quantum:
            least = beyond + 100.0 * short
            x, y, m0, m1, to0, to1 = at_x, at_y, n0, n1, f0, f1
    state.mended.m[0], state.mended.m[1] = m0, m1
    open_interval(model, state.mended)
    if abs(to0 - m0) + abs(to1 - m1) > quantum:
        n = put(pieces, n, PIECE_TRAVEL, x, y, z, 0.0, record.feed)
        counts.anchors += 1
    return n, to0, to1


@inner
def _travel(model, curve, state, counts, pieces, n, record, t, end, quantum, to0, to1):
    """Write a move that draws nothing, so that only its end must be right.

    On a leg of a planned travel the motors go to ``to0`` and ``to1``. Elsewhere these are NaN, and the motors go as far
    as their belts need.
    """
    x, y, _ = place(curve, t)
    s0, s1 = wanted(model, x, y)
    x, y, z = place(curve, end)
    e0, e1 = wanted(model, x, y)
    known = counts.known != 0
    came = not known and not record.words & WORD_E and end - t == 1.0
    if known:
        m0 = travel_motor(model, state, 0, s0, e0) if np.isnan(to0) else to0
        m1 = travel_motor(model, state, 1, s1, e1) if np.isnan(to1) else to1
    elif came:
        n, m0, m1 = _come_from_unknown(model, state, counts, pieces, n, record, e0, e1, z, quantum)
    else:
        m0 = (backward(model, 0, LOWER, e0) + backward(model, 0, UPPER, e0)) / 2
        m1 = (backward(model, 1, LOWER, e1) + backward(model, 1, UPPER, e1)) / 2
    x, y, m0, m1, clamp = command(model, m0, m1, record, quantum)
    if clamp > CLAMP_MM:
        count_held(counts, record, False)
    arrive(model, state, m0, m1)
    if not (known or came) or counts.anywhere != 0:
        open_interval(model, state.mended)
    state.feed = record.feed
    return put(pieces, n, PIECE_LINE, x, y, z, end - t, record.feed)


@inner
def _name_place_again(model, state, pieces, n, record, quantum):
    """Write a move that names the place where the head is by its number on the mended machine."""
    x, y, m0, m1, _ = command(model, state.mended.m[0], state.mended.m[1], record, quantum)
    arrive(model, state, m0, m1)
    state.feed = record.feed
    return put(pieces, n, PIECE_LINE, x, y, record.z1, 1.0, record.feed)


@inner
def _move_z(model, state, counts, pieces, n, record, kind, x, y, m, quantum, free):
    """Write a move that draws nothing: the motor of Z goes to m, the nozzle to (x, y) against the screw's push.

    If it is ``free``, because a travel follows, the commanded x and y stay.
    """
    m = commanded(model, record, m, quantum)
    extent = abs(m - state.mended.m[ZED])
    at_x, at_y = record.x1, record.y1
    if free:
        at_x, at_y = from_motors(model, state.mended.m[0], state.mended.m[1])
    elif counts.known != 0:
        px, py = push(model, state.mended.m[ZED])
        s0, s1 = wanted(model, x - px, y - py)
        px, py = push(model, m)
        e0, e1 = wanted(model, x - px, y - py)
        m0, m1 = travel_motor(model, state, 0, s0, e0), travel_motor(model, state, 1, s1, e1)
        at_x, at_y, m0, m1, _ = command(model, m0, m1, record, quantum)
        extent += abs(m0 - state.mended.m[0]) + abs(m1 - state.mended.m[1])
        if kind == PIECE_LINE or extent > quantum:
            arrive(model, state, m0, m1)
    if kind == PIECE_LINE:
        lift(model, state, m)
        state.feed = record.feed
        return put(pieces, n, kind, at_x, at_y, m, 1.0, record.feed)
    if extent <= quantum:
        return n
    lift(model, state, m)
    state.feed = max(state.travel_feed, record.feed)
    return put(pieces, n, kind, at_x, at_y, m, 0.0, state.feed)


@inner
def _raise(model, state, counts, pieces, n, records, count, i, quantum):
    """Write a move that names Z alone or stands still in x and y: the belts move against the push of the new height."""
    record = records[i]
    if not record.flags & FLAG_KNOWN_Z1:
        counts.height = 0
        if not record.words & (WORD_X | WORD_Y):
            return n
        return _name_place_again(model, state, pieces, n, record, quantum)
    lift_raw(model, state, counts, record.z1)
    m = find(model, state, counts, record, quantum)
    free = False
    if counts.known != 0 and counts.anywhere == 0:
        seen, moves, _, _ = arrival(model, records, count, i)
        free = seen and moves
    return _move_z(model, state, counts, pieces, n, record, PIECE_LINE, record.x1, record.y1, m, quantum, free)


@inner
def _extrude_in_space(model, curve, moved, state, counts, pieces, n, record, row, layers, errors, quantum, run):
    """Write an extruding move of a machine with a bad screw: a rising curve is cut where the push bends."""
    if not record.flags & FLAG_KNOWN_Z1:
        counts.height = 0
        begin, span = run.begin, curve.length
        return extrude(model, curve, state, counts, pieces, n, record, row, layers, errors, quantum, run, begin, span)
    if counts.height == 0:
        curve.z0 = curve.z1
        find(model, state, counts, record, quantum)
    parts = parts_of(model, curve)
    for part in range(parts):
        x0, y0, z0 = place(curve, part / parts)
        x1, y1, z1 = place(curve, (part + 1.0) / parts)
        mode, first, second = prepare(model, state, ZED, z0, z1, False, 0.0, HOLD_MM)
        if first != state.mended.m[ZED]:
            n = _move_z(model, state, counts, pieces, n, record, PIECE_TRAVEL, x0, y0, first, quantum, False)
        if second != state.mended.m[ZED]:
            n = _move_z(model, state, counts, pieces, n, record, PIECE_TRAVEL, x0, y0, second, quantum, False)
        m0, m1 = state.mended.m[ZED], commanded(model, record, motor_at(model, state, ZED, mode, z1), quantum)
        if mode == 0:
            m1 = m0
        if is_flat(curve):
            aim(model, curve, moved, m0, m1)
        else:
            px, py = push(model, m0)
            qx, qy = push(model, m1)
            set_line(moved, x0 - px, y0 - py, m0, x1 - qx, y1 - qy, m1)
            moved.share, moved.least = 1.0 / parts, curve.least
        begin, span = run.begin + part / parts * curve.length, curve.length / parts
        n = extrude(model, moved, state, counts, pieces, n, record, row, layers, errors, quantum, run, begin, span)
        lift(model, state, m1)
        note_height(layers, row, 1, middle(state, ZED) - z1, curve.length / parts)
    return n


@inner
def _note_left(model, curve, state, counts, pieces, n, record, records, count, i, layers, errors, samples, moved):
    """Predict a line that stays as it is: where both files' heads start is known, as each prints it; elsewhere in both
    as the file as it is prints it, from where it seems to be."""
    if not stays_near(model, curve):
        return
    drawn = record.flags & FLAG_EXTRUDING != 0
    known = record.flags & FLAG_KNOWN_X1 and record.flags & FLAG_KNOWN_Y1 and counts.known != 0
    apart = moved is None and known and record.kind == KIND_LINEAR and not record.flags & FLAG_RELATIVE
    row = layer_of(state, counts, layers, record) if drawn else 0
    files = np.int64(1 if apart else 2)
    predict_raw(model, curve, state, counts, records, count, i, drawn, row, layers, errors, samples, moved, files)
    if drawn:
        layers[row].length += curve.length
    if drawn and apart:
        m0, m1 = to_motors(model, record.x1, record.y1)
        x, y = record.x1, record.y1
        draw(model, curve, state, pieces, n, record, PIECE_LINE, 0.0, 1.0, m0, m1, x, y, row, layers, errors)
        state.feed = record.feed


@inner
def _extend(low, high, x, y):
    """Move the corners of a rectangle so that (x, y) lies in it."""
    low[0], low[1] = min(low[0], x), min(low[1], y)
    high[0], high[1] = max(high[0], x), max(high[1], y)


@inner
def _extend_along(low, high, curve):
    """Move the corners of a rectangle so that the outermost places of an arc lie in it."""
    for quarter in range(4):
        angle = (0.5 * np.pi * quarter - curve.phi) * np.sign(curve.sweep) % (2.0 * np.pi)
        if angle < abs(curve.sweep):
            x, y, _ = place(curve, angle / abs(curve.sweep))
            _extend(low, high, x, y)


@inner
def _from_home(model, record, m0, m1):
    """Return how far a straight command to motors (m0, m1) may stray from its line [mm] if its start is unknown.

    It is assumed to come from home with belts anywhere in their play.
    """
    home_x, home_y = model.head.home[0], model.head.home[1]
    from0, from1 = to_motors(model, home_x, home_y)
    most = 0.0
    for i in range(LOOKS_FROM_HOME + 1):
        at0, at1 = from0 + i / LOOKS_FROM_HOME * (m0 - from0), from1 + i / LOOKS_FROM_HOME * (m1 - from1)
        for u0 in (forward(model, 0, LOWER, at0), forward(model, 0, UPPER, at0)):
            for u1 in (forward(model, 1, LOWER, at1), forward(model, 1, UPPER, at1)):
                x, y = printed(model, u0, u1)
                off, _ = line_distance(home_x, home_y, record.x1, record.y1, x, y)
                most = max(most, off)
    return most


@inner
def _count_left(counts, record, extruding):
    """Count an extruding move that stays as it is or has an unknown start, and keep the lines of the first few."""
    if extruding and counts.unknown == 0:
        counts.doubted = record.doubted
    if extruding and counts.unknown < UNKNOWN_LINES:
        counts.unknown_at[counts.unknown] = record.line + 1
    counts.unknown += extruding
    counts.unread += extruding and record.flags & FLAG_OPAQUE != 0


# Long because each kind of record leaves the loop by its own exit, in the order in which the kinds must be checked.
@entry(error_model="numpy", _nrt=False)
def mend(
    model, records, begin, count, state, counts, curve, moved, first, pieces, layers, errors, quantum, samples, run
):  # fmt: skip
    """Plan records[begin:count]; return the record before which it stopped.

    Record i becomes pieces[first[i]:first[i + 1]]; ``first`` int64 [count + 1] counts from the beginning of ``pieces``,
    an array of PIECE. It stops before a record whose pieces may not fit: call again with what is left.
    ``state`` and ``counts``, records of STATE and COUNTS, pass from call to call; ``curve`` and ``moved``, records of
    CURVE, are scratch, ``moved`` is None for a machine whose Z screw is perfect: its kernels are then not compiled.
    ``layers`` [L] of LAYER must have room for counts.layer + 2 + (count − begin); ``errors`` [2, ERROR_BINS] are
    histograms of mm of path. ``quantum`` [mm] is the grid of the numbers that will be written; ``samples``, a
    record of SAMPLES, holds places along the extruded path. ``run``, one of RUN, is scratch: the path being drawn.

    A motion record without a piece is to be copied as it is.
    """
    n = 0
    i = begin
    run.end = run.travel_end = begin
    while i < count and n + PIECES_A_RECORD < len(pieces):
        r = records[i]
        first[i] = n
        i += 1
        arc = r.kind == KIND_CW or r.kind == KIND_CCW
        if not arc and r.kind != KIND_LINEAR:
            event(model, state, counts, r)
            if r.flags & FLAG_EXTRUDING:
                _count_left(counts, r, True)
                trace(curve, r)
                _note_left(
                    model, curve, state, counts, pieces, n, r, records, count, i - 1, layers, errors, samples, moved
                )
            if moved is not None:
                height_event(model, state, counts, r)
            continue
        still = not arc and r.x0 == r.x1 and r.y0 == r.y1
        if still and r.advance > 0.0 and r.flags & FLAG_KNOWN_X1 and r.flags & FLAG_KNOWN_Y1:
            _extend(state.print_low, state.print_high, r.x1, r.y1)
        if still and not r.words & (WORD_X | WORD_Y):
            if moved is not None:
                if r.words & WORD_Z and r.flags & FLAG_OPAQUE:
                    follow_copied_height(model, state, counts, r)
                elif r.words & WORD_Z:
                    n = _raise(model, state, counts, pieces, n, records, count, i - 1, quantum)
            continue
        known = (r.flags & FLAG_KNOWN_X1) != 0 and (r.flags & FLAG_KNOWN_Y1) != 0
        extruding = r.flags & FLAG_EXTRUDING != 0
        role = (r.flags >> ROLE_SHIFT) & ROLE_MASK if extruding else TRAVEL
        model.head.chord, model.head.even = model.head.chords[role], role == ROLE_OUTER
        model.head.speed, model.head.accel = r.feed / 60.0, r.accel
        counts.moves += 1
        counts.roles |= 1 << role
        if extruding and known:
            counts.extruding += 1
            _extend(state.low, state.high, r.x1, r.y1)
            _extend(state.print_low, state.print_high, r.x1, r.y1)
            if r.flags & FLAG_KNOWN_X0 and r.flags & FLAG_KNOWN_Y0:
                _extend(state.print_low, state.print_high, r.x0, r.y0)
        if still and known and counts.known != 0 and not r.flags & FLAG_OPAQUE:
            if moved is not None:
                n = _raise(model, state, counts, pieces, n, records, count, i - 1, quantum)
            else:
                n = _name_place_again(model, state, pieces, n, r, quantum)
            continue
        trace(curve, r)
        if arc and extruding and known and r.flags & FLAG_KNOWN_X0 and r.flags & FLAG_KNOWN_Y0:
            _extend_along(state.print_low, state.print_high, curve)
        left = not known or r.flags & FLAG_OPAQUE != 0 or not stays_near(model, curve)
        if moved is not None:
            left = left or is_too_long(model, curve)
        if left:
            _count_left(counts, r, extruding)
            _note_left(model, curve, state, counts, pieces, n, r, records, count, i - 1, layers, errors, samples, moved)
            follow_copied(model, state, counts, r, known)
            if moved is not None:
                follow_copied_height(model, state, counts, r)
            if r.flags & FLAG_CURVE:  # a G5 curve is written as lines, or not at all
                x, y = r.x1, r.y1
                if counts.known != 0 and r.flags & FLAG_RELATIVE:
                    x, y = from_motors(model, state.mended.m[0], state.mended.m[1])
                n = put(pieces, n, PIECE_LINE, x, y, r.z1, 1.0, r.feed)
            continue
        sure = counts.known != 0
        drawn = extruding and sure
        files = np.int64(1 if sure else 2)
        row = 0
        if extruding:
            row = layer_of(state, counts, layers, r)
        elif r.feed > 0:
            state.travel_feed = r.feed
        predict_raw(
            model, curve, state, counts, records, count, i - 1, extruding, row, layers, errors, samples, moved, files
        )
        if extruding:
            layers[row].length += curve.length
        if drawn:
            state.drawn += curve.length
            if i > run.end:
                px = py = 0.0
                if moved is not None:
                    px, py = push(model, state.mended.m[ZED])
                survey(model, state, counts, records, count, i - 1, curve, run, px, py, moved is None)
                trace(curve, r)
            length = curve.length
            curve.least = max(curve.least, r.feed * model.head.period)
            if moved is not None:
                n = _extrude_in_space(
                    model, curve, moved, state, counts, pieces, n, r, row, layers, errors, quantum, run
                )
            else:
                at = run.begin
                n = extrude(model, curve, state, counts, pieces, n, r, row, layers, errors, quantum, run, at, length)
            run.begin += length
        else:
            _count_left(counts, r, extruding)
            parts = 1
            if arc:  # what draws nothing needs no better than this
                parts = min(max(4, np.int64(abs(curve.sweep) * np.sqrt(curve.r0 / 0.4))), CHORDS_A_RECORD)
            way = curve
            seen = sure and not arc and counts.anywhere == 0
            push_x = push_y = 0.0
            if moved is not None:
                if r.flags & FLAG_KNOWN_Z1:
                    m = find(model, state, counts, r, quantum)
                    aim(model, curve, moved, state.mended.m[ZED], m)
                    if seen:
                        seen, _, z, to = arrival(model, records, count, i - 1)
                    if seen:
                        push_x, push_y = arriving_push(model, state, z, to)
                        set_line(
                            moved, r.x0 - push_x, r.y0 - push_y, state.mended.m[ZED], r.x1 - push_x, r.y1 - push_y, m
                        )
                    lift(model, state, m)
                    way = moved
                else:
                    counts.height = 0
                    seen = False
            to0 = to1 = np.nan
            if seen:
                if i > run.travel_end:
                    plan_travel(model, state, records, count, i - 1, run, push_x, push_y)
                leg = run.legs[run.leg]
                to0, to1 = leg.motor[0], leg.motor[1]
                run.leg += 1
            for part in range(parts):
                at, to = part / parts, (part + 1.0) / parts
                n = _travel(model, way, state, counts, pieces, n, r, at, to, quantum, to0, to1)
            counts.anywhere = 0
        if not sure:
            # From here on the place is certain; the file as it is starts with the same uncertainty.
            open_interval(model, state.raw)
            if extruding:  # on its way there both machines err as the printer does
                m0, m1 = to_motors(model, r.x1, r.y1)
                note(layers, row, errors, 0, _from_home(model, r, m0, m1), 0.0)
                note(layers, row, errors, 1, _from_home(model, r, state.mended.m[0], state.mended.m[1]), 0.0)
        counts.known = 1
    first[i] = n
    counts.pieces += n
    return i
