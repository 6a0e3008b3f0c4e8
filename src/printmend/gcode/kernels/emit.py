# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)
"""The writer: statements and the pieces that replace their motion in, text out, byte for byte where nothing changed.

The writer follows the machine that will read the output (`writer`, WRITER numbers): where it is after what was
written (`W_PLACE`; NaN: not certain), how far G92 on a mended place shifted its coordinates (`W_SHIFT`), its modal
feed and motion. So rounding never adds up: a relative move is written as the difference to where the machine is.

In files with N words the output is an intermediate text that `renumber` finishes: a new line begins with `N+`, and a
line whose checksum has to be computed again ends in `*+`.
"""

import numpy as np
from numba import njit

from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.text import (
    CLOSE,
    OPEN,
    POWERS,
    QUOTE,
    SEMICOLON,
    SPACE,
    STAR,
    digit_of,
    is_blank,
    is_digit,
    is_letter,
    upper,
)

COMPILED_WITH = "0c7d0efd3b43"  # digest of the kernels imported here: numba's cache watches this file only

_PLAIN_WORDS = WORDS_XYZ | WORDS_IJK | WORD_E | WORD_F | WORD_R | WORD_P | 1 << 6 | 1 << 13  # G and N too
_ROOM = 224  # more than a generated line or an edit adds: eight words of at most 22 bytes, starts and ends
# As int64 values, not literals, or numba would compile the functions that take them once for each.
_FIRST, _SECOND, _THREE, _FIVE = np.int64(0), np.int64(1), np.int64(3), np.int64(5)
_E, _F, _G = np.int64(69), np.int64(70), np.int64(71)


@njit
def _put_fixed(out, at, scaled, decimals):
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


@njit
def _copy(buf, begin, end, out, at):
    for k in range(begin, end):
        out[at] = buf[k]
        at += 1
    return at


@njit
def _scaled(value, decimals):
    """Round to an integer number of 10^−decimals, kept within what no machine exceeds."""
    return np.int64(np.floor(min(max(value * POWERS[decimals], -9e14), 9e14) + 0.5))


@njit
def _letter(byte, r):
    return byte + 32 if r.flags & FLAG_LOWER else byte


@njit
def _put_word(out, at, r, byte, scaled, decimals):
    if r.flags & FLAG_SPACED:
        out[at] = 32
        at += 1
    out[at] = _letter(byte, r)
    return _put_fixed(out, at + 1, scaled, decimals)


@njit
def _decimals(r):
    """Decimals of X Y Z in the file's unit: a rounding error of 0.5 µm at the most (0.13 µm in inches)."""
    return 5 if r.flags & FLAG_INCH else 3


@njit
def _axis_value(r, piece, axis):
    return piece.x if axis == 0 else (piece.y if axis == 1 else piece.z)


@njit
def _axis_end(r, axis):
    return r.x1 if axis == 0 else (r.y1 if axis == 1 else r.z1)


@njit
def _scaled_axis(r, writer, target, axis):
    """The number to write for an axis so that the machine goes to ``target`` [mm], as an integer."""
    unit = 25.4 if r.flags & FLAG_INCH else 1.0
    if r.flags & FLAG_G53:
        return _scaled(target / unit, _decimals(r))
    if r.flags & FLAG_RELATIVE:
        return _scaled((target - writer[W_PLACE + axis]) / unit, _decimals(r))
    offset = r.ox if axis == 0 else (r.oy if axis == 1 else r.oz)
    return _scaled((target - offset - writer[W_SHIFT + axis]) / unit, _decimals(r))


@njit
def _reached(r, writer, scaled, axis):
    """Where the machine goes [mm] when it reads that number."""
    unit = 25.4 if r.flags & FLAG_INCH else 1.0
    value = scaled * unit / POWERS[_decimals(r)]
    if r.flags & FLAG_G53:
        return value
    if r.flags & FLAG_RELATIVE:
        return writer[W_PLACE + axis] + value
    offset = r.ox if axis == 0 else (r.oy if axis == 1 else r.oz)
    return value + offset + writer[W_SHIFT + axis]


@njit
def _wants(r, writer, target, scaled, axis):
    """Must a generated line name this axis?"""
    if r.flags & FLAG_RELATIVE and not r.flags & FLAG_G53:
        return scaled != 0
    half = 0.000127 if r.flags & FLAG_INCH else 0.0005
    return not abs(target - writer[W_PLACE + axis]) <= half  # true for NaN


