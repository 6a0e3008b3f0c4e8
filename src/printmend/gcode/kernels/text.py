"""Bytes: characters, numbers read exactly as `float()` reads them, names as hashes, and the words of G-code.

Letters are int64 values, not literals: for literals numba would compile the functions that take them once for each.
"""

import numpy as np

from printmend.gcode.kernels.layout import *
from printmend.jit import inner

TAB, LF, CR, SPACE = 9, 10, 13, 32
QUOTE, HASH, PERCENT, OPEN, CLOSE, STAR, PLUS, MINUS, POINT, SLASH = 34, 35, 37, 40, 41, 42, 43, 45, 46, 47
ZERO, ONE, THREE, FOUR, FIVE, NINE = 48, 49, 51, 52, 53, 57
COLON, SEMICOLON, EQUALS, AT, BRACKET, BRACKET_END, UNDERSCORE, BRACE, BRACE_END = 58, 59, 61, 64, 91, 93, 95, 123, 125
LETTER_A, LETTER_B, LETTER_C, LETTER_E, LETTER_F = (np.int64(ord(letter)) for letter in "ABCEF")
LETTER_G, LETTER_I, LETTER_L, LETTER_M = (np.int64(ord(letter)) for letter in "GILM")
LETTER_N, LETTER_P, LETTER_R, LETTER_S, LETTER_T = (np.int64(ord(letter)) for letter in "NPRST")
LETTER_X, LETTER_Y, LETTER_Z = (np.int64(ord(letter)) for letter in "XYZ")
SMALL_A, SMALL_E, SMALL_Z = 97, 101, 122
TO_SMALL = SMALL_A - 65  # from a capital letter to the small one


SPACED, CAPITAL = 1, 2  # blanks between words; the word's letter is upper case
POWERS = np.array([10.0**k for k in range(23)])
_FNV_SEED, _FNV_PRIME = np.uint64(14695981039346656037), np.uint64(1099511628211)


def name_hash(name: str) -> np.uint64:
    """Return the hash that `word_hash` returns of a name."""
    value = int(_FNV_SEED)
    for byte in name.encode():
        value = ((value ^ byte) * int(_FNV_PRIME)) & 0xFFFFFFFFFFFFFFFF
    return np.uint64(value)


@inner
def upper(byte):
    """Return a letter's capital; any other character as it is."""
    return byte - TO_SMALL if SMALL_A <= byte <= SMALL_Z else byte


@inner
def is_letter(byte):
    """Say whether a character is a letter."""
    return LETTER_A <= byte <= LETTER_Z or SMALL_A <= byte <= SMALL_Z


@inner
def is_digit(byte):
    """Say whether a character is a digit."""
    return ZERO <= byte <= NINE


@inner
def digit_of(byte):
    """Return the value of a digit, signed: without the cast a uint8 would make unsigned sums."""
    return np.int64(byte) - ZERO


@inner
def is_blank(byte):
    """Say whether a character is passed over between words: the space and every control character, even NUL."""
    return byte <= SPACE


@inner
def parse_number(buf, p, stop, style):
    """Read a number at p: (value, next, found). Found is 0 for none, which leaves next at p, and 2 with an exponent.

    ``style`` (SPACED, CAPITAL) says how the line is written, which tells an exponent (`Y2.4e-15`, `X1.0E-4`) from an
    E word that follows without a blank (`X1E-4` in `G1X1E-4`). Without a minus it is none: firmwares read `X8e1` as X8.
    """
    start = p
    negative = False
    if p < stop and (buf[p] == PLUS or buf[p] == MINUS):
        negative = buf[p] == MINUS
        p += 1
    first = p
    whole = np.int64(0)
    while p < stop:
        digit = digit_of(buf[p])
        if digit < 0 or digit > 9:
            break
        whole = whole * 10 + digit
        p += 1
    digits, decimals = p - first, 0
    if p < stop and buf[p] == POINT:
        p += 1
        first = p
        while p < stop:
            digit = digit_of(buf[p])
            if digit < 0 or digit > 9:
                break
            whole = whole * 10 + digit
            p += 1
        decimals = p - first
        digits += decimals
    if digits == 0:
        return 0.0, start, 0
    if digits > 15 or (p < stop and (buf[p] == SMALL_E or buf[p] == LETTER_E)):
        return _parse_long(buf, start, stop, style)
    value = float(whole) / POWERS[decimals]  # both exact, so the quotient is correctly rounded
    return (-value if negative else value), p, 1


