"""Compiled kernels of the clock: moves in, seconds out. They import numpy and other kernels only."""

import numpy as np

from printmend.gcode.kernels.layout import (
    EVENT_MACRO,
    EVENT_PAUSE,
    EVENT_PROBE,
    EVENT_TOOL,
    EVENT_UNKNOWN,
    FLAG_OPAQUE,
    FLAG_RELATIVE,
    KIND_CCW,
    KIND_CW,
    KIND_EVENT,
    KIND_HOME,
    KIND_LINEAR,
    KIND_RETRACT,
    NOTE_ACCEL,
    NOTE_ACCELS,
    NOTE_CORNERS,
    NOTE_DWELL,
    NOTE_LIMITS,
    NOTE_PERCENT,
    NOTE_SPEEDS,
    NOTE_TIME,
    PIECE_ARC,
    PIECE_TRAVEL,
    TELL_MASK,
    TELL_S,
    TELL_SHIFT,
    WORD_X,
    WORD_Y,
    WORD_Z,
)
from printmend.jit import entry, inner

# What the kernels of the clock share: the machine's limits, the queue of moves, and where the clock is.

KLIPPER, JERK, DEVIATION, RRF = 0, 1, 2, 3
"""How a firmware takes corners: Klipper; Marlin by jerk or by junction deviation; RepRapFirmware."""

# Axes are X, Y, Z, E. Speeds are mm/s, accelerations mm/s².
LIMITS = np.dtype(
    [
        ("corner", "i8"),  # KLIPPER, JERK, DEVIATION or RRF
        ("blocks", "i8"),  # moves that the firmware's own queue holds; Klipper's holds all that matter
        ("speed", "f8", 4),
        ("accel", "f8", 4),
        ("print_accel", "f8"),
        ("travel_accel", "f8"),
        ("retract_accel", "f8"),
        ("jump", "f8", 4),  # of speed, which an axis does at once
        ("deviation", "f8"),  # at a junction [mm]
        ("velocity", "f8"),  # Klipper: of the head
        ("corner_speed", "f8"),  # Klipper: at a right angle
        ("cruise_ratio", "f8"),  # Klipper: the least share of cruising in a move that speeds up and slows down
        ("percent", "f8"),  # M220
        ("arc_mm", "f8"),  # the length of an arc's chords
    ],
    align=True,
)
# A move that waits for its neighbours. Squares of speeds are mm²/s².
MOVE = np.dtype(
    [
        ("length", "f8"),  # [mm]
        ("unit", "f8", 4),  # mm of each axis per mm
        ("speed", "f8"),
        ("accel", "f8"),
        ("deviation", "f8"),  # Klipper: at a junction [mm], by the limits of its time
        ("safe", "f8"),  # Marlin: the speed to which each axis may jump from rest
        ("corner2", "f8"),  # the largest squared speed at which it may begin, by the corner before it
        ("gain2", "f8"),  # by how much the squared speed changes over it at full acceleration
        ("soft2", "f8"),  # the same with Klipper's smaller acceleration for moves that speed up and slow down
        ("start2", "f8"),  # Klipper: the largest squared speed at its start, by what came before
        ("soft_start2", "f8"),
        ("before", "i8"),  # the notes of time that stand before it
        # found when the moves after it are known
        ("begin2", "f8"),
        ("soft_begin2", "f8"),
        ("peak2", "f8"),
    ],
    align=True,
)
QUEUE = 4096  # moves: beyond the last thousand of them nothing has to brake yet
AHEAD = 1024
TIMES = 100_000  # notes of time whose seconds are kept
CLOCK = np.dtype(
    [
        ("seconds", "f8"),  # of all moves that are done
        ("queued", "i8"),
        ("notes", "i8"),  # of time, seen
        ("noted", "i8"),  # and done
        ("at", "f8", 3),  # the commanded place [mm], NaN where unknown
        ("begin2", "f8"),  # the squared speed at which the queue's first move begins
        ("peak2", "f8"),  # Klipper: the largest squared speed of moves that only slow down, from the moves before
    ],
    align=True,
)
FIRST_FEED_MM_MIN = 1500.0  # of a file that moves before it names F
LEAST_SPEED_MM_S = 0.05  # Marlin's and RRF's, at a stop
EXTRUDER_CORNER_MM_S = 1.0  # Klipper's instantaneous_corner_velocity, as it is unless set
NO_MOVE_MM = 1e-9

# How fast a corner between two moves is taken: a rule for each kind of firmware.

