# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)
"""Words of G-code: from millimetres and shares of E to letters and fixed-point numbers, and back to where they lead."""

import numpy as np

from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.text import POWERS, is_digit, upper
from printmend.jit import inner

# As int64 values, not literals, or numba would compile the functions that take them once for each.
FIRST, SECOND = np.int64(0), np.int64(1)
THREE, FIVE, SEVEN, NINE = np.int64(3), np.int64(5), np.int64(7), np.int64(9)
LETTER_E, LETTER_F, LETTER_G = np.int64(69), np.int64(70), np.int64(71)


@inner
def put_fixed(out, at, scaled, decimals):
    """Write scaled/10^decimals without an exponent and without trailing zeros."""
    if scaled < 0:
        out[at] = 45
        at += 1
    rest = np.uint64(abs(scaled))  # unsigned: division by the constant 10 becomes a multiplication
    ten = np.uint64(10)
    while decimals > 0 and rest % ten == 0:
        rest //= ten
        decimals -= 1
    size, probe = 1, rest
    while probe >= ten:
        probe //= ten
        size += 1
    size = max(size, decimals + 1)
    point = at + size - decimals
    end = at + size + (decimals > 0)
    for k in range(end - 1, at - 1, -1):
        if k == point and decimals > 0:
            out[k] = 46
        else:
            out[k] = np.uint8(48) + np.uint8(rest % ten)
            rest //= ten
    return end


@inner
def copy_bytes(buf, begin, end, out, at):
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
    return byte + 32 if r.flags & FLAG_LOWER else byte


@inner
def put_word(out, at, r, byte, scaled, decimals):
    if r.flags & FLAG_SPACED:
        out[at] = 32
        at += 1
    out[at] = cased(byte, r)
    return put_fixed(out, at + 1, scaled, decimals)


@inner
def decimals(r):
    """Decimals of X Y Z in the file's unit: a rounding error of 0.5 µm at the most (0.13 µm in inches)."""
    return 5 if r.flags & FLAG_INCH else 3


@inner
def axis_value(r, piece, axis):
    return piece.x if axis == 0 else (piece.y if axis == 1 else piece.z)


@inner
def axis_end(r, axis):
    return r.x1 if axis == 0 else (r.y1 if axis == 1 else r.z1)


@inner
def scaled_axis(r, writer, target, axis):
    """The number to write for an axis so that the machine goes to ``target`` [mm], as an integer."""
    unit = 25.4 if r.flags & FLAG_INCH else 1.0
    if r.flags & FLAG_G53:
        return to_fixed(target / unit, decimals(r))
    if r.flags & FLAG_RELATIVE:
        return to_fixed((target - writer[W_PLACE + axis]) / unit, decimals(r))
    offset = r.ox if axis == 0 else (r.oy if axis == 1 else r.oz)
    return to_fixed((target - offset - writer[W_SHIFT + axis]) / unit, decimals(r))


@inner
def reached(r, writer, scaled, axis):
    """Where the machine goes [mm] when it reads that number."""
    unit = 25.4 if r.flags & FLAG_INCH else 1.0
    value = scaled * unit / POWERS[decimals(r)]
    if r.flags & FLAG_G53:
        return value
    if r.flags & FLAG_RELATIVE:
        return writer[W_PLACE + axis] + value
    offset = r.ox if axis == 0 else (r.oy if axis == 1 else r.oz)
    return value + offset + writer[W_SHIFT + axis]


@inner
def wants_axis(r, writer, target, scaled, axis):
    """Must a generated line name this axis?"""
    if r.flags & FLAG_RELATIVE and not r.flags & FLAG_G53:
        return scaled != 0
    half = 0.000127 if r.flags & FLAG_INCH else 0.0005
    return not abs(target - writer[W_PLACE + axis]) <= half  # true for NaN


@inner
def keeps_place(r, writer, target, axis):
    """Does the statement's own word take the axis to the target, as far as the writer's place is exact?"""
    start = r.x0 if axis == 0 else (r.y0 if axis == 1 else r.z0)
    if target != axis_end(r, axis):
        return False
    if r.flags & FLAG_RELATIVE and not r.flags & FLAG_G53:
        return abs(writer[W_PLACE + axis] - start) < 1e-9
    return writer[W_SHIFT + axis] == 0.0 or (r.flags & FLAG_G53) != 0