@inner
def _parse_long(buf, p, stop, style):
    """Read a number of any length, with an exponent if the line's style says that it is one."""
    negative = buf[p] == MINUS
    if buf[p] == PLUS or buf[p] == MINUS:
        p += 1
    whole = np.int64(0)
    significant, power, found = 0, 0, 1
    point = False
    while p < stop:
        byte = buf[p]
        if ZERO <= byte <= NINE:
            if significant < 18:
                whole = whole * 10 + digit_of(byte)
                significant += 1 if whole > 0 else 0
                power -= 1 if point else 0
            elif not point:
                power += 1
        elif byte == POINT and not point:
            point = True
        else:
            break
        p += 1
    if p + 1 < stop and (buf[p] == SMALL_E or buf[p] == LETTER_E):
        signed = buf[p + 1] == MINUS
        q = p + 2 if signed else p + 1
        first, exponent = q, 0
        while q < stop and is_digit(buf[q]) and q < first + 4:
            exponent = exponent * 10 + digit_of(buf[q])
            q += 1
        closed = q == stop or is_blank(buf[q]) or buf[q] == SEMICOLON or buf[q] == STAR or buf[q] == OPEN
        if q > first and closed and signed and ((buf[p] == SMALL_E and style & CAPITAL) or style & SPACED):
            power -= exponent
            p, found = q, 2
    if power >= 0:
        value = float(whole) * (POWERS[power] if power <= 22 else 10.0 ** float(min(power, 300)))
    elif power >= -22:
        value = _divide(whole, POWERS[-power])
    else:
        value = float(whole) / 10.0 ** float(min(-power, 300))
    if not value < 1e15:  # no machine is that large: keep the arithmetic finite
        value = 1e15
    return (-value if negative else value), p, found


@inner
def _divide(whole, power):
    """Round whole/power to the nearest double, for an integer below 10^18 and an exact power of ten.

    high + low = whole exactly; the remainder high − quotient·power is exact by Dekker's product, so the second
    quotient corrects the first to beyond 100 bits before the last rounding.
    """
    high = float(whole)
    low = float(whole - np.int64(high))
    quotient = high / power
    a = 134217729.0 * quotient
    a_high = a - (a - quotient)
    a_low = quotient - a_high
    b = 134217729.0 * power
    b_high = b - (b - power)
    b_low = power - b_high
    product = quotient * power
    error = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return quotient + ((high - product) - error + low) / power


@inner
def word_hash(buf, p, stop):
    """Return the hash of the name at p, in capitals, and where it ends."""
    value = _FNV_SEED
    while p < stop and (is_letter(buf[p]) or is_digit(buf[p]) or buf[p] == UNDERSCORE):
        value = (value ^ np.uint64(upper(buf[p]))) * _FNV_PRIME
        p += 1
    return value, p


@inner
def among(value, table):
    """Say whether a value stands in a table."""
    for k in range(len(table)):  # noqa: SIM110 (numba compiles the loop, not the generator)
        if table[k] == value:
            return True
    return False


@inner
def starts_with(buf, p, stop, text):
    """Say whether buf[p:stop] begins with a text, which is in capitals, in either case."""
    if stop - p < len(text):
        return False
    for k in range(len(text)):  # noqa: SIM110 (numba compiles the loop, not the generator)
        if upper(buf[p + k]) != text[k]:
            return False
    return True


# Words of G-code: from millimetres and shares of E to letters and fixed-point numbers, and back to where they lead.

# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)


# As int64 values, not literals, or numba would compile the functions that take them once for each.
FIRST, SECOND = np.int64(0), np.int64(1)  # coordinate of an arc's plane
DECIMALS_3, DECIMALS_5, DECIMALS_7, DECIMALS_9 = np.int64(3), np.int64(5), np.int64(7), np.int64(9)


@inner
def put_fixed(out, at, scaled, decimals):
    """Write scaled/10^decimals without an exponent and without trailing zeros."""
    if scaled < 0:
        out[at] = MINUS
        at += 1
    rest = np.uint64(abs(scaled))  # unsigned: division by the constant 10 becomes a multiplication
    ten = np.uint64(10)
    while decimals > 0 and rest % ten == 0:
        rest //= ten
        decimals -= 1
    size, above = 1, ten
    while above <= rest:
        above *= ten
        size += 1
    size = max(size, decimals + 1)
    end = at + size + (decimals > 0)
    k = end
    if decimals > 0:
        for _ in range(decimals):
            k -= 1
            out[k] = np.uint8(ZERO) + np.uint8(rest % ten)
            rest //= ten
        k -= 1
        out[k] = POINT
    while k > at:
        k -= 1
        out[k] = np.uint8(ZERO) + np.uint8(rest % ten)
        rest //= ten
    return end