@njit
def _keeps(r, writer, target, axis):
    """Does the statement's own word take the axis to the target, as far as the writer's place is exact?"""
    start = r.x0 if axis == 0 else (r.y0 if axis == 1 else r.z0)
    if target != _axis_end(r, axis):
        return False
    if r.flags & FLAG_RELATIVE and not r.flags & FLAG_G53:
        return abs(writer[W_PLACE + axis] - start) < 1e-9
    return writer[W_SHIFT + axis] == 0.0 or (r.flags & FLAG_G53) != 0


@njit
def _centre_axis(r, second):
    """The axis, 0 to 2, of the first or second coordinate of an arc's plane."""
    if r.plane == 0:
        return 1 if second else 0
    if r.plane == 1:
        return 0 if second else 2
    return 2 if second else 1


@njit
def _scaled_centre(r, piece, writer, second):
    """I, J or K of an arc piece: its centre from where the machine is at its start, or absolute after G90.1."""
    axis = _centre_axis(r, second)
    from_mm = writer[W_PLACE + axis]
    if r.flags & FLAG_ARC_ABSOLUTE:
        from_mm = (r.ox if axis == 0 else (r.oy if axis == 1 else r.oz)) + writer[W_SHIFT + axis]
    centre = piece.c1 if second else piece.c0
    return _scaled((centre - from_mm) / (25.4 if r.flags & FLAG_INCH else 1.0), _decimals(r) + 1)


@njit
def _keeps_centre(r, piece, writer):
    """Does the statement's own I J K or R hold for this arc piece?"""
    same = piece.c0 == r.c0 and piece.c1 == r.c1 and piece.x == r.x1 and piece.y == r.y1 and piece.z == r.z1
    near = abs(writer[W_PLACE] - r.x0) < 1e-9 and abs(writer[W_PLACE + 1] - r.y0) < 1e-9
    return same and near and abs(writer[W_PLACE + 2] - r.z0) < 1e-9


@njit
def _put_feed(out, at, r, feed, writer):
    """Write F [mm/min] if the machine's own is another."""
    if feed > 0 and feed != writer[W_FEED]:
        at = _put_word(out, at, r, _F, _scaled(feed / (25.4 if r.flags & FLAG_INCH else 1.0), _THREE), _THREE)
        writer[W_FEED] = feed
    return at


@njit
def _e_scaled(r, cumulated):
    """E after this part of the statement, in 10^−5 of the file's unit: absolute, or since its start."""
    unit = 25.4 if r.flags & FLAG_INCH else 1.0
    gain = r.e1 - r.e0
    value = cumulated * gain if r.flags & FLAG_E_RELATIVE else r.e0 + cumulated * gain
    return _scaled(value / unit, _FIVE)


@njit
def _e_rest(r, before, writer):
    """The last part of a relative E, so that the sum over all lines stays exact: what rounding took is carried on."""
    exact = (r.e1 - r.e0) / (25.4 if r.flags & FLAG_INCH else 1.0) * 1e5 + writer[W_E_DEBT]
    total = np.int64(np.floor(min(max(exact, -9e14), 9e14) + 0.5))
    writer[W_E_DEBT] = exact - total
    return total - _e_scaled(r, before)


@njit
def _own(r):
    """The G number of the statement."""
    return 0 if r.flags & FLAG_RAPID else (1 if r.kind == KIND_LINEAR else (2 if r.kind == KIND_CW else 3))


@njit
def _put_command(buf, r, motion, out, at):
    """Write G0–G3 in the statement's own way (`G01`, `g1`)."""
    own = _own(r)
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
    out[at], out[at + 1] = _letter(_G, r), 48 + motion
    return at + 2


@njit
def _motion(r, piece):
    """The G number of a piece."""
    if piece.kind == PIECE_ARC:
        return 2 if r.kind == KIND_CW else 3
    return 0 if r.flags & FLAG_RAPID and piece.kind == PIECE_LINE else 1


