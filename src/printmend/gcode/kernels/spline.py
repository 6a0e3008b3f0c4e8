# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)
"""Curves as chords: arcs, and G5, Marlin's cubic curve, as records of straight moves that any reader understands.

A G5 goes from P0 to P3 by (1 − t)³ P0 + 3 (1 − t)² t P1 + 3 (1 − t) t² P2 + t³ P3, where I and J lead from P0 to P1,
P and Q from P3 to P2; filament and height go with t (Marlin's `cubic_b_spline`).
"""

import numpy as np

from printmend.gcode.kernels.commands import begin_record, finish_record
from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.text import *
from printmend.jit import entry, inner


# Its many parameters are the fields of a record's arc: a caller that has no record gives them as they are.
@entry
def arc_chords(x0, y0, z0, x1, y1, z1, c0, c1, plane, clockwise, turns, tolerance, points):
    """Return how many chords an arc needs; fill ``points`` [n, 3] with their ends if it has that length.

    The sagitta r(1 − cos(φ/2)) of each chord is at most ``tolerance`` [mm]. A slightly different end radius (rounded
    coordinates) is blended in linearly, as firmwares do; the last point is the end itself.
    """
    if plane == 0:
        a0, b0, a1, b1, h0, h1 = x0, y0, x1, y1, z0, z1
    elif plane == 1:
        a0, b0, a1, b1, h0, h1 = z0, x0, z1, x1, y0, y1
    else:
        a0, b0, a1, b1, h0, h1 = y0, z0, y1, z1, x0, x1
    radius0, radius1 = np.hypot(a0 - c0, b0 - c1), np.hypot(a1 - c0, b1 - c1)
    angle0 = np.arctan2(b0 - c1, a0 - c0)
    sweep = np.arctan2(b1 - c1, a1 - c0) - angle0
    if clockwise:
        while sweep >= -1e-9:
            sweep -= 2.0 * np.pi
        sweep -= 2.0 * np.pi * turns
    else:
        while sweep <= 1e-9:
            sweep += 2.0 * np.pi
        sweep += 2.0 * np.pi * turns
    widest = max(radius0, radius1)
    step = 2.0 * np.arccos(max(1.0 - tolerance / widest, 0.0)) if widest > 0.0 else np.pi
    count = int(max(min(np.ceil(abs(sweep) / max(step, 1e-4)), 1e6), 1.0))
    if len(points) != count:
        return count
    for i in range(count):
        part = (i + 1) / count
        angle = angle0 + sweep * part
        radius = radius0 + (radius1 - radius0) * part
        a, b, h = c0 + radius * np.cos(angle), c1 + radius * np.sin(angle), h0 + (h1 - h0) * part
        if i + 1 == count:
            a, b = a1, b1
        if plane == 0:
            points[i, 0], points[i, 1], points[i, 2] = a, b, h
        elif plane == 1:
            points[i, 2], points[i, 0], points[i, 1] = a, b, h
        else:
            points[i, 1], points[i, 2], points[i, 0] = a, b, h
    return count


CHORD_OFF_MM = 0.005  # how far a chord may be off the curve: half of the tolerance of mending
MOST_CHORDS = 1024  # of one curve: none that fits on a bed needs more
CURVES_A_LINE = 8  # that are cut into chords: further ones of the line stay as they are
_CONTROLS = WORD_I | WORD_J | WORD_P | WORD_Q


@inner
def most_records(buf, p, stop):
    """Return how many records the line buf[p:stop] may become: one for two bytes, and `MOST_CHORDS` for each curve.

    Every spelling of a number that is read as 5 (`G05`, `G+5.0`, `G4.96`) has 4 or 5 as its first digit other than 0. A
    comment holds no statements. After a remark or a quoted text, which may hold any character, everything is counted.
    """
    begin, found, inside = p, 0, False
    while p < stop:
        byte = buf[p]
        if byte == SEMICOLON and not inside:
            break
        p += 1
        if byte in (OPEN, QUOTE):
            inside = True
        elif upper(byte) == LETTER_G:
            while p < stop and buf[p] in (ZERO, PLUS, MINUS, POINT):
                p += 1
            found += p < stop and buf[p] in (FOUR, FIVE)
    return (p - begin) // 2 + 2 + MOST_CHORDS * min(found, CURVES_A_LINE)


