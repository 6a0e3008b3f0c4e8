"""Line numbers and checksums: the last pass over a file that has them, once lines were added."""

import numpy as np

from printmend.gcode.kernels.text import (
    CR,
    LETTER_G,
    LETTER_M,
    LETTER_N,
    LF,
    ONE,
    PLUS,
    SEMICOLON,
    STAR,
    ZERO,
    digit_of,
    is_blank,
    is_digit,
    upper,
)
from printmend.jit import entry, inner

_NUMBERS = 10**12  # of lines: a longer one is cut to its last digits
_ROOM_BYTES = 32  # what one line can gain: a number of 20 digits and a checksum of 4 bytes


@inner
def _restart(buf, p, stop):
    """Return the number that the numbering goes on from after an M110 on this line: its N word's, −1 without one.

    −2 where there is no M110.
    """
    while p < stop and buf[p] != SEMICOLON:
        if (
            upper(buf[p]) == LETTER_M
            and p + 3 < stop
            and buf[p + 1] == ONE
            and buf[p + 2] == ONE
            and buf[p + 3] == ZERO
        ):
            p += 4
            while p < stop and buf[p] != SEMICOLON and buf[p] != STAR:
                if upper(buf[p]) == LETTER_N and p + 1 < stop and is_digit(buf[p + 1]):
                    return _integer(buf, p + 1, stop)[0]
                p += 1
            return np.int64(-1)
        p += 1
    return np.int64(-2)


@inner
def _integer(buf, p, stop):
    """Read digits at p: (their value, where they end)."""
    number = np.int64(0)
    while p < stop and is_digit(buf[p]):
        number = (number * 10 + digit_of(buf[p])) % _NUMBERS
        p += 1
    return number, p


# Long because a line's number and its checksum are read, changed and written in one pass, on what the line before left.
@entry
def renumber(buf, begin, end, lines, out):
    """Finish the intermediate text of `emit`; return (read, written).

    ``lines`` int64 [2]: lines added since the last M110, and the last number written. `N+` becomes the next number,
    other N words are raised by the lines added; where a number or `*+` changed a line, its checksum, the exclusive-or
    of the bytes before the star, is computed again. It stops before a line that may not fit into ``out``.
    """
    p, at = begin, begin * 0
    while p < end:
        stop = p
        while stop < end and buf[stop] != LF and buf[stop] != CR:
            stop += 1
        if at + (stop - p) + _ROOM_BYTES > len(out):
            break

        while p < stop and is_blank(buf[p]):
            out[at] = buf[p]
            at, p = at + 1, p + 1
        first = at
        changed = False
        restart = np.int64(-2)
        if p + 1 < stop and upper(buf[p]) == LETTER_N and (buf[p + 1] == PLUS or is_digit(buf[p + 1])):
            out[at] = buf[p]
            at, p = at + 1, p + 1
            number = 0
            if buf[p] == PLUS:
                lines[0] += 1
                number = lines[1] + 1
                changed = True
                p += 1
            else:
                number, q = _integer(buf, p, stop)
                restart = _restart(buf, q, stop)
                if restart > -2:
                    lines[0] = 0
                changed = lines[0] != 0
                number += lines[0]
                if not changed:
                    while p < q:
                        out[at] = buf[p]
                        at, p = at + 1, p + 1
                p = q
            if changed:
                at = _put_integer(out, at, number)
            lines[1] = number
        elif p < stop and (upper(buf[p]) == LETTER_M or upper(buf[p]) == LETTER_G):
            restart = _restart(buf, p, stop)
            if restart > -2:
                lines[0] = 0
        if restart >= 0:
            lines[1] = restart
        star = stop
        q = p
        while q < stop and buf[q] != SEMICOLON:
            if buf[q] == STAR:
                star = q
            q += 1
        asked = star + 1 < stop and buf[star + 1] == PLUS
        asked = asked and (star + 2 == stop or is_blank(buf[star + 2]) or buf[star + 2] == SEMICOLON)
        digits = star + 1
        while digits < stop and is_digit(buf[digits]):
            digits += 1
        if asked:
            digits = star + 2
        if star < stop and (asked or (changed and digits > star + 1)):
            while p < star:
                out[at] = buf[p]
                at, p = at + 1, p + 1
            total = 0
            for k in range(first, at):
                total ^= np.int64(out[k])
            out[at] = STAR
            at = _put_integer(out, at + 1, total)
            p = digits
        while p < stop:
            out[at] = buf[p]
            at, p = at + 1, p + 1
        if p < end:
            out[at] = buf[p]
            at, p = at + 1, p + 1
    return p, at


@inner
def _put_integer(out, at, value):
    """Write an integer that is not negative; return where it ends."""
    size, rest = 1, value
    while rest >= 10:
        rest //= 10
        size += 1
    for k in range(size):
        out[at + size - 1 - k] = ZERO + value % 10
        value //= 10
    return at + size