@njit
def _put_extra(buf, r, out, at):
    """Copy the words that are neither place, E nor feed (laser power, probing switches)."""
    if not r.words & ~np.uint32(_PLAIN_WORDS):
        return at
    p = r.begin
    while p < r.end and buf[p] != SEMICOLON and buf[p] != STAR and buf[p] != OPEN:
        if not is_letter(buf[p]):
            p += 1
            continue
        start = p
        p += 1
        while p < r.end and not is_letter(buf[p]) and buf[p] != SEMICOLON and buf[p] != STAR and buf[p] != OPEN:
            p += 1
        if not (_PLAIN_WORDS >> (upper(buf[start]) - 65)) & 1:
            stop = p
            while stop > start and is_blank(buf[stop - 1]):
                stop -= 1
            if r.flags & FLAG_SPACED:
                out[at] = 32
                at += 1
            at = _copy(buf, start, stop, out, at)
    return at


@njit
def _put_eol(buf, r, writer, out, at):
    if r.next > r.end:
        return _copy(buf, r.end, r.next, out, at)
    if writer[W_CRLF] != 0:
        out[at] = 13
        at += 1
    out[at] = 10
    return at + 1


@njit
def _put_row(buf, r, piece, cumulated, before, writer, out, at):
    """Write a whole new line for one piece; ``before`` and ``cumulated`` are the shares of E around it."""
    start = at
    motion = _motion(r, piece)
    at = _put_command(buf, r, motion, out, at)
    body = at
    if piece.kind == PIECE_ARC:
        for second in range(2):
            scaled = _scaled_centre(r, piece, writer, second)
            at = _put_word(out, at, r, 73 + _centre_axis(r, second), scaled, _decimals(r) + 1)
    for axis in range(3):
        target = _axis_value(r, piece, axis)
        sure = r.words & (WORD_X << axis) or r.flags & (FLAG_KNOWN_X1 << axis)
        if np.isnan(writer[W_PLACE + axis]) and not sure:
            continue  # nobody knows where it is: leave it there
        scaled = _scaled_axis(r, writer, target, axis)
        if _wants(r, writer, target, scaled, axis) or (piece.kind == PIECE_ARC and r.words & (WORD_X << axis)):
            at = _put_word(out, at, r, 88 + axis, scaled, _decimals(r))
            writer[W_PLACE + axis] = _reached(r, writer, scaled, axis)
    if r.words & WORD_E and piece.kind != PIECE_TRAVEL:
        step = _e_scaled(r, cumulated)
        if r.flags & FLAG_E_RELATIVE:
            step -= _e_scaled(r, before)
        if step != 0 or not r.flags & FLAG_E_RELATIVE:
            at = _put_word(out, at, r, _E, step, _FIVE)
    if at == body:
        return start  # shorter than the resolution: nothing to write
    at = _put_feed(out, at, r, piece.feed if piece.feed > 0 else r.feed, writer)
    at = _put_extra(buf, r, out, at)
    if writer[W_NUMBERED] != 0 and r.flags & FLAG_CHECKSUM:
        out[at], out[at + 1] = STAR, 43
        at += 2
    writer[W_MODAL] = motion
    return _put_eol(buf, r, writer, out, at)


@njit
def _put_line_start(r, writer, out, at):
    """Begin a line that the file did not have; G53 holds for one line only."""
    if writer[W_NUMBERED] != 0 and r.flags & FLAG_NUMBERED:
        out[at], out[at + 1], out[at + 2] = 78, 43, 32
        at += 3
    if r.flags & FLAG_G53:
        out[at], out[at + 1], out[at + 2], out[at + 3] = _letter(_G, r), 53, 51, 32
        at += 4
    return at


