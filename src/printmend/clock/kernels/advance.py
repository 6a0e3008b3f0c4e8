"""The clock's way through a file: records of what the machine is told, seconds."""

import numpy as np

from printmend.clock.kernels.corner import corner2
from printmend.clock.kernels.layout import FIRST_FEED_MM_MIN, KLIPPER, NO_MOVE_MM, QUEUE, RRF
from printmend.clock.kernels.queue import run
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

_DIAGONAL = np.sqrt(2.0) - 1.0
MOST_CHORDS = 20_000.0  # of one arc


@inner(error_model="numpy", _nrt=False)
def _deviation_mm(limits):
    """Return Klipper's junction deviation δ = (√2 − 1) v²/a, by which a right angle is taken at the corner speed."""
    return _DIAGONAL * limits.corner_speed * limits.corner_speed / limits.print_accel


@inner(error_model="numpy", _nrt=False)
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


@inner(error_model="numpy", _nrt=False)
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


@inner(error_model="numpy", _nrt=False)
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


@inner(error_model="numpy", _nrt=False)
def _plane(plane, x, y, z):
    """Return a place as the two coordinates of an arc's plane and the height above it."""
    if plane == 0:
        return x, y, z
    return (z, x, y) if plane == 1 else (y, z, x)


# Its many parameters are the clock's arrays, and the arc, whose ends are not those of its record.
@inner(error_model="numpy", _nrt=False)
def _add_arc(limits, clock, queue, times, r, x, y, z, c0, c1, advance_mm, feed):
    """Queue an arc to (x, y, z) as the chords that a firmware makes of it."""
    a0, b0, h0 = _plane(r.plane, clock.at[0], clock.at[1], clock.at[2])
    a1, b1, h1 = _plane(r.plane, x, y, z)
    radius, radius1 = np.hypot(a0 - c0, b0 - c1), np.hypot(a1 - c0, b1 - c1)
    angle = np.arctan2(b0 - c1, a0 - c0)
    way = 1.0 if r.kind == KIND_CCW else -1.0
    sweep = np.mod(way * (np.arctan2(b1 - c1, a1 - c0) - angle), 2.0 * np.pi)
    if sweep <= 1e-9:
        sweep = 2.0 * np.pi
    sweep += 2.0 * np.pi * r.turns
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


@inner(error_model="numpy", _nrt=False)
def _go(limits, clock, queue, times, r, is_arc, x, y, z, c0, c1, advance_mm, feed):
    """Queue a move to (x, y, z)."""
    if is_arc:
        _add_arc(limits, clock, queue, times, r, x, y, z, c0, c1, advance_mm, feed)
    else:
        _add(limits, clock, queue, times, x - clock.at[0], y - clock.at[1], z - clock.at[2], advance_mm, feed)
    clock.at[0], clock.at[1], clock.at[2] = x, y, z


@inner(error_model="numpy", _nrt=False)
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


@inner(error_model="numpy", _nrt=False)
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


@inner(error_model="numpy", _nrt=False)
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
            is_arc = r.kind != KIND_LINEAR
            _go(limits, clock, queue, times, r, is_arc, x, y, z, r.c0, r.c1, r.advance, r.feed)
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
            _go(limits, clock, queue, times, r, p.kind == PIECE_ARC, p.x, p.y, p.z, p.c0, p.c1, advance_mm, feed)
            limits.print_accel, limits.travel_accel = printing, travelling
    while n < len(notes) and end == len(records):
        _obey(limits, clock, queue, times, notes[n])
        n += 1
    if stop:
        run(limits, clock, queue, times, True)