_SHORT_MM = 1.0  # Marlin: a shorter move may be a chord of an arc, whose radius then counts …
_ARC_COS = np.sqrt(0.5)  # … where it turns by less than 45°
_SAFE_SHARE = 0.99  # Marlin: of a corner's speed, from which stopping is no slower


@inner
def _axes_cos(last, move, axes):
    """Return the cosine of the angle by which the path turns, over so many axes."""
    total = 0.0
    for axis in range(axes):
        total += last.unit[axis] * move.unit[axis]
    return min(max(total, -1.0), 1.0)


@inner
def _rounded2(deviation_mm, accel, cos):
    """Return the squared speed on a circle that strays from the corner by a deviation (Jeon 2011): v² = a δ s/(1 − s),
    s = sin θ/2 = √((1 + cos)/2) for a path that turns by an angle with that cosine."""
    sine = np.sqrt(max(0.5 * (1.0 + cos), 0.0))
    return np.inf if sine >= 1.0 else deviation_mm * accel * sine / (1.0 - sine)


@inner
def _is_still(move):
    """Say whether the head stands during a move."""
    return move.unit[0] == 0.0 and move.unit[1] == 0.0 and move.unit[2] == 0.0


@inner
def _klipper2(last, move):
    """Klipper: a circle at the corner, which touches no move beyond its middle; the extruder's own jump."""
    if _is_still(last) or _is_still(move):
        return 0.0
    most2 = np.inf
    jump = abs(move.unit[3] - last.unit[3])
    if jump > 0.0:
        most2 = (EXTRUDER_CORNER_MM_S / jump) ** 2
    cos = _axes_cos(last, move, 3)
    if cos >= 1.0 - 1e-15:
        return most2
    sine, cosine = np.sqrt(0.5 * (1.0 + cos)), np.sqrt(max(0.5 * (1.0 - cos), 0.0))
    # tan θ/2 = sine / cosine: the circle of the tangent length ℓ has r = ℓ tan θ/2, and v² = a r
    tangent = 0.5 * sine / cosine
    for one in (last, move):
        most2 = min(most2, _rounded2(one.deviation, one.accel, cos), one.accel * one.length * tangent)
    return most2


@inner
def safe_speed(limits, move):
    """Return the speed to which each axis may jump from rest."""
    speed = move.speed
    for axis in range(4):
        if abs(move.unit[axis]) * speed > limits.jump[axis]:
            speed = limits.jump[axis] / abs(move.unit[axis])
    return speed


@inner
def _jerk_speed(limits, last, move):
    """Marlin: no axis jumps by more than its jerk; one that turns back counts with the larger of both speeds."""
    speed = min(last.speed, move.speed)
    most = speed
    for axis in range(4):
        before, after = last.unit[axis], move.unit[axis]
        jump = abs(after - before) if before * after >= 0.0 else max(abs(before), abs(after))
        if jump * most > limits.jump[axis]:
            most = limits.jump[axis] / jump
    return move.safe if min(last.safe, move.safe) > _SAFE_SHARE * most else most


@inner
def _deviation2(limits, last, move):
    """Marlin: a circle at the corner; on short moves that hardly turn the circle of which they are chords."""
    cos = _axes_cos(last, move, 4)
    most2 = _rounded2(limits.deviation, move.accel, cos)
    if move.length < _SHORT_MM and cos > _ARC_COS:
        turn = np.arccos(cos)
        if turn > 0.0:
            most2 = min(most2, move.accel * move.length / turn)
    return most2


@inner
def _rrf_speed(limits, last, move):
    """RepRapFirmware: no drive jumps by more than its limit, between two moves that both print or both do not."""
    if (last.unit[3] > 0.0) != (move.unit[3] > 0.0) or _is_still(last) != _is_still(move):
        return 0.0
    speed = min(last.speed, move.speed)
    for axis in range(4):
        jump = abs(move.unit[axis] - last.unit[axis])
        if jump * speed > limits.jump[axis]:
            speed = limits.jump[axis] / jump
    return speed


@inner
def corner2(limits, last, move, is_first):
    """Return the largest squared speed at which ``move`` may begin after ``last``, or from rest as the first."""
    least2 = LEAST_SPEED_MM_S * LEAST_SPEED_MM_S
    if limits.corner == KLIPPER:
        return 0.0 if is_first else min(_klipper2(last, move), min(last.speed, move.speed) ** 2)
    if limits.corner == JERK:
        move.safe = safe_speed(limits, move)
        speed = move.safe if is_first else _jerk_speed(limits, last, move)
        return max(speed * speed, least2)
    if is_first:
        return least2
    most2 = min(last.speed, move.speed) ** 2
    if limits.corner == DEVIATION:
        return max(min(most2, _deviation2(limits, last, move)), least2)
    return max(_rrf_speed(limits, last, move) ** 2, least2)