@njit
def _edit(buf, r, piece, before, writer, out, at):
    """Write the statement itself with the last piece's numbers: its words, their order and its comment stay."""
    motion = _motion(r, piece)
    own = _own(r)
    bent = piece.kind == PIECE_ARC and not _keeps_centre(r, piece, writer)
    drop = 0
    if r.kind != KIND_LINEAR and piece.kind != PIECE_ARC:
        drop = WORDS_IJK | WORD_R | WORD_P
    elif bent:
        drop = WORD_R
    centre0, centre1 = np.int64(0), np.int64(0)
    if bent:
        centre0, centre1 = _scaled_centre(r, piece, writer, _FIRST), _scaled_centre(r, piece, writer, _SECOND)
    bit0, bit1 = WORD_I << _centre_axis(r, _FIRST), WORD_I << _centre_axis(r, _SECOND)
    feed = piece.feed if piece.feed > 0 else r.feed
    keep_feed = feed == r.feed
    p, start = r.begin, at
    if r.flags & FLAG_MODAL and (motion != own or writer[W_MODAL] != own):
        out[at], out[at + 1] = _letter(_G, r), 48 + motion
        at += 2
        if r.flags & FLAG_SPACED:
            out[at] = 32
            at += 1
    done = 0
    added = False
    gap = p  # what lies between here and the next word is copied with it
    while True:
        while p < r.end and (is_blank(buf[p]) or buf[p] == OPEN or buf[p] == QUOTE):
            if buf[p] == OPEN or buf[p] == QUOTE:
                closing = CLOSE if buf[p] == OPEN else QUOTE
                p += 1
                while p < r.end and buf[p] != closing:
                    p += 1
            p = min(p + 1, r.end)
        if p >= r.end or not is_letter(buf[p]):
            break
        letter = digit_of(upper(buf[p])) + 48
        bit = 1 << (letter - 65)
        q = p + 1
        while q < r.end and is_blank(buf[q]):
            q += 1
        if q == r.end or not (is_digit(buf[q]) or buf[q] == 46 or buf[q] == 43 or buf[q] == 45):
            q = p + 1
        while q < r.end and (is_digit(buf[q]) or buf[q] == 46 or buf[q] == 43 or buf[q] == 45):
            q += 1
        if q + 1 < r.end and r.flags & FLAG_EXPONENT and upper(buf[q]) == 69 and letter != 69:
            k = q + 1
            if buf[k] == 43 or buf[k] == 45:
                k += 1
            if k < r.end and is_digit(buf[k]):
                while k < r.end and is_digit(buf[k]):
                    k += 1
                if buf[q] == 101 or k == r.end or is_blank(buf[k]):
                    q = k
        if letter == 71:
            at = _copy(buf, gap, p, out, at)
            at = _put_command(buf, r, motion, out, at)
        elif bit & (drop | done):  # of a word that comes twice the first stays
            gap, p = q, q
            continue
        elif 88 <= letter <= 90 and r.words & bit:
            axis = letter - 88
            target = _axis_value(r, piece, axis)
            at = _copy(buf, gap, p + 1, out, at)
            if _keeps(r, writer, target, axis):
                at = _copy(buf, p + 1, q, out, at)
                writer[W_PLACE + axis] = target
            else:
                scaled = _scaled_axis(r, writer, target, axis)
                at = _put_fixed(out, at, scaled, _decimals(r))
                writer[W_PLACE + axis] = _reached(r, writer, scaled, axis)
        elif bent and bit & (bit0 | bit1):
            at = _copy(buf, gap, p + 1, out, at)
            at = _put_fixed(out, at, centre0 if bit == bit0 else centre1, _decimals(r) + 1)
        else:
            if not added and not r.words & WORDS_XYZ and (letter == 69 or letter == 70):
                at = _add_axes(r, piece, writer, out, at)
                added = True
            if letter == 69 and r.words & WORD_E:
                if piece.kind == PIECE_TRAVEL:
                    gap, p = q, q
                    continue
                at = _copy(buf, gap, p + 1, out, at)
                if before > 0 and r.flags & FLAG_E_RELATIVE:
                    at = _put_fixed(out, at, _e_rest(r, before, writer), _FIVE)
                else:
                    at = _copy(buf, p + 1, q, out, at)
            elif letter == 70 and r.words & WORD_F:
                at = _copy(buf, gap, p + 1, out, at)
                if keep_feed:
                    at = _copy(buf, p + 1, q, out, at)
                else:
                    at = _put_fixed(out, at, _scaled(feed / (25.4 if r.flags & FLAG_INCH else 1.0), _THREE), _THREE)
                writer[W_FEED] = feed
            else:
                at = _copy(buf, gap, q, out, at)
        gap, p = q, q
        if letter != 71:
            done |= bit
        # The axes that the statement does not name follow the last one it does.
        if not added and r.words & WORDS_XYZ and done & WORDS_XYZ == r.words & WORDS_XYZ:
            at = _add_axes(r, piece, writer, out, at)
            added = True
    if not added:
        at = _add_axes(r, piece, writer, out, at)
    if bent and not done & bit0:
        at = _put_word(out, at, r, 73 + _centre_axis(r, _FIRST), centre0, _decimals(r) + 1)
    if bent and not done & bit1:
        at = _put_word(out, at, r, 73 + _centre_axis(r, _SECOND), centre1, _decimals(r) + 1)
    if not r.words & WORD_F:
        at = _put_feed(out, at, r, feed, writer)
    writer[W_MODAL] = motion
    return _copy_tail(buf, r, gap, start, writer, out, at)