@inner
def chords_of(r, s, values, numbers, counts):
    """Return into how many chords the curve of a statement has to be cut; 0 where its course is unknown.

    For a parameter step h a chord is off by |B″| h²/8 at most, and B″ is largest at an end of the curve.
    Where I and J, or P and Q, are missing, firmwares differ.
    """
    sure = r.flags & FLAG_KNOWN_X0 and r.flags & FLAG_KNOWN_Y0 and counts.known & 3 == 3 and counts.plane == 0
    if not sure or s.unclear or s.twice & _CONTROLS or r.flags & (FLAG_OPAQUE | FLAG_G53) or s.code != 50:
        return 0
    if not (s.words & (WORD_I | WORD_J) and s.words & (WORD_P | WORD_Q)):
        return 0
    x1, y1, x2, y2 = _controls(r, s, values, numbers, counts)
    begin = np.hypot(r.x0 - 2.0 * x1 + x2, r.y0 - 2.0 * y1 + y2)
    end = np.hypot(x1 - 2.0 * x2 + numbers.pos[0], y1 - 2.0 * y2 + numbers.pos[1])
    count = np.ceil(np.sqrt(6.0 * max(begin, end) / (8.0 * CHORD_OFF_MM)))
    stands = r.x0 == numbers.pos[0] and r.y0 == numbers.pos[1] and max(begin, end) == 0.0
    if not count <= MOST_CHORDS or stands:
        return 0
    return max(np.int64(count), 1)  # one: a straight line at an even pace


@inner
def _controls(r, s, values, numbers, counts):
    """Return the places of both control points (x1, y1, x2, y2) [mm]."""
    unit = 25.4 if counts.inch else 1.0
    i, j = values[VALUE_I] if s.words & WORD_I else 0.0, values[VALUE_J] if s.words & WORD_J else 0.0
    p, q = values[VALUE_P] if s.words & WORD_P else 0.0, values[VALUE_Q] if s.words & WORD_Q else 0.0
    return r.x0 + i * unit, r.y0 + j * unit, numbers.pos[0] + p * unit, numbers.pos[1] + q * unit


# Its many parameters are the state of the interpreter and the statement in hand.
@inner
def put_chords(records, n, s, values, numbers, counts, count):
    """Write the curve that record n begins as ``count`` straight moves; return the next free record.

    All but the last have no text of their own: they begin and end where the statement begins.
    """
    r = records[n]
    x0, y0, z0, e0 = r.x0, r.y0, r.z0, r.e0
    begin, end, after, flags = r.begin, r.end, r.next, (r.flags | FLAG_CURVE) & ~np.uint32(FLAG_EXTRUDING)
    x1, y1, x2, y2 = _controls(r, s, values, numbers, counts)
    x3, y3, z3, e3 = numbers.pos[0], numbers.pos[1], numbers.pos[2], numbers.e
    advance = (e3 - e0) * numbers.flow / (numbers.area if numbers.area > 0 else 1.0)
    known = flags & (FLAG_KNOWN_X0 | FLAG_KNOWN_Y0 | FLAG_KNOWN_Z0)
    numbers.pos[0], numbers.pos[1], numbers.pos[2], numbers.e = x0, y0, z0, e0
    for k in range(1, count + 1):
        r = records[n]
        own = k == count
        begin_record(r, begin, end if own else begin, after if own else begin, numbers, counts, flags)
        if k == 1:
            r.flags = r.flags & ~np.uint32(FLAG_KNOWN_Z0) | known
        t = k / count
        a, b, c, d = (1.0 - t) ** 3, 3.0 * (1.0 - t) ** 2 * t, 3.0 * (1.0 - t) * t * t, t**3
        numbers.pos[0] = x3 if own else a * x0 + b * x1 + c * x2 + d * x3
        numbers.pos[1] = y3 if own else a * y0 + b * y1 + c * y2 + d * y3
        numbers.pos[2] = z3 if own else z0 + t * (z3 - z0)
        numbers.e = e3 if own else e0 + t * (e3 - e0)
        r.kind, r.words, r.advance = KIND_LINEAR, s.words & ~np.int64(_CONTROLS), advance / count
        if r.advance > 0.0:
            r.flags = r.flags | FLAG_EXTRUDING
        finish_record(r, numbers, counts)
        n += 1
    return n
