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
    tool_change,
)
from printmend.gcode.kernels.klipper import long_command
from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.notes import has_room, note_comment, note_statement, role_of
from printmend.gcode.kernels.plain import plain_move
from printmend.gcode.kernels.spline import CURVES_A_LINE, chords_of, most_records, put_chords
from printmend.gcode.kernels.statement import EXTENDED, LAST_MOVE, STATEMENT, read_statement
from printmend.gcode.kernels.text import *
from printmend.jit import entry, inner

_LAYER_CHANGE = np.frombuffer(b"LAYER_CHANGE", np.uint8)
_CHANGE_LAYER = np.frombuffer(b"CHANGE_LAYER", np.uint8)
_LAYER = np.frombuffer(b"LAYER", np.uint8)
# Words with which a line may begin that goes on with the motion of an earlier one.
_MODAL_LEADS = WORDS_XYZ | WORDS_IJK | WORD_E | WORD_F | WORD_R
_LAYER_OBJECT = np.frombuffer(b"BEGIN_LAYER_OBJECT", np.uint8)


@inner
def _comment(buf, p, stop, counts):
    """Count layer comments: `;LAYER_CHANGE`, `;LAYER:3`, `; CHANGE_LAYER`, `; layer 3, Z = …`, KISSlicer's."""
    first = upper(buf[p])
    if first == LETTER_L and starts_with(buf, p, stop, _LAYER):
        q = p + 5
        if starts_with(buf, p, stop, _LAYER_CHANGE):
            counts.layer += q + 7 == stop or is_blank(buf[min(q + 7, stop - 1)])
        elif q + 1 < stop and (buf[q] == COLON or buf[q] == SPACE) and (is_digit(buf[q + 1]) or buf[q + 1] == MINUS):
            counts.layer += 1
    elif (first == LETTER_C and starts_with(buf, p, stop, _CHANGE_LAYER)) or (
        first == LETTER_B and starts_with(buf, p, stop, _LAYER_OBJECT)
    ):
        counts.layer += 1


# Its many parameters are the interpreter's state and arrays, and the line in hand.
@inner
def _line(buf, p, stop, after, s, values, numbers, counts, records, n, notes):
    """Obey one line, buf[p:stop], statement by statement; return the next free record. s is scratch, a STATEMENT."""
    p = _after_blanks(buf, p, stop)
    if p + 2 < stop and buf[p] == 0xEF and buf[p + 1] == 0xBB and buf[p + 2] == 0xBF:  # UTF-8's mark
        p += 3
    if p >= stop:
        return n
    if buf[p] == SEMICOLON:
        text = _after_blanks(buf, p + 1, stop)
        if text < stop:
            _comment(buf, text, stop, counts)
            counts.role = role_of(buf, text, stop, counts.role)
            if len(notes) > 0:
                note_comment(buf, p, text, stop, notes, counts, n)
        return n
    s.flags = s.spaced = 0
    if upper(buf[p]) == LETTER_N and p + 1 < stop and is_digit(buf[p + 1]):
        p = _after_number(buf, p + 1, stop)
        s.flags = FLAG_NUMBERED
        counts.numbered += 1
    curves = 0
    while p < stop:
        p = read_statement(buf, p, stop, s, values, numbers, counts)
        if s.spaced:
            s.flags |= FLAG_SPACED
        # F0 asks for no speed: firmwares keep the one that they have, or stop with an error.
        if s.letter in (LETTER_G, 0) and s.words & WORD_F & ~(s.bare | s.twice) and values[VALUE_F] == 0.0:
            s.words ^= WORD_F
        r = records[n]
        begin_record(r, s.start, p if s.again else stop, p if s.again else after, numbers, counts, s.flags)
        r.words = s.words
        if s.twice:
            r.flags = r.flags | FLAG_TWICE
        # Nobody knows what a firmware makes of these, or there is no room to write them again.
        if s.garbled or s.words & s.bare or s.twice & (WORDS_IJK | WORD_R) or p - s.start > MAX_CODE_BYTES:
            r.flags = r.flags | FLAG_OPAQUE
        if len(notes) > 0:
            note_statement(buf, s, p if s.again else stop, values, notes, numbers, counts, n)
        what = _obey(buf, stop, s, r, values, numbers, counts)
        chords = chords_of(r, s, values, numbers, counts) if what == EVENT_SPLINE and curves < CURVES_A_LINE else 0
        if chords > 0:
            n = put_chords(records, n, s, values, numbers, counts, chords)
            curves += 1
        elif what != 0:
            if what == EVENT_SPLINE:
                r.flags = r.flags | FLAG_OPAQUE
            event(r, counts, what)
        if s.letter != LETTER_G or s.code > LAST_MOVE:
            add_offsets(numbers, counts)
        if chords == 0 and r.kind != 0:
            finish_record(r, numbers, counts)
            n += 1
        if not s.again:
            break
        s.flags = s.flags & FLAG_NUMBERED | FLAG_MIXED
    return n