@njit
def _is_plain_edit(r, piece, writer):
    """Is `_edit_plain` enough: a plain line, absolute, whose unnamed axes stay and whose feed holds?"""
    if not r.flags & FLAG_PLAIN or r.flags & (FLAG_RELATIVE | FLAG_CHECKSUM) or piece.kind != PIECE_LINE:
        return False
    if (piece.feed > 0 and piece.feed != r.feed) or (not r.words & WORD_F and r.feed != writer[W_FEED]):
        return False
    for axis in range(3):
        still = abs(_axis_value(r, piece, axis) - writer[W_PLACE + axis]) <= 0.0005
        if not (still or r.words & (WORD_X << axis)):
            return False
    return True


@njit
def _edit_plain(buf, r, piece, writer, out, at):
    """Do what `_edit` does to a plain line, in half the time."""
    p, end = r.begin, r.end
    out[at], out[at + 1] = buf[p], buf[p + 1]
    at, p = at + 2, p + 2
    while p + 1 < end and buf[p] == SPACE and buf[p + 1] != SEMICOLON:
        letter = buf[p + 1]
        out[at], out[at + 1] = SPACE, letter
        at, p = at + 2, p + 2
        if letter >= 88:
            axis = np.int64(letter) - 88
            target = _axis_value(r, piece, axis)
            place = W_PLACE + axis
            if target != _axis_end(r, axis) or writer[W_SHIFT + axis] != 0.0:
                offset = (r.ox if axis == 0 else (r.oy if axis == 1 else r.oz)) + writer[W_SHIFT + axis]
                scaled = _scaled(target - offset, _THREE)
                at = _put_fixed(out, at, scaled, _THREE)
                writer[place] = float(scaled) / 1000.0 + offset
                while p < end and buf[p] != SPACE and buf[p] != SEMICOLON:
                    p += 1
                continue
            writer[place] = target
        while p < end and buf[p] != SPACE and buf[p] != SEMICOLON:
            out[at] = buf[p]
            at, p = at + 1, p + 1
    if r.words & WORD_F:
        writer[W_FEED] = r.feed
    writer[W_MODAL] = 0 if r.flags & FLAG_RAPID else 1
    return _copy(buf, p, end, out, at)


@njit
def _copy_tail(buf, r, gap, start, writer, out, at):
    """Copy what follows the words: blanks, comment, checksum."""
    if writer[W_NUMBERED] != 0 and r.flags & FLAG_CHECKSUM:
        star = r.end - 1
        while star > gap and buf[star] != STAR:
            star -= 1
        at = _copy(buf, gap, star + 1, out, at)
        if at - start == star + 1 - r.begin:
            same = True
            for k in range(at - start):
                same = same and out[start + k] == buf[r.begin + k]
            if same:
                return _copy(buf, star + 1, r.end, out, at)
        out[at] = 43
        at += 1
        p = star + 1
        while p < r.end and is_digit(buf[p]):
            p += 1
        gap = p
    return _copy(buf, gap, r.end, out, at)


@njit
def _add_axes(r, piece, writer, out, at):
    """Write the words of axes that move although the statement does not name them."""
    for axis in range(3):
        if r.words & (WORD_X << axis):
            continue
        target = _axis_value(r, piece, axis)
        if np.isnan(writer[W_PLACE + axis]) and not r.flags & (FLAG_KNOWN_X1 << axis):
            writer[W_PLACE + axis] = target  # nobody knows where it is: leave it there
            continue
        scaled = _scaled_axis(r, writer, target, axis)
        if _wants(r, writer, target, scaled, axis):
            at = _put_word(out, at, r, 88 + axis, scaled, _decimals(r))
            writer[W_PLACE + axis] = _reached(r, writer, scaled, axis)
    return at


