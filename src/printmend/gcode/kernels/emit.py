"""The writer: statements and the pieces that replace their motion in, text out, line numbers included.

The writer follows the machine that will read the output (`writer`, a record of WRITER): where it is after what was
written, how far G92 on a mended place shifted its coordinates, its modal feed and motion. So rounding never adds up: a
relative move is written as the difference to where the machine is.

In files with N words the output is an intermediate text that `renumber` finishes. In it a new line begins with `N+`,
and a line whose checksum must be computed again ends in `*+`.
"""

import numpy as np

from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.text import *
from printmend.gcode.kernels.text import (
    CR,
    DECIMALS_3,
    FIRST,
    LETTER_G,
    LETTER_M,
    LETTER_N,
    LF,
    ONE,
    PLUS,
    SECOND,
    SEMICOLON,
    STAR,
    TAB,
    ZERO,
    axis_end,
    axis_value,
    cased,
    centre_axis,
    copy_bytes,
    decimals,
    digit_of,
    e_decimals,
    e_letter,
    e_rest,
    e_scaled,
    is_blank,
    is_digit,
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
    upper,
    wants_axis,
)
from printmend.jit import entry, inner

# A statement written again with other numbers: its words, their order and its comment stay.

# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)


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
    if r.turns > 0 and before > 0:  # the pieces before have turned
        drop |= WORD_P
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
def is_plain_edit(r, piece, before, writer):
    """Say whether `edit_plain` is enough: for a plain, absolute line whose unnamed axes stay and whose E holds."""
    if not r.flags & FLAG_PLAIN or r.flags & (FLAG_RELATIVE | FLAG_CHECKSUM) or piece.kind != PIECE_LINE:
        return False
    if before > 0 and r.flags & FLAG_E_RELATIVE:
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
    feed = piece.feed if piece.feed > 0 else r.feed
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
                p = _word_end(buf, p, end)
                continue
            writer.place[axis] = target
        elif letter == LETTER_F and feed != r.feed:
            scaled, places = scaled_feed(r, feed)
            at = put_fixed(out, at, scaled, places)
            p = _word_end(buf, p, end)
            continue
        while p < end and buf[p] != SPACE and buf[p] != SEMICOLON:
            out[at] = buf[p]
            at, p = at + 1, p + 1
    if r.words & WORD_F:
        writer.feed = feed
    else:
        at = put_feed(out, at, r, feed, writer)
    writer.modal = 0 if r.flags & FLAG_RAPID else 1
    return copy_bytes(buf, p, end, out, at)


@inner
def _word_end(buf, p, end):
    """Return where a word of a plain line ends."""
    while p < end and buf[p] != SPACE and buf[p] != SEMICOLON:
        p += 1
    return p


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
        if not _is_right(buf, r.begin, star, r.end):  # what was wrong stays wrong: the printer is to ask again
            return copy_bytes(buf, star + 1, r.end, out, at)
        out[at] = PLUS
        at += 1
        p = star + 1
        while p < r.end and is_digit(buf[p]):
            p += 1
        gap = p
    return copy_bytes(buf, gap, r.end, out, at)


@inner
def _is_right(buf, p, star, end):
    """Say whether the checksum behind a star is that of its line, which holds p."""
    while p > 0 and buf[p - 1] != LF and buf[p - 1] != CR:
        p -= 1
    return checksum_of(buf, p, star) == _integer(buf, star + 1, end)[0]


@inner
def checksum_of(buf, p, star):
    """Return the exclusive-or of a line's bytes from p on, without its leading blanks, to the star."""
    total = np.int64(0)
    while p < star and is_blank(buf[p]):
        p += 1
    while p < star:
        total ^= np.int64(buf[p])
        p += 1
    return total


@inner
def put_zero(buf, r, writer, out, at):
    """Write a G10 L20 so that its zero lies where the file has it: with the numbers of the mended place."""
    start, gap, p = at, r.begin, r.begin
    unit = 25.4 if r.flags & FLAG_INCH else 1.0
    while p < r.end and buf[p] != SEMICOLON and buf[p] != STAR and buf[p] != OPEN:
        letter = letter_of(buf[p], r)
        p += 1
        if not (LETTER_X <= letter <= LETTER_Z and r.words & (1 << (letter - LETTER_A))):
            continue
        axis = letter - LETTER_X
        place0 = r.x0 if axis == 0 else (r.y0 if axis == 1 else r.z0)
        off = writer.place[axis] - writer.shift[axis] - place0
        q = p
        while q < r.end and is_blank(buf[q]):
            q += 1
        value, q, found = parse_number(buf, q, r.end, np.int64(SPACED | CAPITAL))
        if found and abs(off) > 1e-9:
            at = copy_bytes(buf, gap, p, out, at)
            at = put_fixed(out, at, to_fixed(value + off / unit, DECIMALS_7), DECIMALS_7)
            gap = p = q
    return copy_tail(buf, r, gap, start, writer, out, at)


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


