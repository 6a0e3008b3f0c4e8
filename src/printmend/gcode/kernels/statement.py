# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)
"""One statement of a line, read but not yet obeyed: its command, which of its words have a value, what is odd about it.

Letters are read one after the other; `Y-2.4e-5`, `X 10`, `X[next]`, `(remark)` and `T?` all occur in real files.
"""

import numpy as np

from printmend.gcode.kernels.commands import set_mode
from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.text import *
from printmend.jit import inner

EXTENDED, FILLED_IN = 1, 2  # stand in for a command's letter: SET_PIN, and {…} that someone else fills in
ASKED = -20  # the code of `T?` and `Tx`, with which the printer asks
LAST_MOVE = 30  # G0 to G3 are moves: their codes, in tenths, go up to this

# M commands in tenths whose argument is free text, or a share that is printed: no firmware moves for it.
_M_TEXT = np.array([730, 1170, 1180, 230, 280, 300, 320, 360, 980, 5500, 5870, 4700, 9280, 8620, 8623, 8626, 10020])

STATEMENT = np.dtype(
    [
        ("start", "i8"),  # its first byte, after any N word and modes that stand before it
        ("letter", "i8"),  # its command's letter, 0 for none, EXTENDED or FILLED_IN
        ("lead", "i8"),  # the letter of its first word where it has no command, 0 before that
        ("code", "i8"),  # its command's number in tenths: 921 is G92.1
        ("words", "i8"),  # bits of its words, as in a RECORD: those with a value,
        ("bare", "i8"),  # those without,
        ("unclear", "i8"),  # those whose value someone else fills in,
        ("twice", "i8"),  # and those that come twice
        ("flags", "i8"),  # FLAG_* of its line so far
        ("spaced", "i8"),  # 1 where blanks were seen in its line
        ("garbled", "i8"),  # 1 where firmwares may read it in different ways
        ("over", "i8"),  # 1 where reading stopped before the line's end
        ("again", "i8"),  # 1 where another statement of the same line follows
    ]
)


@inner
def read_statement(buf, p, stop, s, values, numbers, counts):
    """Read the statement at p of a line that ends at ``stop`` into s, its words' values into ``values`` [26].

    Returns where reading stopped. Commands that set a mode (G90, G53) are obeyed here, because they may stand before
    another on a line; ``flags`` and ``spaced`` of s are the line's and are kept.
    """
    s.start, s.letter, s.code, s.lead = p, 0, 0, 0
    s.words = s.bare = s.unclear = s.twice = 0
    s.garbled = s.over = s.again = 0
    if p + 1 < stop and _is_of_name(buf[p]) and _is_of_name(buf[p + 1]):
        s.letter = EXTENDED
        return stop
    while p < stop and s.over == 0:
        byte = upper(buf[p])
        if byte <= SPACE:
            s.spaced = 1
            p += 1
        elif byte in (OPEN, QUOTE):
            p = _after_remark(buf, p, stop)
        elif not LETTER_A <= byte <= LETTER_Z:
            _sign(s, counts, byte)
        else:
            p = _letter(buf, p, stop, s, values, numbers, counts, byte)
    return p


@inner
def _is_of_name(byte):
    """Say whether a character may stand in a long command's name."""
    return is_letter(byte) or byte == UNDERSCORE


@inner
def _after_remark(buf, p, stop):
    """Return where a remark in brackets or a text in quotes that begins at p is over."""
    closing = CLOSE if buf[p] == OPEN else QUOTE
    p += 1
    while p < stop and buf[p] != closing:
        p += 1
    return p + 1


@inner
def _sign(s, counts, byte):
    """End a statement at a character that is no letter: a checksum, a comment, a placeholder, or an unknown one."""
    s.over = 1
    if byte == STAR:
        s.flags |= FLAG_CHECKSUM
        counts.checksums += 1
    elif _is_filled_in(byte) and s.letter != LETTER_M:
        s.unclear |= WORDS_XYZ
        if s.letter == 0:
            s.letter = FILLED_IN
    elif byte != SEMICOLON:
        s.garbled = 1