@njit
def _follow(r, writer):
    """Move the writer's machine through a statement that is written as it was."""
    relative = r.flags & FLAG_RELATIVE and not r.flags & FLAG_G53
    for axis in range(3):
        start = r.x0 if axis == 0 else (r.y0 if axis == 1 else r.z0)
        end = _axis_end(r, axis)
        place = W_PLACE + axis
        if r.kind == KIND_HOME:
            if r.axes & (1 << axis):
                writer[place], writer[W_SHIFT + axis] = end, 0.0
        elif r.kind == KIND_SET:
            # The new zero counts from where the mended machine is, not from where the file thinks it is.
            if r.axes & (1 << axis) and not np.isnan(writer[place]):
                writer[W_SHIFT + axis] = writer[place] - start
        elif r.kind == KIND_EVENT and (not r.flags & (FLAG_KNOWN_X1 << axis) or start != end):
            writer[place] = np.nan
        elif r.words & (WORD_X << axis) and r.kind != KIND_RETRACT:
            if relative:
                writer[place] += end - start
            else:
                writer[place] = end + (writer[W_SHIFT + axis] if not r.flags & FLAG_G53 else 0.0)
    if r.words & WORD_F or r.kind == KIND_EVENT:
        writer[W_FEED] = r.feed


@njit(cache=True, nogil=True)
def emit(buf, begin, records, n, first, pieces, writer, out):
    """Write buf[begin:] up to the end of record n − 1, with the pieces in place; return (records done, read, written).

    ``first`` int64 [n + 1]: record i is replaced by pieces[first[i]:first[i + 1]]; with none it is copied, and so is
    one marked FLAG_OPAQUE or that is no motion. It stops before a record that may not fit into ``out``: hand the
    output on and call again with the remaining records and ``begin`` = read. What follows the last record
    (comments, other commands) is the caller's to copy, unless another record follows it.
    """
    at, p = np.int64(0), begin
    room = len(out)
    for i in range(n):
        r = records[i]
        count = first[i + 1] - first[i]
        row = _ROOM + (MAX_CODE_BYTES if r.words & ~np.uint32(_PLAIN_WORDS) else 0)
        if at + r.next - p + (count + 2) * row > room:
            return i, p, at
        at = _copy(buf, p, r.begin, out, at)
        p = r.end
        motion = r.kind == KIND_LINEAR or r.kind == KIND_CW or r.kind == KIND_CCW
        if r.next > r.end:
            writer[W_CRLF] = 1.0 if r.next - r.end > 1 and buf[r.end] == 13 else 0.0
        if r.flags & FLAG_RELATIVE or not motion:
            for axis in range(3):
                if np.isnan(writer[W_PLACE + axis]):
                    writer[W_PLACE + axis] = r.x0 if axis == 0 else (r.y0 if axis == 1 else r.z0)
        if count == 0 or not motion or r.flags & FLAG_OPAQUE:
            own = _own(r)
            depends = (motion or (r.kind == KIND_EVENT and r.event != EVENT_EXCLUDE)) and not r.words & WORD_F
            if depends and r.feed > 0 and writer[W_FEED] > 0 and writer[W_FEED] != r.feed:
                # The file's F would still hold here: say it again.
                out[at], out[at + 1] = _letter(_G, r), 49
                at = _put_feed(out, at + 2, r, r.feed, writer)
                writer[W_MODAL] = 1
                if writer[W_NUMBERED] != 0 and r.flags & FLAG_CHECKSUM:
                    out[at], out[at + 1] = STAR, 43
                    at += 2
                at = _put_eol(buf, r, writer, out, at)
                at = _put_line_start(r, writer, out, at)
            if motion and r.flags & FLAG_MODAL and writer[W_MODAL] >= 0 and writer[W_MODAL] != own:
                start = at
                out[at], out[at + 1] = _letter(_G, r), 48 + own
                at += 2
                if r.flags & FLAG_SPACED:
                    out[at] = 32
                    at += 1
                at = _copy_tail(buf, r, r.begin, start, writer, out, at)
            else:
                at = _copy(buf, r.begin, r.end, out, at)
            if motion:
                writer[W_MODAL] = own
            _follow(r, writer)
            continue
        cumulated = 0.0
        for j in range(first[i], first[i + 1] - 1):
            before = cumulated
            cumulated += pieces[j].share
            written = _put_row(buf, r, pieces[j], cumulated, before, writer, out, at)
            if written > at:
                at = _put_line_start(r, writer, out, written)
        piece = pieces[first[i + 1] - 1]
        if count == 1 and _is_plain_edit(r, piece, writer):
            at = _edit_plain(buf, r, piece, writer, out, at)
        else:
            at = _edit(buf, r, piece, cumulated, writer, out, at)
    return n, p, at