# New lines: what a statement needs before its last piece.

# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)


PLAIN_WORDS = WORDS_MOVING | WORDS_IJK | WORD_R | WORD_P | WORD_Q | WORD_G | WORD_N | WORDS_FURTHER


@inner
def put_extra(buf, r, out, at):
    """Copy the words that are neither place, E nor feed (laser power, probing switches). Those of further axes go once,
    with the statement itself."""
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


_MOST_INDENT = 64  # bytes of blanks before a line


@inner
def put_line_start(buf, r, writer, out, at):
    """Begin a line that the file did not have, with the blanks of its statement's: RepRapFirmware's blocks are made of
    them. G53 holds for one line only."""
    p = r.begin
    while p > 0 and (buf[p - 1] == SPACE or buf[p - 1] == TAB) and r.begin - p < _MOST_INDENT:
        p -= 1
    if p == 0 or buf[p - 1] == LF or buf[p - 1] == CR:
        at = copy_bytes(buf, p, r.begin, out, at)
    if writer.numbered and r.flags & FLAG_NUMBERED:
        out[at], out[at + 1], out[at + 2] = LETTER_N, PLUS, SPACE
        at += 3
    if r.flags & FLAG_G53:
        out[at], out[at + 1], out[at + 2], out[at + 3] = cased(LETTER_G, r), FIVE, THREE, SPACE
        at += 4
    return at


# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)


# more than a generated line or an edit adds: eight words of at most 22 bytes, starts and ends
ROOM_BYTES = 224 + _MOST_INDENT


@inner
def _follow(r, writer):
    """Move the writer's machine through a statement that is written as it was."""
    relative = r.flags & FLAG_RELATIVE and not r.flags & FLAG_G53
    moves = r.kind <= KIND_CCW or (r.kind == KIND_EVENT and (r.event == EVENT_UNKNOWN or r.event == EVENT_SPLINE))
    for axis in range(3):
        start = r.x0 if axis == 0 else (r.y0 if axis == 1 else r.z0)
        end = axis_end(r, axis)
        named = moves and (r.words & (WORD_X << axis) or r.flags & FLAG_CURVE)
        if r.kind == KIND_HOME:
            if r.axes & (1 << axis):
                writer.place[axis], writer.shift[axis] = end, 0.0
        elif r.kind == KIND_SET:
            # The new zero counts from where the mended machine is, not from where the file thinks it is.
            if r.axes & 16:
                writer.shift[axis] = 0.0
            elif r.axes & (1 << axis) and not np.isnan(writer.place[axis]):
                writer.shift[axis] = writer.place[axis] - start
        elif r.kind == KIND_EVENT and r.event == EVENT_SAVE:
            saved = writer.saved[r.axes]
            saved.place[axis], saved.shift[axis] = writer.place[axis], writer.shift[axis]
        elif r.kind == KIND_EVENT and (r.event == EVENT_RESTORE or r.event == EVENT_OFFSET) and r.axes < SAVED_SLOTS:
            saved = writer.saved[r.axes]
            writer.shift[axis] = saved.shift[axis]
            if r.event == EVENT_RESTORE:
                writer.place[axis] = saved.place[axis]
        elif r.kind == KIND_EVENT and r.event == EVENT_RESTORE and r.flags & (FLAG_KNOWN_X1 << axis):
            writer.place[axis] += end - start
        elif r.kind == KIND_EVENT and (not r.flags & (FLAG_KNOWN_X1 << axis) or (start != end and not named)):
            writer.place[axis] = np.nan
        elif named:
            if relative:
                writer.place[axis] += end - start
            else:
                writer.place[axis] = end + (writer.shift[axis] if not r.flags & FLAG_G53 else 0.0)
    if r.words & WORD_F or r.kind == KIND_EVENT or r.feed == 0.0:
        writer.feed = r.feed


@inner
def _goes_on(records, i, n, first, pieces):
    """Say whether the line after record i begins with a piece of the same acceleration as the last one."""
    if i + 1 >= n or records[i + 1].begin != records[i].next or first[i + 2] == first[i + 1]:
        return False
    return pieces[first[i + 1]].accel == pieces[first[i + 1] - 1].accel


