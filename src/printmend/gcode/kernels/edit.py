# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)
"""A statement written again with other numbers: its words, their order and its comment stay."""

import numpy as np

from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.text import *
from printmend.gcode.kernels.words import (
    DECIMALS_3,
    FIRST,
    SECOND,
    axis_end,
    axis_value,
    cased,
    centre_axis,
    copy_bytes,
    decimals,
    e_decimals,
    e_rest,
    e_scaled,
    keeps_centre,
    keeps_place,
    letter_of,
    own_motion,
    piece_motion,
    put_command,
    put_feed,
    put_fixed,
    put_word,
    reached,
    scaled_axis,
    scaled_centre,
    scaled_feed,
    to_fixed,
    wants_axis,
)
from printmend.jit import inner


# Long because it is one pass over the statement's bytes: each word is kept, changed or left out where it stands.
@inner
def edit_statement(buf, r, piece, before, writer, out, at):
    """Write the statement itself with the last piece's numbers: its words, their order and its comment stay."""
    motion = piece_motion(r, piece)
    own = own_motion(r)
    bent = piece.kind == PIECE_ARC and not keeps_centre(r, piece, writer)
    drop = 0
    if r.kind != KIND_LINEAR and piece.kind != PIECE_ARC:
        drop = WORDS_IJK | WORD_R | WORD_P
    elif bent:
        drop = WORD_R
    elif r.flags & FLAG_CURVE:
        drop = WORDS_IJK | WORD_P | WORD_Q
    centre0, centre1 = np.int64(0), np.int64(0)
    if bent:
        centre0, centre1 = scaled_centre(r, piece, writer, FIRST), scaled_centre(r, piece, writer, SECOND)
    bit0, bit1 = WORD_I << centre_axis(r, FIRST), WORD_I << centre_axis(r, SECOND)
    if not r.words & WORD_F:
        drop |= WORD_F  # an F0 sets no speed
    feed = piece.feed if piece.feed > 0 else r.feed
    unsafe = r.flags & (FLAG_TWICE | FLAG_EXPONENT) != 0  # firmwares read the text in different ways
    keep_feed = feed == r.feed and not r.flags & FLAG_TWICE
    p, start = r.begin, at
    if r.flags & FLAG_MODAL and (motion != own or writer.modal != own):
        out[at], out[at + 1] = cased(LETTER_G, r), ZERO + motion
        at += 2
        if r.flags & FLAG_SPACED:
            out[at] = SPACE
            at += 1
    done = 0
    added = False
    spaced = r.flags & FLAG_MIXED and r.flags & FLAG_SPACED
    gap = p  # what lies between here and the next word is copied with it
    while True:
        while p < r.end and (is_blank(buf[p]) or buf[p] == OPEN or buf[p] == QUOTE):
            spaced = spaced or is_blank(buf[p])
            if buf[p] == OPEN or buf[p] == QUOTE:
                closing = CLOSE if buf[p] == OPEN else QUOTE
                p += 1
                while p < r.end and buf[p] != closing:
                    p += 1
            p = min(p + 1, r.end)
        if p >= r.end or not is_letter(buf[p]):
            break
        letter = letter_of(buf[p], r)
        bit = 1 << (letter - LETTER_A)
        q = p + 1
        while q < r.end and is_blank(buf[q]):
            q += 1
        style = (SPACED if spaced or q > p + 1 else 0) | (CAPITAL if buf[p] < SMALL_A else 0)
        _, q, found = parse_number(buf, q, r.end, style)
        if not found:
            q = p + 1
        if letter == LETTER_G:
            at = copy_bytes(buf, gap, p, out, at)
            at = put_command(buf, r, motion, out, at)
        elif found and bit & (drop | done):  # of a word that comes twice the first stays
            gap, p = q, q
            continue
        elif LETTER_X <= letter <= LETTER_Z and r.words & bit:
            axis = letter - LETTER_X
            target = axis_value(piece, axis)
            at = copy_bytes(buf, gap, p + 1, out, at)
            if keeps_place(r, writer, target, axis):
                at = copy_bytes(buf, p + 1, q, out, at)
                writer.place[axis] = target
            else:
                scaled = scaled_axis(r, writer, target, axis)
                at = put_fixed(out, at, scaled, decimals(r))
                writer.place[axis] = reached(r, writer, scaled, axis)
        elif bent and bit & (bit0 | bit1):
            at = copy_bytes(buf, gap, p + 1, out, at)
            at = put_fixed(out, at, centre0 if bit == bit0 else centre1, decimals(r) + 1)
        else:
            if not added and not r.words & WORDS_XYZ and letter in (LETTER_E, LETTER_F):
                at = add_axes(r, piece, writer, out, at)
                added = True
            if letter == LETTER_E and r.words & WORD_E:
                if piece.kind == PIECE_TRAVEL:
                    gap, p = q, q
                    continue
                at = copy_bytes(buf, gap, p + 1, out, at)
                if (before > 0 or unsafe or r.flags & FLAG_CURVE) and r.flags & FLAG_E_RELATIVE:
                    at = put_fixed(out, at, e_rest(r, before, writer), e_decimals(r))
                elif unsafe:
                    at = put_fixed(out, at, e_scaled(r, 1.0), e_decimals(r))
                else:
                    at = copy_bytes(buf, p + 1, q, out, at)
            elif letter == LETTER_F and r.words & WORD_F:
                at = copy_bytes(buf, gap, p + 1, out, at)
                if keep_feed:
                    at = copy_bytes(buf, p + 1, q, out, at)
                else:
                    scaled, places = scaled_feed(r, feed)
                    at = put_fixed(out, at, scaled, places)
                writer.feed = feed
            else:
                at = copy_bytes(buf, gap, q, out, at)
        gap, p = q, q
        if letter != LETTER_G and found:
            done |= bit
        # The axes that the statement does not name follow the last one it does.
        if not added and r.words & WORDS_XYZ and done & WORDS_XYZ == r.words & WORDS_XYZ:
            at = add_axes(r, piece, writer, out, at)
            added = True
    if not added:
        at = add_axes(r, piece, writer, out, at)
    if bent and not done & bit0:
        at = put_word(out, at, r, LETTER_I + centre_axis(r, FIRST), centre0, decimals(r) + 1)
    if bent and not done & bit1:
        at = put_word(out, at, r, LETTER_I + centre_axis(r, SECOND), centre1, decimals(r) + 1)
    if not r.words & WORD_F:
        at = put_feed(out, at, r, feed, writer)
    writer.modal = motion
    return copy_tail(buf, r, gap, start, writer, out, at)


