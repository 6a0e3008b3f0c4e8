# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)
"""The short way for the line that files are made of: `G1 X… Y… E…`, one blank between words, millimetres.

It does what the general way in `interpret` does to such a line, in half the time; anything else it leaves alone.
"""

import numpy as np

from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.text import *
from printmend.jit import inner


# Long because it is one pass over the line's bytes: what makes a line no plain move ends it where it is seen.
# Its digits are read as in `text.parse_number`: through one function for both, a file takes a third longer to read.
@inner
def plain_move(buf, p, end, numbers, counts, records, n):
    """Obey the line at p and fill record n; return the start of the next line, or −1 if it is no plain move."""
    if p + 4 > end or buf[p] != LETTER_G or (buf[p + 1] != ONE and buf[p + 1] != ZERO) or buf[p + 2] != SPACE:
        return -1
    if counts.inch != 0 or counts.e_is_a != 0:
        return -1
    start = p
    x = y = z = e = f = 0.0
    words = 0
    p += 2
    while p < end and buf[p] == SPACE and p - start < MAX_CODE_BYTES:
        p += 1
        if p + 1 >= end:
            return -1
        letter = buf[p]
        if letter == SEMICOLON:
            break
        p += 1
        negative = buf[p] == MINUS
        p += negative
        first = p
        whole = np.int64(0)
        while p < end:
            digit = digit_of(buf[p])
            if digit < 0 or digit > 9:
                break
            whole = whole * 10 + digit
            p += 1
        digits, decimals = p - first, 0
        if p < end and buf[p] == POINT:
            p += 1
            first = p
            while p < end:
                digit = digit_of(buf[p])
                if digit < 0 or digit > 9:
                    break
                whole = whole * 10 + digit
                p += 1
            decimals = p - first
            digits += decimals
        if digits == 0 or digits > 15:
            return -1
        value = float(whole) / POWERS[decimals]
        if negative:
            value = -value
        bit = 0
        if letter == LETTER_X:
            x, bit = value, WORD_X
        elif letter == LETTER_Y:
            y, bit = value, WORD_Y
        elif letter == LETTER_E:
            e, bit = value, WORD_E
        elif letter == LETTER_F:
            f, bit = abs(value), WORD_F
        elif letter == LETTER_Z:
            z, bit = value, WORD_Z
        if bit == 0 or words & bit or (bit == WORD_F and f == 0.0):
            return -1
        words |= bit
    if p < end and buf[p] == SEMICOLON:
        while p < end and buf[p] != LF and buf[p] != CR:
            p += 1
    stop = p
    if p < end:
        if buf[p] == CR:
            p += 1
        if p >= end or buf[p] != LF:
            return -1
        p += 1

    relative = counts.relative != 0
    e_relative = counts.m83 != 0 or (relative and counts.rule == E_EITHER)
    known, sure = counts.known, counts.offset_known
    x0, y0, z0, e0 = numbers.pos[0], numbers.pos[1], numbers.pos[2], numbers.e
    ox, oy, oz = numbers.offset[0], numbers.offset[1], numbers.offset[2]
    feed, flow, area = numbers.feed, numbers.flow, numbers.area
    layer, plane, line = counts.layer, counts.plane, counts.line
    flags = known * FLAG_KNOWN_X0 | FLAG_SPACED | FLAG_PLAIN | counts.role << ROLE_SHIFT | counts.tell << TELL_SHIFT
    if buf[start + 1] == ZERO:
        flags |= FLAG_RAPID
    if relative:
        flags |= FLAG_RELATIVE
    if e_relative:
        flags |= FLAG_E_RELATIVE
    if counts.arc_absolute != 0:
        flags |= FLAG_ARC_ABSOLUTE
    x1, y1, z1, e1 = x0, y0, z0, e0
    if words & WORD_X:
        x1 = x0 + x if relative else x + ox
    if words & WORD_Y:
        y1 = y0 + y if relative else y + oy
    if words & WORD_Z:
        z1 = z0 + z if relative else z + oz
    if not relative:
        named = words >> VALUE_X
        known = (known & ~named) | (named & sure)
    advance = 0.0
    if words & WORD_E:
        e1 = e0 + e if e_relative else e
        advance = (e1 - e0) * flow
        if area > 0:
            advance /= area
    if words & WORD_F:
        feed = f
    if advance > 0 and (x1 != x0 or y1 != y0 or z1 != z0):
        flags |= FLAG_EXTRUDING
    flags |= known * FLAG_KNOWN_X1

    numbers.pos[0], numbers.pos[1], numbers.pos[2] = x1, y1, z1
    numbers.e, numbers.feed = e1, feed
    counts.known, counts.modal = known, 0 if flags & FLAG_RAPID else 1
    r = records[n]
    r.begin, r.end, r.next, r.line = start, stop, p, line
    r.x0, r.y0, r.z0, r.x1, r.y1, r.z1 = x0, y0, z0, x1, y1, z1
    r.c0 = r.c1 = np.nan
    r.e0, r.e1, r.advance, r.feed, r.accel = e0, e1, advance, feed, numbers.accel
    r.ox, r.oy, r.oz = ox, oy, oz
    r.words, r.flags, r.layer, r.turns = words, flags, layer, 0
    r.kind, r.event, r.plane, r.axes = KIND_LINEAR, 0, plane, NO_SLOT
    return p