# Long because the writer's state goes from record to record: its parts that stand alone are in `edit` and `row`.
@entry(error_model="numpy", _nrt=False)
def emit(buf, begin, records, n, first, pieces, writer, out):
    """Write buf[begin:] up to the end of record n − 1, with the pieces in place; return (records done, read, written).

    ``first`` int64 [n + 1]: record i is replaced by pieces[first[i]:first[i + 1]]. A record without pieces is copied,
    and so is one that is marked FLAG_OPAQUE or is no motion. It stops before a record that may not fit into ``out``:
    pass the output on and call again with the remaining records and ``begin`` = read. The caller copies what follows
    the last record (comments, other commands), unless another record follows it.
    """
    at, p = np.int64(0), begin
    room = len(out)
    for i in range(n):
        r = records[i]
        count = first[i + 1] - first[i]
        row = ROOM_BYTES + (MAX_CODE_BYTES if r.words & ~np.uint32(PLAIN_WORDS) else 0)
        if at + r.next - p + (count + 2) * row > room:
            return i, p, at
        at = copy_bytes(buf, p, r.begin, out, at)
        p = r.end
        motion = r.kind == KIND_LINEAR or r.kind == KIND_CW or r.kind == KIND_CCW
        if r.next > r.end:
            writer.crlf = 1 if r.next - r.end > 1 and buf[r.end] == CR else 0
        if r.flags & FLAG_RELATIVE or not motion:
            for axis in range(3):
                if np.isnan(writer.place[axis]):
                    writer.place[axis] = r.x0 if axis == 0 else (r.y0 if axis == 1 else r.z0)
        if count == 0 or not motion or r.flags & FLAG_OPAQUE:
            own = own_motion(r)
            depends = (motion or (r.kind == KIND_EVENT and r.event != EVENT_EXCLUDE)) and not r.words & WORD_F
            if depends and r.feed > 0 and writer.feed > 0 and writer.feed != r.feed:
                # The file's F would still hold here: say it again.
                out[at], out[at + 1] = cased(LETTER_G, r), ONE
                at = put_feed(out, at + 2, r, r.feed, writer)
                writer.modal = 1
                if writer.numbered and r.flags & FLAG_CHECKSUM:
                    out[at], out[at + 1] = STAR, PLUS
                    at += 2
                at = put_eol(buf, r, writer, out, at)
                at = put_line_start(buf, r, writer, out, at)
            if motion and r.flags & FLAG_MODAL and writer.modal >= 0 and writer.modal != own:
                start = at
                out[at], out[at + 1] = cased(LETTER_G, r), ZERO + own
                at += 2
                if r.flags & FLAG_SPACED:
                    out[at] = SPACE
                    at += 1
                at = copy_tail(buf, r, r.begin, start, writer, out, at)
            elif r.kind == KIND_EVENT and r.event == EVENT_ZERO:
                at = put_zero(buf, r, writer, out, at)
            else:
                at = copy_bytes(buf, r.begin, r.end, out, at)
            if motion and not r.flags & FLAG_CURVE:
                writer.modal = own
            _follow(r, writer)
            continue
        cumulated = 0.0
        edited = first[i + 1] - 1
        if r.flags & FLAG_CURVE and r.end == r.begin:
            edited += 1  # none: it has no text
        for j in range(first[i], edited):
            before = cumulated
            cumulated += pieces[j].share
            if pieces[j].accel != writer.accel:
                at = put_accel(r, pieces[j].accel, writer, out, at)
                at = put_eol(buf, r, writer, out, at)
            written = put_row(buf, r, pieces[j], cumulated, before, j == first[i + 1] - 1, writer, out, at)
            if written > at:
                at = put_line_start(buf, r, writer, out, written)
        if edited == first[i + 1]:
            continue
        piece = pieces[first[i + 1] - 1]
        if piece.accel != writer.accel:
            at = put_accel(r, piece.accel, writer, out, at)
            at = put_eol(buf, r, writer, out, at)
        if is_plain_edit(r, piece, cumulated, writer):
            at = edit_plain(buf, r, piece, writer, out, at)
        else:
            at = edit_statement(buf, r, piece, cumulated, writer, out, at)
        if writer.accel != 0.0 and not _goes_on(records, i, n, first, pieces):
            at = put_eol(buf, r, writer, out, at)
            at = put_accel(r, 0.0, writer, out, at)
    return n, p, at


# Line numbers and checksums: the last pass over a file that has them, once lines were added.

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
@entry(error_model="numpy", _nrt=False)
def renumber(buf, begin, end, lines, out):
    """Finish the intermediate text of `emit`; return (read, written).

    ``lines`` int64 [2]: lines added since the last M110, and the last number written. `N+` becomes the next number,
    other N words are raised by the lines added; where a number or `*+` changed a line, its checksum, the exclusive-or
    of the bytes before the star, is computed again; a wrong one stays wrong. It stops before a line that may not fit
    into ``out``.
    """
    p, at = begin, begin * 0
    while p < end:
        stop = p
        while stop < end and buf[stop] != LF and buf[stop] != CR:
            stop += 1
        if at + (stop - p) + _ROOM_BYTES > len(out):
            break

        line = p
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
            wrong = np.int64(0)
            if not asked:
                wrong = checksum_of(buf, line, star) ^ _integer(buf, star + 1, stop)[0]
            while p < star:
                out[at] = buf[p]
                at, p = at + 1, p + 1
            out[at] = STAR
            at = _put_integer(out, at + 1, checksum_of(out, first, at) ^ wrong)
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
