"""Bytes: characters and their codes, numbers read exactly as `float()` reads them, names as hashes.

Letters are int64 values, not literals: for literals numba would compile the functions that take them once for each.
"""

import numpy as np

from printmend.jit import inner

LF, CR, SPACE = 10, 13, 32
QUOTE, HASH, OPEN, CLOSE, STAR, PLUS, MINUS, POINT = 34, 35, 40, 41, 42, 43, 45, 46
ZERO, ONE, THREE, FOUR, FIVE, NINE = 48, 49, 51, 52, 53, 57
COLON, SEMICOLON, EQUALS, BRACKET, BRACKET_END, UNDERSCORE, BRACE, BRACE_END = 58, 59, 61, 91, 93, 95, 123, 125
LETTER_A, LETTER_B, LETTER_C, LETTER_E, LETTER_F = (np.int64(ord(letter)) for letter in "ABCEF")
LETTER_G, LETTER_I, LETTER_L, LETTER_M = (np.int64(ord(letter)) for letter in "GILM")
LETTER_N, LETTER_P, LETTER_S, LETTER_T = (np.int64(ord(letter)) for letter in "NPST")
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
    E word that follows without a blank (`X1E-4` in `G1X1E-4`). Without a sign it is none: firmwares read `X8e1` as X8.
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
        signed = buf[p + 1] == PLUS or buf[p + 1] == MINUS
        q = p + 2 if signed else p + 1
        first, exponent = q, 0
        while q < stop and is_digit(buf[q]) and q < first + 4:
            exponent = exponent * 10 + digit_of(buf[q])
            q += 1
        closed = q == stop or is_blank(buf[q]) or buf[q] == SEMICOLON or buf[q] == STAR or buf[q] == OPEN
        if q > first and closed and signed and ((buf[p] == SMALL_E and style & CAPITAL) or style & SPACED):
            power += -exponent if buf[p + 1] == MINUS else exponent
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