# The queue of moves: how fast each begins, once it is known what follows, and how long it takes.


@inner
def _seconds(length, accel, begin2, cruise2, end2):
    """Return how long a move takes that speeds up, cruises and slows down; all squared speeds [mm²/s²]."""
    begin, cruise, end = np.sqrt(begin2), np.sqrt(cruise2), np.sqrt(end2)
    changing = (2.0 * cruise2 - begin2 - end2) / (2.0 * accel)
    return (2.0 * cruise - begin - end) / accel + max(length - changing, 0.0) / cruise


@inner
def _pass_notes(clock, times, to):
    """Write down the time for the notes up to number ``to``."""
    while clock.noted < to:
        if clock.noted < len(times):
            times[clock.noted] = clock.seconds
        clock.noted += 1


@inner
def _look_back(queue, count):
    """Find how fast each move may begin so that the last one can stop, at the full and at Klipper's smaller braking.

    In the second plan, the soft one, speed forms hills over the path: a move climbs over all of its length, falls over
    all of it, or has a top in it; a top may also lie between a move that climbs and one that falls. ``peak2`` of the
    moves up to a top is the top's; of those that fall it is infinite.
    """
    end2 = soft_end2 = peak2 = 0.0
    falls_after = False
    for i in range(count - 1, -1, -1):
        move = queue[i]
        move.begin2 = min(move.start2, end2 + move.gain2)
        braking2 = soft_end2 + move.soft2  # from which the soft plan brakes over the whole move
        falls = move.soft_start2 >= braking2
        move.soft_begin2 = braking2 if falls else move.soft_start2
        climbs = move.soft_begin2 + move.soft2 <= soft_end2
        if not falls and (falls_after or not climbs):
            peak2 = min(move.speed * move.speed, (move.soft_begin2 + braking2) / 2.0)
        move.peak2 = np.inf if falls else peak2
        end2, soft_end2, falls_after = move.begin2, move.soft_begin2, falls


@inner
def _run_klipper(clock, queue, count, done, times):
    """Let the first ``done`` of ``count`` moves go by as Klipper's look-ahead plans them.

    It limits the top speed of each hill to that of the soft plan; on its way down no move speeds up again.
    """
    _look_back(queue, count)
    for i in range(done):
        move = queue[i]
        begin2, end2 = move.begin2, queue[i + 1].begin2 if i + 1 < count else 0.0
        if move.peak2 == np.inf:  # it only slows down
            clock.peak2 = cruise2 = min(clock.peak2, begin2)
        else:
            clock.peak2 = move.peak2
            cruise2 = min((begin2 + end2 + move.gain2) / 2.0, min(move.speed * move.speed, move.peak2))
        _pass_notes(clock, times, move.before)
        if cruise2 > 0.0:
            begin2, end2 = min(begin2, cruise2), min(end2, cruise2)
            clock.seconds += _seconds(move.length, move.accel, begin2, cruise2, end2)


@inner
def _run_blocks(limits, clock, queue, count, done, times):
    """Let the first ``done`` of ``count`` moves go by as a firmware plans them whose queue holds a few blocks.

    When a move begins, what is in the queue is known, and the last of that has to be able to stop.
    """
    stop2 = LEAST_SPEED_MM_S * LEAST_SPEED_MM_S
    for i in range(done):
        move = queue[i]
        last = min(i + limits.blocks, count)
        begin2, end2, braking2 = max(clock.begin2, stop2), np.inf, 0.0
        for j in range(i + 1, last):
            end2 = min(end2, queue[j].corner2 + braking2)
            braking2 += queue[j].gain2
            if braking2 >= end2:
                break
        end2 = min(min(end2, braking2 + stop2), begin2 + move.gain2)
        end2 = max(end2, begin2 - move.gain2)
        cruise2 = max(min(move.speed * move.speed, (begin2 + end2 + move.gain2) / 2.0), max(begin2, end2))
        _pass_notes(clock, times, move.before)
        clock.seconds += _seconds(move.length, move.accel, begin2, cruise2, end2)
        clock.begin2 = end2


