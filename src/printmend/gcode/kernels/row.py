# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)
"""New lines: what a statement needs before its last piece."""

import numpy as np

from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.text import *
from printmend.gcode.kernels.words import (
    axis_value,
    cased,
    centre_axis,
    copy_bytes,
    decimals,
    e_decimals,
    e_letter,
    e_rest,
    e_scaled,
    letter_of,
    piece_motion,
    put_command,
    put_feed,
    put_fixed,
    put_word,
    reached,
    scaled_axis,
    scaled_centre,
    wants_axis,
)
from printmend.jit import inner

PLAIN_WORDS = WORDS_XYZ | WORDS_IJK | WORD_E | WORD_F | WORD_R | WORD_P | WORD_Q | WORD_G | WORD_N


@inner
def put_extra(buf, r, out, at):
    """Copy the words that are neither place, E nor feed (laser power, probing switches)."""
    if not r.words & ~np.uint32(PLAIN_WORDS):
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
        if not (PLAIN_WORDS >> (letter_of(buf[start], r) - LETTER_A)) & 1:
            stop = p
            while stop > start and is_blank(buf[stop - 1]):
                stop -= 1
            if r.flags & FLAG_SPACED:
                out[at] = SPACE
                at += 1
            at = copy_bytes(buf, start, stop, out, at)
    return at


@inner
def put_eol(buf, r, writer, out, at):
    """End a line as its statement's line ends; with a plain line end if that has more than three bytes."""
    if 0 < r.next - r.end <= 3:
        return copy_bytes(buf, r.end, r.next, out, at)
    if writer.crlf:
        out[at] = CR
        at += 1
    out[at] = LF
    return at + 1


@inner
def put_accel(r, accel, writer, out, at):
    """Write the acceleration [mm/s²] for the machine, or with 0 the file's own again, by the file's own word."""
    for byte in (LETTER_M, ZERO + 2, ZERO, ZERO + 4, SPACE):
        out[at] = byte
        at += 1
    out[at] = LETTER_S if (r.flags >> TELL_SHIFT) & TELL_MASK == TELL_S else LETTER_P
    writer.accel = accel
    return put_fixed(out, at + 1, np.int64(np.rint(1000.0 * (accel if accel > 0.0 else r.accel))), 3)


@inner
def put_row(buf, r, piece, cumulated, before, last, writer, out, at):
    """Write a whole new line for one piece; ``before`` and ``cumulated`` are the shares of E around it.

    ``last`` says that no other piece of its record follows.
    """
    start = at
    motion = piece_motion(r, piece)
    at = put_command(buf, r, motion, out, at)
    body = at
    if piece.kind == PIECE_ARC:
        for second in range(2):
            scaled = scaled_centre(r, piece, writer, second)
            at = put_word(out, at, r, LETTER_I + centre_axis(r, second), scaled, decimals(r) + 1)
    for axis in range(3):
        target = axis_value(piece, axis)
        sure = r.words & (WORD_X << axis) or r.flags & (FLAG_KNOWN_X1 << axis)
        if np.isnan(writer.place[axis]) and not sure:
            continue  # its place is unknown: leave it there
        scaled = scaled_axis(r, writer, target, axis)
        # An arc names its end; and where it comes from an unknown place the writer's own is a guess.
        named = r.words & (WORD_X << axis) and (piece.kind == PIECE_ARC or not r.flags & (FLAG_KNOWN_X0 << axis))
        if named or wants_axis(r, writer, target, scaled, axis):
            at = put_word(out, at, r, LETTER_X + axis, scaled, decimals(r))
            writer.place[axis] = reached(r, writer, scaled, axis)
    if r.words & WORD_E and piece.kind != PIECE_TRAVEL:
        step = e_scaled(r, cumulated)
        if r.flags & FLAG_E_RELATIVE:
            step = e_rest(r, before, writer) if last else step - e_scaled(r, before)
        if step != 0 or not r.flags & FLAG_E_RELATIVE:
            at = put_word(out, at, r, e_letter(r), step, e_decimals(r))
    if at == body:
        return start  # shorter than the resolution: nothing to write
    at = put_feed(out, at, r, piece.feed if piece.feed > 0 else r.feed, writer)
    at = put_extra(buf, r, out, at)
    if writer.numbered and r.flags & FLAG_CHECKSUM:
        out[at], out[at + 1] = STAR, PLUS
        at += 2
    writer.modal = motion
    return put_eol(buf, r, writer, out, at)


@inner
def put_line_start(r, writer, out, at):
    """Begin a line that the file did not have; G53 holds for one line only."""
    if writer.numbered and r.flags & FLAG_NUMBERED:
        out[at], out[at + 1], out[at + 2] = LETTER_N, PLUS, SPACE
        at += 3
    if r.flags & FLAG_G53:
        out[at], out[at + 1], out[at + 2], out[at + 3] = cased(LETTER_G, r), FIVE, THREE, SPACE
        at += 4
    return at