@inner
def centre_axis(r, second):
    """The axis, 0 to 2, of the first or second coordinate of an arc's plane."""
    if r.plane == 0:
        return 1 if second else 0
    if r.plane == 1:
        return 0 if second else 2
    return 2 if second else 1


@inner
def scaled_centre(r, piece, writer, second):
    """I, J or K of an arc piece: its centre from where the machine is at its start, or absolute after G90.1."""
    axis = centre_axis(r, second)
    from_mm = writer[W_PLACE + axis]
    if r.flags & FLAG_ARC_ABSOLUTE:
        from_mm = (r.ox if axis == 0 else (r.oy if axis == 1 else r.oz)) + writer[W_SHIFT + axis]
    centre = piece.c1 if second else piece.c0
    return to_fixed((centre - from_mm) / (25.4 if r.flags & FLAG_INCH else 1.0), decimals(r) + 1)


@inner
def keeps_centre(r, piece, writer):
    """Does the statement's own I J K or R hold for this arc piece?"""
    same = piece.c0 == r.c0 and piece.c1 == r.c1 and piece.x == r.x1 and piece.y == r.y1 and piece.z == r.z1
    near = abs(writer[W_PLACE] - r.x0) < 1e-9 and abs(writer[W_PLACE + 1] - r.y0) < 1e-9
    return same and near and abs(writer[W_PLACE + 2] - r.z0) < 1e-9


@inner
def put_feed(out, at, r, feed, writer):
    """Write F [mm/min] if the machine's own is another."""
    if feed > 0 and feed != writer[W_FEED]:
        scaled, decimals = scaled_feed(r, feed)
        at = put_word(out, at, r, LETTER_F, scaled, decimals)
        writer[W_FEED] = feed
    return at


@inner
def scaled_feed(r, feed):
    """F in the file's unit as a fixed-point number: with more decimals where three would make it nought."""
    value = feed / (25.4 if r.flags & FLAG_INCH else 1.0)
    decimals = THREE if value >= 1.0 else NINE
    return to_fixed(value, decimals), decimals


@inner
def e_decimals(r):
    """Decimals of E in the file's unit: steps of 10 nm of filament, in inches of 2.5 nm."""
    return SEVEN if r.flags & FLAG_INCH else FIVE


@inner
def e_scaled(r, cumulated):
    """E after this part of the statement, as a fixed-point number: absolute, or since its start."""
    unit = 25.4 if r.flags & FLAG_INCH else 1.0
    gain = r.e1 - r.e0
    value = cumulated * gain if r.flags & FLAG_E_RELATIVE else r.e0 + cumulated * gain
    return to_fixed(value / unit, e_decimals(r))


@inner
def e_rest(r, before, writer):
    """The last part of a relative E, so that the sum over all lines stays exact: what rounding took is carried on."""
    exact = (r.e1 - r.e0) / (25.4 if r.flags & FLAG_INCH else 1.0) * POWERS[e_decimals(r)] + writer[W_E_DEBT]
    total = np.int64(np.floor(min(max(exact, -9e14), 9e14) + 0.5))
    writer[W_E_DEBT] = exact - total
    return total - e_scaled(r, before)


@inner
def own_motion(r):
    """The G number of the statement."""
    if r.flags & FLAG_CURVE:
        return 5
    return 0 if r.flags & FLAG_RAPID else (1 if r.kind == KIND_LINEAR else (2 if r.kind == KIND_CW else 3))


@inner
def piece_motion(r, piece):
    """The G number of a piece."""
    if piece.kind == PIECE_ARC:
        return 2 if r.kind == KIND_CW else 3
    return 0 if r.flags & FLAG_RAPID and piece.kind == PIECE_LINE else 1


@inner
def put_command(buf, r, motion, out, at):
    """Write G0–G3 in the statement's own way (`G01`, `g1`)."""
    own = own_motion(r)
    p = r.begin
    if motion == own and not r.flags & FLAG_MODAL and upper(buf[p]) == 71:
        out[at] = buf[p]
        at, p = at + 1, p + 1
        while p < r.end and (is_digit(buf[p]) or buf[p] == 46):
            out[at] = buf[p]
            at, p = at + 1, p + 1
            if p - r.begin > 8:
                break
        return at
    out[at], out[at + 1] = cased(LETTER_G, r), 48 + motion
    return at + 2