@inner
def copy_bytes(buf, begin, end, out, at):
    """Copy buf[begin:end] to ``out`` from ``at`` on; return where it ends."""
    for k in range(begin, end):
        out[at] = buf[k]
        at += 1
    return at


@inner
def to_fixed(value, decimals):
    """Round to an integer number of 10^−decimals, kept within what no machine exceeds."""
    return np.int64(np.floor(min(max(value * POWERS[decimals], -9e14), 9e14) + 0.5))


@inner
def cased(byte, r):
    """Return a capital letter as the statement writes its letters."""
    return byte + TO_SMALL if r.flags & FLAG_LOWER else byte


@inner
def put_word(out, at, r, byte, scaled, decimals):
    """Write a word: its letter, ``byte``, and the number scaled/10^decimals."""
    if r.flags & FLAG_SPACED:
        out[at] = SPACE
        at += 1
    out[at] = cased(byte, r)
    return put_fixed(out, at + 1, scaled, decimals)


@inner
def decimals(r):
    """Return the decimals of X Y Z in the file's unit, which round by 0.5 µm at most (0.13 µm in inches)."""
    return 5 if r.flags & FLAG_INCH else 3


@inner
def axis_value(piece, axis):
    """Return where a piece ends along an axis [machine mm]."""
    return piece.x if axis == 0 else (piece.y if axis == 1 else piece.z)


@inner
def axis_end(r, axis):
    """Return where a statement ends along an axis [machine mm]."""
    return r.x1 if axis == 0 else (r.y1 if axis == 1 else r.z1)


@inner
def scaled_axis(r, writer, target, axis):
    """Return the number to write for an axis, as an integer, so that the machine goes to ``target`` [mm]."""
    unit = 25.4 if r.flags & FLAG_INCH else 1.0
    if r.flags & FLAG_G53:
        return to_fixed(target / unit, decimals(r))
    if r.flags & FLAG_RELATIVE:
        return to_fixed((target - writer.place[axis]) / unit, decimals(r))
    offset = r.ox if axis == 0 else (r.oy if axis == 1 else r.oz)
    return to_fixed((target - offset - writer.shift[axis]) / unit, decimals(r))


@inner
def reached(r, writer, scaled, axis):
    """Return where the machine goes [mm] when it reads the number ``scaled``."""
    unit = 25.4 if r.flags & FLAG_INCH else 1.0
    value = scaled * unit / POWERS[decimals(r)]
    if r.flags & FLAG_G53:
        return value
    if r.flags & FLAG_RELATIVE:
        return writer.place[axis] + value
    offset = r.ox if axis == 0 else (r.oy if axis == 1 else r.oz)
    return value + offset + writer.shift[axis]


@inner
def wants_axis(r, writer, target, scaled, axis):
    """Say whether a generated line must name this axis."""
    if r.flags & FLAG_RELATIVE and not r.flags & FLAG_G53:
        return scaled != 0
    half = 0.000127 if r.flags & FLAG_INCH else 0.0005
    return not abs(target - writer.place[axis]) <= half  # true for NaN


@inner
def keeps_place(r, writer, target, axis):
    """Say whether the statement's own word takes the axis to the target, as far as the writer's place is exact."""
    start = r.x0 if axis == 0 else (r.y0 if axis == 1 else r.z0)
    if target != axis_end(r, axis):
        return False
    if r.flags & FLAG_RELATIVE and not r.flags & FLAG_G53:
        return abs(writer.place[axis] - start) < 1e-9
    return writer.shift[axis] == 0.0 or (r.flags & FLAG_G53) != 0


@inner
def centre_axis(r, second):
    """Return the axis, 0 to 2, of the first or second coordinate of an arc's plane."""
    if r.plane == 0:
        return 1 if second else 0
    if r.plane == 1:
        return 0 if second else 2
    return 2 if second else 1