@inner
def run(limits, clock, queue, times, stop):
    """Let moves go by: all of them where the machine must stop after the last, else those that what follows cannot
    change."""
    count = clock.queued
    done = count if stop else count - AHEAD
    if limits.corner == KLIPPER:
        _run_klipper(clock, queue, count, done, times)
    else:
        _run_blocks(limits, clock, queue, count, done, times)
    for i in range(done, count):
        queue[i - done] = queue[i]
    clock.queued = count - done
    if stop:
        clock.begin2, clock.peak2 = 0.0, np.inf
        _pass_notes(clock, times, clock.notes)


# The clock's way through a file: records of what the machine is told, seconds.

_DIAGONAL = np.sqrt(2.0) - 1.0
MOST_CHORDS = 20_000.0  # of one arc


@inner
def _deviation_mm(limits):
    """Return Klipper's junction deviation δ = (√2 − 1) v²/a, by which a right angle is taken at the corner speed."""
    return _DIAGONAL * limits.corner_speed * limits.corner_speed / limits.print_accel


@inner
def _limit_klipper(limits, move):
    """Set a move's speed and acceleration as Klipper does: of the head, of Z, and of the extruder where it alone moves
    or is drawn back."""
    move.speed, move.accel = min(move.speed, limits.velocity), limits.print_accel
    head = move.unit[0] != 0.0 or move.unit[1] != 0.0
    if not head and move.unit[2] == 0.0:
        move.speed, move.accel = min(move.speed, limits.speed[3]), limits.accel[3]
        return
    if move.unit[2] != 0.0:
        move.speed = min(move.speed, limits.speed[2] / abs(move.unit[2]))
        move.accel = min(move.accel, limits.accel[2] / abs(move.unit[2]))
    if move.unit[3] < 0.0 or (move.unit[3] > 0.0 and not head):
        move.speed = min(move.speed, limits.speed[3] / abs(move.unit[3]))
        move.accel = min(move.accel, limits.accel[3] / abs(move.unit[3]))


@inner
def _limit_axes(limits, move):
    """Set a move's speed and acceleration as Marlin and RepRapFirmware do: by its kind, and by each axis."""
    head = move.unit[0] != 0.0 or move.unit[1] != 0.0 or move.unit[2] != 0.0
    move.accel = limits.print_accel if move.unit[3] != 0.0 else limits.travel_accel
    if not head:
        move.accel = limits.retract_accel
    for axis in range(4):
        share = abs(move.unit[axis])
        if share * move.speed > limits.speed[axis]:
            move.speed = limits.speed[axis] / share
        if share * move.accel > limits.accel[axis]:
            move.accel = limits.accel[axis] / share


@inner
def _add(limits, clock, queue, times, dx, dy, dz, de, feed):
    """Queue a straight move by (dx, dy, dz, de) mm at ``feed`` mm/min; one that moves nothing is none."""
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    if not length >= NO_MOVE_MM:
        dx = dy = dz = 0.0
        length = abs(de)
        if not length > 0.0:
            return
    if clock.queued == QUEUE:
        run(limits, clock, queue, times, False)
    n = clock.queued
    move, last = queue[n], queue[max(n - 1, 0)]
    move.before, move.length = clock.notes, length
    move.unit[0], move.unit[1], move.unit[2], move.unit[3] = dx / length, dy / length, dz / length, de / length
    move.speed = (feed if feed > 0.0 else FIRST_FEED_MM_MIN) / 60.0 * limits.percent / 100.0
    if limits.corner == KLIPPER:
        _limit_klipper(limits, move)
        move.deviation = _deviation_mm(limits)
    else:
        _limit_axes(limits, move)
    move.gain2 = 2.0 * move.length * move.accel
    move.corner2 = corner2(limits, last, move, n == 0)
    if limits.corner == KLIPPER:
        # by the head's acceleration, also where Z or the extruder has a smaller one
        move.soft2 = min(move.gain2, 2.0 * move.length * limits.print_accel * (1.0 - limits.cruise_ratio))
        move.start2 = move.soft_start2 = 0.0
        if n > 0:
            move.start2 = min(move.corner2, last.start2 + last.gain2)
            move.soft_start2 = min(move.start2, last.soft_start2 + last.soft2)
    elif n == 0:
        clock.begin2 = move.corner2
    clock.queued = n + 1


@inner
def _plane(plane, x, y, z):
    """Return a place as the two coordinates of an arc's plane and the height above it."""
    if plane == 0:
        return x, y, z
    return (z, x, y) if plane == 1 else (y, z, x)