@inner
def _after_blanks(buf, p, stop):
    """Return what follows the blanks at p."""
    while p < stop and is_blank(buf[p]):
        p += 1
    return p


@inner
def _after_number(buf, p, stop):
    """Return what follows the digits at p, and the blanks after them."""
    while p < stop and is_digit(buf[p]):
        p += 1
    return _after_blanks(buf, p, stop)


@inner
def _obey(buf, stop, s, r, values, numbers, counts):
    """Do to the machine's state what a statement says, and note it in its record; return what event it is, or 0."""
    if s.letter == LETTER_G and s.code > LAST_MOVE:
        return g_command(r, numbers, counts, s.words, s.bare, s.unclear, values, s.code)
    if s.letter == LETTER_G or s.letter == 0:
        named = (s.words | s.unclear) & (WORDS_XYZ | WORD_E | WORD_F)
        if s.letter == LETTER_G:
            counts.modal = s.code // 10
        elif not (1 << max(s.lead - LETTER_A, 0)) & _MODAL_LEADS and named:  # `O1 X5`: another command, or a modal move
            r.flags = r.flags | FLAG_OPAQUE
            return EVENT_UNKNOWN + ALL_LOST
        else:
            r.flags = r.flags | FLAG_MODAL
        if counts.modal >= 0 and (s.letter == LETTER_G or named):
            move(r, numbers, counts, s.words, s.unclear, values, counts.modal)
        return 0
    if s.letter == LETTER_M:
        return m_command(numbers, counts, s.words, s.bare, values, s.code)
    if s.letter == LETTER_T:
        return tool_change(numbers, counts, s.code // 10) if s.code // 10 != counts.tool else 0
    if s.letter == EXTENDED:
        return long_command(r, buf, s.start, stop, numbers, counts)
    r.flags = r.flags | FLAG_OPAQUE
    return EVENT_PLACEHOLDER + ALL_LOST


@entry
def interpret(buf, begin, end, numbers, counts, records, notes):
    """Interpret the whole lines buf[begin:end]; return (records filled, where it stopped).

    ``buf`` is uint8. ``numbers`` and ``counts`` are the machine's state, records of NUMBERS and COUNTS, and are
    advanced. ``records`` is an array of RECORD. It stops before a line whose statements may not fit in ``records`` (see
    `most_records`), or whose notes may not fit in ``notes``, an array of NOTE: call again with the rest.
    ``counts.noted`` is the number of notes; without room for any, nothing is noted.
    """
    counts.noted = 0
    values = np.zeros(26)
    scratch = np.zeros(1, STATEMENT)
    n = np.int64(0)
    capacity = len(records)
    p = begin
    while p < end:
        if n < capacity:
            after = plain_move(buf, p, end, numbers, counts, records, n)
            if after >= 0:
                n += 1
                counts.line += 1
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
        if most_records(buf, p, stop) > capacity - n or not has_room(notes, counts):
            break
        n = _line(buf, p, stop, after, scratch[0], values, numbers, counts, records, n, notes)
        counts.line += 1
        p = after
    return n, p