@inner
def is_plain_edit(r, piece, writer):
    """Say whether `edit_plain` is enough: for a plain, absolute line whose unnamed axes stay and whose feed holds."""
    if not r.flags & FLAG_PLAIN or r.flags & (FLAG_RELATIVE | FLAG_CHECKSUM) or piece.kind != PIECE_LINE:
        return False
    if (piece.feed > 0 and piece.feed != r.feed) or (not r.words & WORD_F and r.feed != writer.feed):
        return False
    for axis in range(3):
        still = abs(axis_value(piece, axis) - writer.place[axis]) <= 0.0005
        if not (still or r.words & (WORD_X << axis)):
            return False
    return True


@inner
def edit_plain(buf, r, piece, writer, out, at):
    """Do what `edit_statement` does to a plain line, in half the time."""
    p, end = r.begin, r.end
    out[at], out[at + 1] = buf[p], buf[p + 1]
    at, p = at + 2, p + 2
    while p + 1 < end and buf[p] == SPACE and buf[p + 1] != SEMICOLON:
        letter = buf[p + 1]
        out[at], out[at + 1] = SPACE, letter
        at, p = at + 2, p + 2
        if letter >= LETTER_X:
            axis = np.int64(letter) - LETTER_X
            target = axis_value(piece, axis)
            if target != axis_end(r, axis) or writer.shift[axis] != 0.0:
                offset = (r.ox if axis == 0 else (r.oy if axis == 1 else r.oz)) + writer.shift[axis]
                scaled = to_fixed(target - offset, DECIMALS_3)
                at = put_fixed(out, at, scaled, DECIMALS_3)
                writer.place[axis] = float(scaled) / 1000.0 + offset
                while p < end and buf[p] != SPACE and buf[p] != SEMICOLON:
                    p += 1
                continue
            writer.place[axis] = target
        while p < end and buf[p] != SPACE and buf[p] != SEMICOLON:
            out[at] = buf[p]
            at, p = at + 1, p + 1
    if r.words & WORD_F:
        writer.feed = r.feed
    writer.modal = 0 if r.flags & FLAG_RAPID else 1
    return copy_bytes(buf, p, end, out, at)


@inner
def copy_tail(buf, r, gap, start, writer, out, at):
    """Copy what follows the words: blanks, comment, checksum; a `*+` asks `renumber` for a new checksum."""
    if writer.numbered and r.flags & FLAG_CHECKSUM:
        star = r.end - 1
        while star > gap and buf[star] != STAR:
            star -= 1
        at = copy_bytes(buf, gap, star + 1, out, at)
        if at - start == star + 1 - r.begin:
            same = True
            for k in range(at - start):
                same = same and out[start + k] == buf[r.begin + k]
            if same:
                return copy_bytes(buf, star + 1, r.end, out, at)
        out[at] = PLUS
        at += 1
        p = star + 1
        while p < r.end and is_digit(buf[p]):
            p += 1
        gap = p
    return copy_bytes(buf, gap, r.end, out, at)


@inner
def add_axes(r, piece, writer, out, at):
    """Write the words of axes that move although the statement does not name them."""
    for axis in range(3):
        if r.words & (WORD_X << axis):
            continue
        target = axis_value(piece, axis)
        if np.isnan(writer.place[axis]) and not r.flags & (FLAG_KNOWN_X1 << axis):
            writer.place[axis] = target  # its place is unknown: leave it there
            continue
        scaled = scaled_axis(r, writer, target, axis)
        if wants_axis(r, writer, target, scaled, axis):
            at = put_word(out, at, r, LETTER_X + axis, scaled, decimals(r))
            writer.place[axis] = reached(r, writer, scaled, axis)
    return at