# Its many parameters are the clock's arrays, and the arc, whose ends are not those of its record.
@inner
def _add_arc(limits, clock, queue, times, r, turns, x, y, z, c0, c1, advance_mm, feed):
    """Queue an arc to (x, y, z), with further full ``turns``, as the chords that a firmware makes of it."""
    a0, b0, h0 = _plane(r.plane, clock.at[0], clock.at[1], clock.at[2])
    a1, b1, h1 = _plane(r.plane, x, y, z)
    radius, radius1 = np.hypot(a0 - c0, b0 - c1), np.hypot(a1 - c0, b1 - c1)
    angle = np.arctan2(b0 - c1, a0 - c0)
    way = 1.0 if r.kind == KIND_CCW else -1.0
    sweep = np.mod(way * (np.arctan2(b1 - c1, a1 - c0) - angle), 2.0 * np.pi)
    if sweep <= 1e-9:
        sweep = 2.0 * np.pi
    sweep += 2.0 * np.pi * turns
    length = np.hypot(sweep * radius, h1 - h0)
    count = np.int64(min(max(length / limits.arc_mm, 1.0), MOST_CHORDS))
    if not length >= 0.0:  # its start is unknown
        return
    for i in range(1, count + 1):
        part = i / count
        at = angle + way * sweep * part
        reach = radius + (radius1 - radius) * part
        to_a, to_b = (c0 + reach * np.cos(at), c1 + reach * np.sin(at)) if i < count else (a1, b1)
        da, db, dh = to_a - a0, to_b - b0, (h1 - h0) / count
        a0, b0 = to_a, to_b
        if r.plane == 0:
            _add(limits, clock, queue, times, da, db, dh, advance_mm / count, feed)
        elif r.plane == 1:
            _add(limits, clock, queue, times, db, dh, da, advance_mm / count, feed)
        else:
            _add(limits, clock, queue, times, dh, da, db, advance_mm / count, feed)


@inner
def _go(limits, clock, queue, times, r, turns, x, y, z, c0, c1, advance_mm, feed):
    """Queue a move to (x, y, z): an arc with further full ``turns``, or a straight one where they are −1."""
    if turns >= 0:
        _add_arc(limits, clock, queue, times, r, turns, x, y, z, c0, c1, advance_mm, feed)
    else:
        _add(limits, clock, queue, times, x - clock.at[0], y - clock.at[1], z - clock.at[2], advance_mm, feed)
    clock.at[0], clock.at[1], clock.at[2] = x, y, z


@inner
def _obey(limits, clock, queue, times, note):
    """Take over what a note says of limits and waiting."""
    value = note.values
    if note.what == NOTE_TIME:
        clock.notes += 1
        if clock.queued == 0:
            run(limits, clock, queue, times, True)
    elif note.what == NOTE_DWELL:
        run(limits, clock, queue, times, True)
        clock.seconds += max(value[0], 0.0)
        if limits.corner != KLIPPER:  # which knows P only
            clock.seconds += max(value[1], 0.0)
    elif note.what == NOTE_PERCENT:
        limits.percent = max(value[0], 1.0)
    elif limits.corner == KLIPPER:
        _limit_by_note(limits, note)
    elif note.what in (NOTE_SPEEDS, NOTE_ACCELS, NOTE_CORNERS):
        table = (
            limits.speed if note.what == NOTE_SPEEDS else (limits.accel if note.what == NOTE_ACCELS else limits.jump)
        )
        per_s = 60.0 if limits.corner == RRF and note.what != NOTE_ACCELS else 1.0
        for axis in range(4):
            if value[axis] > 0.0:
                table[axis] = value[axis] / per_s
        if note.what == NOTE_CORNERS and value[4] > 0.0:
            limits.deviation = value[4]
    elif note.what == NOTE_ACCEL:
        printing, travel, retract, both = value[0], value[1], value[2], value[3]
        if both > 0.0:  # the older way: S of all moves, T of retractions
            limits.print_accel = limits.travel_accel = both
            if travel > 0.0:
                limits.retract_accel = travel
        else:
            limits.print_accel = printing if printing > 0.0 else limits.print_accel
            limits.travel_accel = travel if travel > 0.0 else limits.travel_accel
            limits.retract_accel = retract if retract > 0.0 else limits.retract_accel