@inner
def scaled_centre(r, piece, writer, second):
    """Return I, J or K of an arc piece: its centre from where the machine is at its start, or absolute after G90.1."""
    axis = centre_axis(r, second)
    from_mm = writer.place[axis]
    if r.flags & FLAG_ARC_ABSOLUTE:
        from_mm = (r.ox if axis == 0 else (r.oy if axis == 1 else r.oz)) + writer.shift[axis]
    centre = piece.c1 if second else piece.c0
    return to_fixed((centre - from_mm) / (25.4 if r.flags & FLAG_INCH else 1.0), decimals(r) + 1)


@inner
def keeps_centre(r, piece, writer):
    """Say whether the statement's own I J K or R hold for this arc piece."""
    same = piece.c0 == r.c0 and piece.c1 == r.c1 and piece.x == r.x1 and piece.y == r.y1 and piece.z == r.z1
    near = abs(writer.place[0] - r.x0) < 1e-9 and abs(writer.place[1] - r.y0) < 1e-9
    return same and near and abs(writer.place[2] - r.z0) < 1e-9


@inner
def put_feed(out, at, r, feed, writer):
    """Write F [mm/min] if the machine's own is another."""
    if feed > 0 and feed != writer.feed:
        scaled, decimals = scaled_feed(r, feed)
        at = put_word(out, at, r, LETTER_F, scaled, decimals)
        writer.feed = feed
    return at


@inner
def scaled_feed(r, feed):
    """Return F in the file's unit as a fixed-point number, and its decimals: more than three if it would be 0."""
    value = feed / (25.4 if r.flags & FLAG_INCH else 1.0)
    decimals = DECIMALS_3 if value >= 1.0 else DECIMALS_9
    return to_fixed(value, decimals), decimals


@inner
def e_letter(r):
    """Return the letter of the extruder's word."""
    return LETTER_A if r.flags & FLAG_E_IS_A else LETTER_E


@inner
def letter_of(byte, r):
    """Return the capital letter that a word counts as: where A drives the extruder, A counts as E and E as A."""
    letter = np.int64(upper(byte))
    if r.flags & FLAG_E_IS_A and letter in (LETTER_A, LETTER_E):
        return LETTER_A + LETTER_E - letter
    return letter


@inner
def e_decimals(r):
    """Return the decimals of E in the file's unit, for steps of 10 nm of filament, in inches of 2.5 nm."""
    return DECIMALS_7 if r.flags & FLAG_INCH else DECIMALS_5


@inner
def e_scaled(r, cumulated):
    """Return E after this part of the statement as a fixed-point number, absolute or since its start."""
    unit = 25.4 if r.flags & FLAG_INCH else 1.0
    gain = r.e1 - r.e0
    value = cumulated * gain if r.flags & FLAG_E_RELATIVE else r.e0 + cumulated * gain
    return to_fixed(value / unit, e_decimals(r))


@inner
def e_rest(r, before, writer):
    """Return the last part of a relative E and carry on what rounding took, so that the sum over all lines is exact."""
    exact = (r.e1 - r.e0) / (25.4 if r.flags & FLAG_INCH else 1.0) * POWERS[e_decimals(r)] + writer.e_debt
    total = np.int64(np.floor(min(max(exact, -9e14), 9e14) + 0.5))
    writer.e_debt = exact - total
    return total - e_scaled(r, before)


@inner
def own_motion(r):
    """Return the G number of the statement."""
    if r.flags & FLAG_CURVE:
        return 5
    return 0 if r.flags & FLAG_RAPID else (1 if r.kind == KIND_LINEAR else (2 if r.kind == KIND_CW else 3))


@inner
def piece_motion(r, piece):
    """Return the G number of a piece."""
    if piece.kind == PIECE_ARC:
        return 2 if r.kind == KIND_CW else 3
    return 0 if r.flags & FLAG_RAPID and piece.kind == PIECE_LINE else 1


@inner
def put_command(buf, r, motion, out, at):
    """Write G0–G3 in the statement's own way (`G01`, `g1`)."""
    own = own_motion(r)
    p = r.begin
    if motion == own and not r.flags & FLAG_MODAL and upper(buf[p]) == LETTER_G and not is_blank(buf[p + 1]):
        out[at] = buf[p]
        at, p = at + 1, p + 1
        while p < r.end and (is_digit(buf[p]) or buf[p] == POINT):
            out[at] = buf[p]
            at, p = at + 1, p + 1
            if p - r.begin > 8:
                break
        return at
    out[at], out[at + 1] = cased(LETTER_G, r), ZERO + motion
    return at + 2
