# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)
"""The interpreter: lines of text in, records of what they mean out."""

import numpy as np

from printmend.gcode.kernels.commands import (
    ALL_LOST,
    add_offsets,
    begin_record,
    event,
    finish_record,
    g_command,
    m_command,
    move,
    set_mode,
    tool_change,
)
from printmend.gcode.kernels.klipper import long_command
from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.plain import plain_move
from printmend.gcode.kernels.text import (
    CAPITAL,
    CLOSE,
    CR,
    LF,
    OPEN,
    QUOTE,
    SEMICOLON,
    SPACE,
    SPACED,
    STAR,
    among,
    is_blank,
    is_digit,
    is_letter,
    parse_number,
    starts_with,
    upper,
)
from printmend.jit import entry, inner

_EXTENDED, _FILLED_IN = 1, 2  # stand in for a command letter
_LAYER_CHANGE = np.frombuffer(b"LAYER_CHANGE", np.uint8)
_CHANGE_LAYER = np.frombuffer(b"CHANGE_LAYER", np.uint8)
_LAYER = np.frombuffer(b"LAYER", np.uint8)
_LAYER_OBJECT = np.frombuffer(b"BEGIN_LAYER_OBJECT", np.uint8)


@inner
def _comment(buf, p, stop, counts):
    """Count layer comments: `;LAYER_CHANGE`, `;LAYER:3`, `; CHANGE_LAYER`, `; layer 3, Z = …`, KISSlicer's."""
    while p < stop and is_blank(buf[p]):
        p += 1
    if p >= stop:
        return
    first = upper(buf[p])
    if first == 76 and starts_with(buf, p, stop, _LAYER):
        q = p + 5
        if starts_with(buf, p, stop, _LAYER_CHANGE):
            counts[C_LAYER] += q + 7 == stop or is_blank(buf[min(q + 7, stop - 1)])
        elif q + 1 < stop and (buf[q] == 58 or buf[q] == SPACE) and (is_digit(buf[q + 1]) or buf[q + 1] == 45):
            counts[C_LAYER] += 1
    elif (first == 67 and starts_with(buf, p, stop, _CHANGE_LAYER)) or (
        first == 66 and starts_with(buf, p, stop, _LAYER_OBJECT)
    ):
        counts[C_LAYER] += 1


# M commands in tenths whose argument is free text.
_M_TEXT = np.array([1170, 1180, 230, 280, 300, 320, 360, 980, 5500, 5870, 4700, 9280, 8620, 8623, 8626, 10020])