@inner
def _is_filled_in(byte):
    """Say whether a character begins a placeholder, which someone else fills in."""
    return byte in (BRACE, BRACKET, HASH)


@inner
def _letter(buf, p, stop, s, values, numbers, counts, byte):
    """Read a letter at p, ``byte`` in upper case, with what follows it; return where that ends."""
    style = (SPACED if s.spaced else 0) | (CAPITAL if buf[p] < SMALL_A else 0)
    value, q, found = parse_number(buf, p + 1, stop, style)
    if byte in (LETTER_G, LETTER_M) or (byte == LETTER_T and s.letter == 0):
        if found and 0 <= value < 100000:
            if _command(s, numbers, counts, byte, int(value * 10.0 + 0.5), p, q, buf[p] >= SMALL_A):
                return q
            return p
        if byte == LETTER_T and s.letter == 0:
            s.letter, s.code, s.start, s.over = LETTER_T, ASKED, p, 1
            return p
    if counts.e_is_a and byte in (LETTER_A, LETTER_E):
        byte = LETTER_A + LETTER_E - byte
    if s.letter == 0 and s.lead == 0:
        s.lead = byte
    bit = 1 << (byte - LETTER_A)
    s.twice |= s.words & bit
    if not found:
        return _word_without_number(buf, p, q, stop, s, values, bit, byte, style)
    values[byte - LETTER_A] = value
    s.words |= bit
    if found == 2:
        s.flags |= FLAG_EXPONENT
    elif q < stop and buf[q] == SMALL_E and buf[p] < SMALL_A:  # `X8e1`: 8, and what becomes of the rest is open
        s.garbled = 1
    return q


@inner
def _command(s, numbers, counts, byte, tenths, p, q, small):
    """Take the command between p and q; return False where it ends the statement, because it begins another one."""
    if s.letter != 0 or (s.words != 0 and (byte != LETTER_G or tenths > LAST_MOVE)):
        s.again = s.over = 1
        return False
    if small:
        s.flags |= FLAG_LOWER
    if byte == LETTER_G and (tenths == 530 or set_mode(numbers, counts, tenths)):
        s.flags |= FLAG_MIXED
        if tenths == 530:
            s.flags |= FLAG_G53
        if s.words == 0:
            s.start = q
        return True
    if s.words == 0:
        s.start = p
    s.letter, s.code = byte, tenths
    if byte == LETTER_M and among(tenths, _M_TEXT):
        s.over = 1
        return False
    return True


@inner
def _word_without_number(buf, p, q, stop, s, values, bit, byte, style):
    """Take the letter at p, which is not followed by a number but by what stands at q. Return where it ends."""
    while q < stop and is_blank(buf[q]):
        q += 1
    if q < stop and (is_digit(buf[q]) or buf[q] == PLUS or buf[q] == MINUS or buf[q] == POINT):  # `X 10`
        value, after, found = parse_number(buf, q, stop, style)
        if not found:
            s.over = 1
            return q - 1
        values[byte - LETTER_A] = value
        s.words |= bit
        return after
    if q < stop and _is_filled_in(buf[q]):
        s.unclear |= bit
        closing = BRACE_END if buf[q] == BRACE else BRACKET_END
        while q < stop and buf[q] != closing and buf[q] != SEMICOLON:
            q += 1
        return q + 1 if q < stop and buf[q] == closing else q
    if s.letter == 0 and (q >= stop or not is_letter(buf[q])):  # a letter that begins nothing
        s.over = 1
        return p
    s.bare |= bit
    if bit & WORDS_MOVING and s.letter == LETTER_G and s.code <= LAST_MOVE:  # `G1 Xnan`
        s.garbled = 1
    return q