@inner
def _limit_by_note(limits, note):
    """Take over what Klipper's own SET_VELOCITY_LIMIT says, or M204; it knows no other limits."""
    value = note.values
    if note.what == NOTE_ACCEL:
        if value[3] > 0.0:
            limits.print_accel = value[3]
        elif value[0] > 0.0 and value[1] > 0.0:
            limits.print_accel = min(value[0], value[1])
    elif note.what == NOTE_LIMITS:
        if value[0] > 0.0:
            limits.velocity = value[0]
        if value[1] > 0.0:
            limits.print_accel = value[1]
        if value[2] >= 0.0:
            limits.corner_speed = value[2]
        if 0.0 <= value[3] < 1.0:
            limits.cruise_ratio = value[3]
        if value[4] > 0.0:
            limits.cruise_ratio = 1.0 - min(value[4] / limits.print_accel, 1.0)


@inner
def _stops(r):
    """Say whether the head stands still for a record that moves nothing: it homes, probes, changes the tool, pauses."""
    if r.kind == KIND_HOME or r.kind == KIND_RETRACT:
        return True
    stopping = (EVENT_MACRO, EVENT_PAUSE, EVENT_TOOL, EVENT_PROBE, EVENT_UNKNOWN)
    return r.kind == KIND_EVENT and r.event in stopping


# Its many parameters are the clock's arrays, which `Clock` allocates once, and what is planned of a batch.
@entry(error_model="numpy", _nrt=False)
def advance(limits, clock, queue, times, records, begin, end, notes, first, pieces, stop):
    """Let records[begin:end] go by, with the notes that stand before each of them; then ``stop``, or not.

    Unless ``first`` is empty, record i is told as pieces[first[i]:first[i + 1]] instead, as `emit` writes it.
    ``limits`` and ``clock`` are records of LIMITS and CLOCK, ``queue`` is an array of MOVE; ``times`` gets the second
    of each note of time.
    """
    mended = len(first) > 0
    at = clock.at
    n = 0
    while n < len(notes) and notes[n].record < begin:
        n += 1
    for i in range(begin, end):
        while n < len(notes) and notes[n].record <= i:
            _obey(limits, clock, queue, times, notes[n])
            n += 1
        r = records[i]
        if r.kind != KIND_LINEAR and r.kind != KIND_CW and r.kind != KIND_CCW:
            if _stops(r):
                run(limits, clock, queue, times, True)
            if r.kind == KIND_EVENT:  # a line that is not read for certain is taken to go where it seems to
                at[0], at[1], at[2] = r.x0, r.y0, r.z0
                _go(limits, clock, queue, times, r, -1, r.x1, r.y1, r.z1, r.c0, r.c1, r.advance, r.feed)
            if r.kind == KIND_HOME or r.kind == KIND_EVENT:
                at[0] = np.nan
            continue
        if np.isnan(at[0]) or not mended:
            at[0], at[1], at[2] = r.x0, r.y0, r.z0
        count = first[i + 1] - first[i] if mended and not r.flags & FLAG_OPAQUE else 0
        if count == 0:
            x = r.x1 if r.words & WORD_X else at[0]  # a mended head is not where the file has it
            y = r.y1 if r.words & WORD_Y else at[1]
            z = r.z1 if r.words & WORD_Z else at[2]
            if r.flags & FLAG_RELATIVE:
                x, y, z = at[0] + r.x1 - r.x0, at[1] + r.y1 - r.y0, at[2] + r.z1 - r.z0
            turns = np.int64(r.turns) if r.kind != KIND_LINEAR else -1
            _go(limits, clock, queue, times, r, turns, x, y, z, r.c0, r.c1, r.advance, r.feed)
            continue
        for j in range(first[i], first[i + 1]):
            p = pieces[j]
            feed = p.feed if p.feed > 0.0 else r.feed
            advance_mm = 0.0 if p.kind == PIECE_TRAVEL else p.share * r.advance
            printing, travelling = limits.print_accel, limits.travel_accel
            if p.accel > 0.0:
                limits.print_accel = p.accel
                if (r.flags >> TELL_SHIFT) & TELL_MASK == TELL_S:
                    limits.travel_accel = p.accel
            turns = -1
            if p.kind == PIECE_ARC:
                turns = np.int64(r.turns) if p.share == 1.0 else 0
            _go(limits, clock, queue, times, r, turns, p.x, p.y, p.z, p.c0, p.c1, advance_mm, feed)
            limits.print_accel, limits.travel_accel = printing, travelling
    while n < len(notes) and end == len(records):
        _obey(limits, clock, queue, times, notes[n])
        n += 1
    if stop:
        run(limits, clock, queue, times, True)