@inner
def _line(buf, p, stop, after, values, numbers, counts, records, n):
    """Obey one line, buf[p:stop]; return the next free record."""
    while p < stop and is_blank(buf[p]):
        p += 1
    if p + 2 < stop and buf[p] == 0xEF and buf[p + 1] == 0xBB and buf[p + 2] == 0xBF:
        p += 3
    if p >= stop:
        return n
    if buf[p] == SEMICOLON:
        _comment(buf, p + 1, stop, counts)
        return n
    flags = 0
    if upper(buf[p]) == 78 and p + 1 < stop and is_digit(buf[p + 1]):
        p += 1
        while p < stop and is_digit(buf[p]):
            p += 1
        while p < stop and is_blank(buf[p]):
            p += 1
        flags |= FLAG_NUMBERED
        counts[C_NUMBERED] += 1
    spaced = False
    while p < stop:  # one statement a turn
        start, letter, code = p, 0, 0
        words, bare, unclear = 0, 0, 0
        twice, garbled = 0, False
        long = p + 1 < stop and (is_letter(buf[p]) or buf[p] == 95) and (is_letter(buf[p + 1]) or buf[p + 1] == 95)
        if long:
            letter, q = _EXTENDED, p
            p = stop
        again = False
        while p < stop:
            byte = upper(buf[p])
            if byte <= SPACE:
                spaced = True
                p += 1
                continue
            if not 65 <= byte <= 90:
                if byte in (OPEN, QUOTE):
                    closing = CLOSE if byte == OPEN else QUOTE
                    p += 1
                    while p < stop and buf[p] != closing:
                        p += 1
                    p += 1
                    continue
                if byte == STAR:
                    flags |= FLAG_CHECKSUM
                    counts[C_CHECKSUMS] += 1
                elif (byte == 123 or byte == 91 or byte == 35) and letter != 77:  # { [ #: filled in by someone else
                    unclear |= WORDS_XYZ
                    if letter == 0:
                        letter = _FILLED_IN
                elif byte != SEMICOLON:
                    garbled = True
                break
            style = (SPACED if spaced else 0) | (CAPITAL if buf[p] < 97 else 0)
            value, q, found = parse_number(buf, p + 1, stop, style)
            if byte == 71 or byte == 77 or (byte == 84 and letter == 0):
                if found and 0 <= value < 100000:
                    tenths = int(value * 10.0 + 0.5)
                    if letter != 0 or (words != 0 and (byte != 71 or tenths > 30)):
                        again = True  # this one begins the next statement
                        break
                    if buf[p] >= 97:
                        flags |= FLAG_LOWER
                    if byte == 71 and (tenths == 530 or set_mode(numbers, counts, tenths)):
                        flags |= FLAG_MIXED
                        if tenths == 530:
                            flags |= FLAG_G53
                        if words == 0:
                            start = q
                    else:
                        if words == 0:
                            start = p
                        letter, code = byte, tenths
                        if byte == 77 and among(tenths, _M_TEXT):
                            break
                    p = q
                    continue
                if byte == 84 and letter == 0:  # `T?`, `Tx`: the printer asks
                    letter, code, start = 84, -20, p
                    break
            bit = 1 << (byte - 65)
            twice |= words & bit
            if found:
                values[byte - 65] = value
                words |= bit
                if found == 2:
                    flags |= FLAG_EXPONENT
                elif q < stop and buf[q] == 101 and buf[p] < 97:  # `X8e1`: 8, and what becomes of the rest is open
                    garbled = True
            else:
                while q < stop and is_blank(buf[q]):
                    q += 1
                if q < stop and (is_digit(buf[q]) or buf[q] == 43 or buf[q] == 45 or buf[q] == 46):
                    p = q - 1  # `X 10`: read the number where it is
                    value, q, found = parse_number(buf, q, stop, style)
                    if not found:
                        break
                    values[byte - 65] = value
                    words |= bit
                elif q < stop and (buf[q] == 123 or buf[q] == 91 or buf[q] == 35):
                    unclear |= bit
                    closing = 125 if buf[q] == 123 else 93
                    while q < stop and buf[q] != closing and buf[q] != SEMICOLON:
                        q += 1
                    q += q < stop and buf[q] == closing
                elif letter == 0 and (q >= stop or not is_letter(buf[q])):
                    break  # a letter that begins nothing
                else:
                    bare |= bit
                    garbled |= bit & WORDS_MOVING != 0 and letter == 71 and code <= 30  # `G1 Xnan`
            p = q
        if spaced:
            flags |= FLAG_SPACED
        r = records[n]
        begin_record(r, start, p if again else stop, p if again else after, numbers, counts, flags)
        r.words = words
        if twice:
            r.flags = r.flags | FLAG_TWICE
        if garbled or words & bare or twice & (WORDS_IJK | WORD_R):  # nobody knows what a firmware makes of that
            r.flags = r.flags | FLAG_OPAQUE
        what = 0
        if (letter == 71 and code <= 30) or letter == 0:
            if letter == 71:
                counts[C_MODAL] = code // 10
            else:
                r.flags = r.flags | FLAG_MODAL
            if counts[C_MODAL] >= 0 and (letter == 71 or (words | unclear) & (WORDS_XYZ | WORD_E | WORD_F)):
                move(r, numbers, counts, words, unclear, values, counts[C_MODAL])
        elif letter == 71:
            what = g_command(r, numbers, counts, words, bare, unclear, values, code)
        elif letter == 77:
            what = m_command(r, numbers, counts, words, bare, values, code)
        elif letter == 84:
            if code // 10 != counts[C_TOOL]:
                what = tool_change(numbers, counts, code // 10)
        elif letter == _EXTENDED:
            what = long_command(r, buf, start, stop, numbers, counts)
        else:
            what = EVENT_PLACEHOLDER + ALL_LOST
            r.flags = r.flags | FLAG_OPAQUE
        if what != 0:
            event(r, counts, what)
        if letter != 71 or code > 30:
            add_offsets(numbers, counts)
        if p - start > MAX_CODE_BYTES:
            r.flags = r.flags | FLAG_OPAQUE
        if r.kind != 0:
            finish_record(r, numbers, counts)
            n += 1
        if not again:
            break
        flags = flags & FLAG_NUMBERED | FLAG_MIXED
    return n


@entry
def interpret(buf, begin, end, numbers, counts, records):
    """Interpret the whole lines buf[begin:end]; return (records filled, where it stopped).

    ``buf`` uint8, ``numbers`` float64 [NUMBERS] and ``counts`` int64 [COUNTS] are the machine's state and are
    advanced; ``records`` is an array of RECORD. It stops before a line whose statements may not fit in ``records``
    (a line of L bytes needs at most L/2 + 2): call again with the rest.
    """
    values = np.zeros(26)
    n = np.int64(0)
    capacity = len(records)
    p = begin
    while p < end:
        if n < capacity:
            after = plain_move(buf, p, end, numbers, counts, records, n)
            if after >= 0:
                n += 1
                counts[C_LINE] += 1
                p = after
                continue
        stop = p
        while stop < end and buf[stop] != LF and buf[stop] != CR:
            stop += 1
        after = stop
        while after < end and buf[after] == CR:
            after += 1
        if after < end and buf[after] == LF:
            after += 1
        elif after > stop:  # a lone carriage return ends a line too
            after = stop + 1
        if n + (stop - p) // 2 + 2 > capacity:
            code = p  # a comment holds no statements
            while code < stop and buf[code] != SEMICOLON:
                code += 1
            if n + (code - p) // 2 + 2 > capacity:
                break
        n = _line(buf, p, stop, after, values, numbers, counts, records, n)
        counts[C_LINE] += 1
        p = after
    return n, p
