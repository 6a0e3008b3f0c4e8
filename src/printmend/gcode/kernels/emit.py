# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)
"""The writer: statements and the pieces that replace their motion in, text out, byte for byte where nothing changed.

The writer follows the machine that will read the output (`writer`, a record of WRITER): where it is after what was
written, how far G92 on a mended place shifted its coordinates, its modal feed and motion. So rounding never adds up: a
relative move is written as the difference to where the machine is.

In files with N words the output is an intermediate text that `renumber` finishes. In it a new line begins with `N+`,
and a line whose checksum must be computed again ends in `*+`.
"""

import numpy as np

from printmend.gcode.kernels.edit import copy_tail, edit_plain, edit_statement, is_plain_edit
from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.row import PLAIN_WORDS, put_accel, put_eol, put_line_start, put_row
from printmend.gcode.kernels.text import *
from printmend.gcode.kernels.words import axis_end, cased, copy_bytes, own_motion, put_feed
from printmend.jit import entry, inner

ROOM_BYTES = 224  # more than a generated line or an edit adds: eight words of at most 22 bytes, starts and ends


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
    if r.words & WORD_F or r.kind == KIND_EVENT:
        writer.feed = r.feed


@inner
def _goes_on(records, i, n, first, pieces):
    """Say whether the line after record i begins with a piece of the same acceleration as the last one."""
    if i + 1 >= n or records[i + 1].begin != records[i].next or first[i + 2] == first[i + 1]:
        return False
    return pieces[first[i + 1]].accel == pieces[first[i + 1] - 1].accel


# Long because the writer's state goes from record to record: its parts that stand alone are in `edit` and `row`.
@entry
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
                at = put_line_start(r, writer, out, at)
            if motion and r.flags & FLAG_MODAL and writer.modal >= 0 and writer.modal != own:
                start = at
                out[at], out[at + 1] = cased(LETTER_G, r), ZERO + own
                at += 2
                if r.flags & FLAG_SPACED:
                    out[at] = SPACE
                    at += 1
                at = copy_tail(buf, r, r.begin, start, writer, out, at)
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
                at = put_line_start(r, writer, out, written)
        if edited == first[i + 1]:
            continue
        piece = pieces[first[i + 1] - 1]
        if piece.accel != writer.accel:
            at = put_accel(r, piece.accel, writer, out, at)
            at = put_eol(buf, r, writer, out, at)
        if count == 1 and is_plain_edit(r, piece, writer):
            at = edit_plain(buf, r, piece, writer, out, at)
        else:
            at = edit_statement(buf, r, piece, cumulated, writer, out, at)
        if writer.accel != 0.0 and not _goes_on(records, i, n, first, pieces):
            at = put_eol(buf, r, writer, out, at)
            at = put_accel(r, 0.0, writer, out, at)
    return n, p, at
