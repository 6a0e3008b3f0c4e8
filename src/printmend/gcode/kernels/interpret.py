"""The interpreter: lines of text in, records of what they mean out, with a short way for the most common line."""

import numpy as np

from printmend.gcode.kernels.commands import (
    ALL_LOST,
    CURVES_A_LINE,
    add_offsets,
    begin_record,
    change_modes,
    chords_of,
    event,
    finish_record,
    g_command,
    host_event,
    long_command,
    lose_all,
    m_command,
    most_records,
    move,
    put_chords,
    set_mode,
    settle,
    tool_change,
    unsure_words,
)
from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.text import *
from printmend.jit import entry, inner

# One statement of a line, read but not yet obeyed: its command, which of its words have a value, what is odd about it.
#
# Letters are read one after the other; `Y-2.4e-5`, `X 10`, `X[next]`, `(remark)` and `T?` all occur in real files.

# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)


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
        ("unclear", "i8"),  # those whose value the file does not say,
        ("twice", "i8"),  # and those that come twice
        ("flags", "i8"),  # FLAG_* of its line so far
        ("spaced", "i8"),  # 1 where blanks were seen in its line
        ("garbled", "i8"),  # 1 where firmwares may read it in different ways: none of its words is believed
        ("column", "i8"),  # where its line's text begins, by RepRapFirmware's count
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
            _sign(buf, p, stop, s, counts, byte)
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
def _sign(buf, p, stop, s, counts, byte):
    """End a statement at a character that is no letter: a checksum, a comment, a placeholder, or an unknown one."""
    s.over = 1
    if byte == STAR:
        s.flags |= FLAG_CHECKSUM
        counts.checksums += 1
    elif among(condition(buf, p, stop)[0], CONDITIONS):
        s.again = 1
    elif _is_filled_in(byte):
        s.unclear |= WORDS_ALL
        if s.letter == 0:
            s.letter = FILLED_IN
    elif byte != SEMICOLON:
        s.garbled = 1
        s.unclear |= _letters(buf, p, stop)
        if s.letter == 0 and s.unclear & (WORD_G | WORD_M | WORD_T):  # a command behind it: a line that may be skipped
            s.letter = FILLED_IN


# What slicers' placeholders and Jinja's templates say of the lines or commands that follow: these may be skipped.
OPENING = np.array([name_hash("IF"), name_hash("FOR")])
CLOSING = np.array([name_hash("ENDIF"), name_hash("ENDFOR")])
CONDITIONS = np.array([name_hash(name) for name in ("IF", "FOR", "ELSIF", "ELIF", "ELSE", "ENDIF", "ENDFOR", "SET")])


@inner
def condition(buf, p, stop):
    """Return the first name, as a hash, of what stands in braces at p, `{if …}` or `{% if … %}`, and where it ends."""
    if buf[p] != BRACE:
        return np.uint64(0), p
    p += 1
    while p < stop and (buf[p] in (PERCENT, MINUS) or is_blank(buf[p])):
        p += 1
    name, p = word_hash(buf, p, stop)
    while p < stop and buf[p] != BRACE_END:
        p += 1
    return name, p + 1


@inner
def _after_conditions(buf, p, stop, counts):
    """Skip the conditions at p and return where they end. ``block`` becomes −n while n conditions are open."""
    while p < stop:
        p = _after_blanks(buf, p, stop)
        name, after = condition(buf, p, stop) if p < stop else (np.uint64(0), p)
        if not among(name, CONDITIONS):
            break
        change_modes(counts)
        if counts.block <= 0:
            counts.block += np.int64(among(name, CLOSING) and counts.block < 0) - np.int64(among(name, OPENING))
        p = after
    return p


@inner
def _letters(buf, p, stop):
    """Return the letters, as bits, that a number or a placeholder follows in what is left of a line."""
    letters = 0
    while p + 1 < stop and buf[p] != SEMICOLON:
        behind = buf[p + 1]
        number = is_digit(behind) or behind in (PLUS, MINUS, POINT) or _is_filled_in(behind)
        if is_letter(buf[p]) and number:
            letters |= 1 << (np.int64(upper(buf[p])) - LETTER_A)
        p += 1
    return letters


@inner
def _is_filled_in(byte):
    """Say whether a character begins a placeholder, which someone else fills in."""
    return byte in (BRACE, BRACKET, HASH)


@inner
def _letter(buf, p, stop, s, values, numbers, counts, byte):
    """Read a letter at p, ``byte`` in upper case, with what follows it; return where that ends."""
    style = (SPACED if s.spaced else 0) | (CAPITAL if buf[p] < SMALL_A else 0)
    value, q, found = parse_number(buf, p + 1, stop, style)
    if not found and s.letter == 0 and byte in (LETTER_G, LETTER_M):  # `G 1`
        value, q, found = parse_number(buf, _after_blanks(buf, p + 1, stop), stop, style)
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


# The short way for the line that files are made of: `G1 X… Y… E…`, one blank between words, millimetres.
#
# It does what the general way in `interpret` does to such a line, in half the time; anything else it leaves alone.

# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)


# Long because it is one pass over the line's bytes: what makes a line no plain move ends it where it is seen.
# Its digits are read as in `text.parse_number`: through one function for both, a file takes a third longer to read.
@inner
def plain_move(buf, p, end, numbers, counts, records, n):
    """Obey the line at p and fill record n; return the start of the next line, or −1 if it is no plain move."""
    if p + 4 > end or buf[p] != LETTER_G or (buf[p + 1] != ONE and buf[p + 1] != ZERO) or buf[p + 2] != SPACE:
        return -1
    if counts.inch != 0 or counts.e_is_a != 0 or counts.block != 0 or counts.unsure & UNSURE_PLAIN != 0:
        return -1
    start = p
    x = y = z = e = f = 0.0
    words = 0
    p += 2
    while p < end and buf[p] == SPACE and p - start < MAX_CODE_BYTES:
        p += 1
        if p + 1 >= end:
            return -1
        letter = buf[p]
        if letter == SEMICOLON:
            break
        p += 1
        negative = buf[p] == MINUS
        p += negative
        first = p
        whole = np.int64(0)
        while p < end:
            digit = digit_of(buf[p])
            if digit < 0 or digit > 9:
                break
            whole = whole * 10 + digit
            p += 1
        digits, decimals = p - first, 0
        if p < end and buf[p] == POINT:
            p += 1
            first = p
            while p < end:
                digit = digit_of(buf[p])
                if digit < 0 or digit > 9:
                    break
                whole = whole * 10 + digit
                p += 1
            decimals = p - first
            digits += decimals
        if digits == 0 or digits > 15:
            return -1
        value = float(whole) / POWERS[decimals]
        if negative:
            value = -value
        bit = 0
        if letter == LETTER_X:
            x, bit = value, WORD_X
        elif letter == LETTER_Y:
            y, bit = value, WORD_Y
        elif letter == LETTER_E:
            e, bit = value, WORD_E
        elif letter == LETTER_F:
            f, bit = abs(value), WORD_F
        elif letter == LETTER_Z:
            z, bit = value, WORD_Z
        if bit == 0 or words & bit or (bit == WORD_F and f == 0.0):
            return -1
        words |= bit
    if p < end and buf[p] == SEMICOLON:
        while p < end and buf[p] != LF and buf[p] != CR:
            p += 1
    stop = p
    if p < end:
        if buf[p] == CR:
            p += 1
        if p >= end or buf[p] != LF:
            return -1
        p += 1

    relative = counts.relative != 0
    e_relative = counts.m83 != 0 or (relative and counts.rule == E_EITHER)
    known, sure = counts.known, counts.offset_known
    x0, y0, z0, e0 = numbers.pos[0], numbers.pos[1], numbers.pos[2], numbers.e
    ox, oy, oz = numbers.offset[0], numbers.offset[1], numbers.offset[2]
    feed, flow, area = numbers.feed, numbers.flow, numbers.area
    layer, plane, line = counts.layer, counts.plane, counts.line
    flags = known * FLAG_KNOWN_X0 | FLAG_SPACED | FLAG_PLAIN | counts.role << ROLE_SHIFT | counts.tell << TELL_SHIFT
    if buf[start + 1] == ZERO:
        flags |= FLAG_RAPID
    if relative:
        flags |= FLAG_RELATIVE
    if e_relative:
        flags |= FLAG_E_RELATIVE
    if counts.arc_absolute != 0:
        flags |= FLAG_ARC_ABSOLUTE
    x1, y1, z1, e1 = x0, y0, z0, e0
    if words & WORD_X:
        x1 = x0 + x if relative else x + ox
    if words & WORD_Y:
        y1 = y0 + y if relative else y + oy
    if words & WORD_Z:
        z1 = z0 + z if relative else z + oz
    if not relative:
        named = words >> VALUE_X
        known = (known & ~named) | (named & sure)
    advance = 0.0
    if words & WORD_E:
        e1 = e0 + e if e_relative else e
        advance = (e1 - e0) * flow
        if area > 0:
            advance /= area
    if words & WORD_F:
        feed = f
    if advance > 0 and (x1 != x0 or y1 != y0 or z1 != z0):
        flags |= FLAG_EXTRUDING
    flags |= known * FLAG_KNOWN_X1

    numbers.pos[0], numbers.pos[1], numbers.pos[2] = x1, y1, z1
    numbers.e, numbers.feed = e1, feed
    counts.known, counts.modal = known, 0 if flags & FLAG_RAPID else 1
    r = records[n]
    r.begin, r.end, r.next, r.line = start, stop, p, line
    r.x0, r.y0, r.z0, r.x1, r.y1, r.z1 = x0, y0, z0, x1, y1, z1
    r.c0 = r.c1 = np.nan
    r.e0, r.e1, r.advance, r.feed, r.accel = e0, e1, advance, feed, numbers.accel
    r.ox, r.oy, r.oz = ox, oy, oz
    r.words, r.flags, r.layer, r.turns, r.doubted = words, flags, layer, 0, counts.doubted
    r.kind, r.event, r.plane, r.axes = KIND_LINEAR, 0, plane, NO_SLOT
    return p


# Notes beside the records: what a text says of time, of the machine's limits, and of what lines are printed for.
#
# None of it moves anything by itself. Slicers write `;TYPE:External perimeter`, `;TYPE:WALL-OUTER`, `; FEATURE: Outer
# wall` or `; feature outer perimeter`.

# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)


_TYPE, _FEATURE = np.frombuffer(b"TYPE:", np.uint8), np.frombuffer(b"FEATURE", np.uint8)
# In this order: a word of the first that a comment has says what it names.
_WORDS = (
    np.frombuffer(b"SUPPORT SKIRT BRIM TOWER PILLAR SHIELD RAFT WIPE ", np.uint8),
    np.frombuffer(b"OUTER EXTERNAL OVERHANG SINGLE ", np.uint8),
    np.frombuffer(b"INNER PERIMETER WALL ", np.uint8),
    np.frombuffer(b"SOLID TOP BOTTOM SURFACE SKIN BRIDGE IRONING GAP ", np.uint8),
    np.frombuffer(b"FILL ", np.uint8),
)
_ROLES = (ROLE_ASIDE, ROLE_OUTER, ROLE_INNER, ROLE_SOLID, ROLE_INFILL)


@inner
def role_of(buf, p, stop, before):
    """Return the ROLE_* that a comment, whose text begins at p, names; ``before`` where it names none."""
    if starts_with(buf, p, stop, _TYPE):
        p += len(_TYPE)
    elif starts_with(buf, p, stop, _FEATURE):
        p += len(_FEATURE)
    else:
        return before
    for k in range(len(_ROLES)):
        if _has_one(buf, p, stop, _WORDS[k]):
            return np.int64(_ROLES[k])
    return np.int64(ROLE_UNKNOWN)


@inner
def _has_one(buf, p, stop, words):
    """Say whether one of some words, each with a blank behind it, stands in buf[p:stop], in either case."""
    first = 0
    for last in range(len(words)):
        if words[last] == 32:
            for q in range(p, stop):
                if starts_with(buf, q, stop, words[first:last]):
                    return True
            first = last + 1
    return False


_TIMES = (
    np.frombuffer(b"TIME:", np.uint8),
    np.frombuffer(b"TIME_ELAPSED:", np.uint8),
    np.frombuffer(b"PRINT.TIME:", np.uint8),
    np.frombuffer(b"PRINT TIME:", np.uint8),
    np.frombuffer(b"PRINTING_TIME:", np.uint8),
    np.frombuffer(b"REMAINING_TIME:", np.uint8),
    np.frombuffer(b"BUILD TIME:", np.uint8),
    np.frombuffer(b"ESTIMATED PRINTING TIME", np.uint8),
    np.frombuffer(b"ESTIMATED FIRST LAYER PRINTING TIME", np.uint8),
    np.frombuffer(b"MODEL PRINTING TIME:", np.uint8),
)
_VELOCITY_LIMIT = name_hash("SET_VELOCITY_LIMIT")
_LIMIT_KEYS = np.array(
    [name_hash(name) for name in ("VELOCITY", "ACCEL", "SQUARE_CORNER_VELOCITY", "MINIMUM_CRUISE_RATIO",
        "ACCEL_TO_DECEL")]
)  # fmt: skip


@inner
def has_room(notes, counts):
    """Say whether the notes of another line fit; without an array for them nothing is noted."""
    return len(notes) == 0 or counts.noted + NOTES_A_LINE <= len(notes)


@inner
def _put(notes, counts, record, begin, end, what):
    """Write a note without values, and return it; where there is no more room, the last one is written over."""
    note = notes[min(counts.noted, len(notes) - 1)]
    counts.noted = min(counts.noted + 1, len(notes))
    note.record, note.begin, note.end, note.what = record, begin, end, what
    for k in range(NOTE_VALUES):
        note.values[k] = np.nan
    return note


@inner
def note_comment(buf, start, p, stop, notes, counts, record):
    """Note a comment, whose text begins at p and whose line at ``start``, if it tells a printing time."""
    first = upper(buf[p])
    if first not in (LETTER_T, LETTER_P, LETTER_B, LETTER_E, LETTER_M, LETTER_R):
        return
    for text in _TIMES:
        if starts_with(buf, p, stop, text):
            _put(notes, counts, record, start, stop, NOTE_TIME)
            return


@inner
def note_statement(buf, s, stop, values, notes, numbers, counts, record):
    """Note a statement, which ends at ``stop``, if it tells the progress, waits, or sets a limit.

    The acceleration of printing moves is also kept in ``numbers``.
    """
    unit = 25.4 if counts.inch else 1.0
    if s.letter == EXTENDED:
        _note_velocity_limit(buf, s.start, stop, notes, numbers, counts, record)
    elif s.letter == LETTER_G and s.code == 40:
        note = _put(notes, counts, record, s.start, stop, NOTE_DWELL)
        note.values[0] = values[VALUE_P] / 1000.0 if s.words & WORD_P else 0.0
        note.values[1] = values[VALUE_S] if s.words & WORD_S else 0.0
    elif s.letter != LETTER_M:
        return
    elif s.code == 730:
        _put(notes, counts, record, s.start, stop, NOTE_TIME)
    elif s.code == 2200:
        if s.words & WORD_S:
            _put(notes, counts, record, s.start, stop, NOTE_PERCENT).values[0] = values[VALUE_S]
    elif s.code in (2010, 2030, 2050, 5660):
        what = NOTE_ACCELS if s.code == 2010 else (NOTE_SPEEDS if s.code == 2030 else NOTE_CORNERS)
        note = _put(notes, counts, record, s.start, stop, what)
        for k in range(5):
            letter = (VALUE_X, VALUE_Y, VALUE_Z, VALUE_E, VALUE_J)[k]
            if s.words & (1 << letter):
                note.values[k] = values[letter] * unit
    elif s.code == 2040:
        note = _put(notes, counts, record, s.start, stop, NOTE_ACCEL)
        for k in range(4):
            letter = (VALUE_P, VALUE_T, VALUE_R, VALUE_S)[k]
            if s.words & (1 << letter):
                note.values[k] = values[letter] * unit
        if s.unclear:
            numbers.accel = 0.0
        else:
            _keep_accel(note.values[0], note.values[1], note.values[3], numbers, counts)


@inner
def _keep_accel(printing, travel, both, numbers, counts):
    """Keep M204's acceleration of printing moves [mm/s²], NaN where it is not given, and by which word it was set."""
    if both > 0.0:
        numbers.accel, counts.tell = both, TELL_S
    elif counts.flavour == FLAVOUR_KLIPPER:  # which takes the smaller of P and T, and neither by itself
        if printing > 0.0 and travel > 0.0:
            numbers.accel, counts.tell = min(printing, travel), TELL_S
    elif printing > 0.0:
        numbers.accel, counts.tell = printing, TELL_P
    elif travel > 0.0:  # from now on S would change it
        counts.tell = TELL_P


@inner
def _note_velocity_limit(buf, p, stop, notes, numbers, counts, record):
    """Note Klipper's SET_VELOCITY_LIMIT."""
    start = p
    name, p = word_hash(buf, p, stop)
    if name != _VELOCITY_LIMIT:
        return
    note = _put(notes, counts, record, start, stop, NOTE_LIMITS)
    while p < stop and buf[p] != SEMICOLON:
        if not is_letter(buf[p]):
            p += 1
            continue
        key, p = word_hash(buf, p, stop)
        if p < stop and buf[p] == EQUALS:
            value, p, found = parse_number(buf, p + 1, stop, np.int64(SPACED | CAPITAL))
            for k in range(len(_LIMIT_KEYS)):
                if found and key == _LIMIT_KEYS[k]:
                    note.values[k] = value
            if not found and key == _LIMIT_KEYS[1]:
                numbers.accel = 0.0
    if note.values[1] > 0.0:  # Klipper takes M204 S for the same
        numbers.accel, counts.tell = note.values[1], TELL_S


# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)


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
@inner(error_model="python", _nrt=True)
def _line(buf, p, stop, after, s, values, numbers, counts, records, n, notes):
    """Obey one line, buf[p:stop], statement by statement; return the next free record. s is scratch, a STATEMENT."""
    s.column = _column(buf, p, stop)
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
    if buf[p] == AT:
        what = host_event(buf, p, stop)
        if what != 0:
            begin_record(records[n], p, stop, after, numbers, counts, 0)
            records[n].words = 0
            event(records[n], counts, what)
            finish_record(records[n], numbers, counts)
            n += 1
        return n
    if s.column < counts.block:
        change_modes(counts)
        counts.block = 0
    s.flags = s.spaced = 0
    if upper(buf[p]) == LETTER_N and p + 1 < stop and is_digit(buf[p + 1]):
        p = _after_number(buf, p + 1, stop)
        s.flags = FLAG_NUMBERED
        counts.numbered += 1
    if p < stop and buf[p] == SLASH:  # a line that may be skipped: a block of its own
        counts.block -= 1 if counts.block <= 0 else 0
        n = _statements(buf, p + 1, stop, after, s, values, numbers, counts, records, n, notes)
        change_modes(counts)
        counts.block += 1 if counts.block < 0 else 0
        return n
    return _statements(buf, p, stop, after, s, values, numbers, counts, records, n, notes)


# Long because the statements of a line hand on what they share; its many parameters are the interpreter's state and
# arrays, and the line in hand.
@inner(error_model="python", _nrt=True)
def _statements(buf, p, stop, after, s, values, numbers, counts, records, n, notes):
    """Obey the statements of a line from p on; return the next free record."""
    curves = 0
    while p < stop:
        p = _after_conditions(buf, p, stop, counts)
        if p >= stop:
            break
        known, sure, unsure = counts.known, counts.offset_known, counts.unsure | counts.changed
        if known & sure & 3 == 3 and unsure & UNSURE_AHEAD == 0:
            counts.doubted = 0
        p = read_statement(buf, p, stop, s, values, numbers, counts)
        if s.spaced:
            s.flags |= FLAG_SPACED
        _doubt(s, values, counts)
        # F0 asks for no speed: firmwares keep the one that they have, or stop with an error.
        if s.letter in (LETTER_G, 0) and s.words & WORD_F & ~(s.bare | s.twice) and values[VALUE_F] == 0.0:
            s.words ^= WORD_F
        r = records[n]
        begin_record(r, s.start, p if s.again else stop, p if s.again else after, numbers, counts, s.flags)
        r.words = s.words
        if s.twice:
            r.flags = r.flags | FLAG_TWICE
        # Nobody knows what a firmware makes of these, or there is no room to write them again.
        doubtful = s.garbled or s.unclear & WORD_ITSELF or s.words & s.bare or s.twice & (WORDS_IJK | WORD_R)
        if doubtful or p - s.start > MAX_CODE_BYTES:
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
        lost = known & ~counts.known | sure & ~counts.offset_known | (counts.unsure | counts.changed) & ~unsure
        if lost and counts.doubted == 0:  # what becomes uncertain later may only follow from that
            counts.doubted = counts.line + 1
        if chords == 0 and r.kind != 0:
            finish_record(r, numbers, counts)
            n += 1
        if not s.again:
            break
        s.flags = s.flags & FLAG_NUMBERED | FLAG_MIXED
    return n


@inner
def _doubt(s, values, counts):
    """Take the words for unclear that say nothing certain: all of a statement that is garbled, or that may be skipped
    because it stands in a block; those whose mode is unknown; and those that come without a value, too."""
    known = s.words | s.bare
    if counts.block:
        s.unclear |= known | WORD_ITSELF
    elif s.garbled:
        s.unclear |= known
    elif counts.unsure:
        moves = s.letter == 0 or (s.letter == LETTER_G and (s.code <= LAST_MOVE or s.code in (50, 51)))
        s.unclear |= known & unsure_words(counts, s.letter, moves)
    for axis in range(3):  # of the others it is known where they seem to lead
        if s.unclear & (WORD_X << axis) and (s.garbled or not s.words & (WORD_X << axis)):
            values[VALUE_X + axis] = np.nan
    s.words &= ~s.unclear
    s.bare &= ~s.unclear


@inner
def _column(buf, p, stop):
    """Return the column of a line's first character that is not blank; a tabulator goes to the next multiple of 4."""
    column = 0
    while p < stop and is_blank(buf[p]):
        column = column // 4 * 4 + 4 if buf[p] == TAB else column + 1
        p += 1
    return column


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


@inner(error_model="python", _nrt=True)
def _obey(buf, stop, s, r, values, numbers, counts):
    """Do to the machine's state what a statement says, and note it in its record; return what event it is, or 0."""
    if s.letter == LETTER_G and s.code > LAST_MOVE:
        return g_command(r, numbers, counts, s.words, s.bare, s.unclear, values, s.code)
    if s.letter == LETTER_G or s.letter == 0:
        named = (s.words | s.unclear) & (WORDS_XYZ | WORD_E | WORD_F)
        if s.letter == LETTER_G:
            settle(counts, UNSURE_MOTION, counts.modal == s.code // 10)
            counts.modal = s.code // 10
        elif named and not (s.garbled or (1 << max(s.lead - LETTER_A, 0)) & _MODAL_LEADS):  # `O1 X5`: another command
            r.flags = r.flags | FLAG_OPAQUE
            return EVENT_UNKNOWN + ALL_LOST
        else:
            r.flags = r.flags | FLAG_MODAL
        if (counts.modal >= 0 or counts.unsure & UNSURE_MOTION) and (s.letter == LETTER_G or named):
            move(r, numbers, counts, s.words, s.unclear, values, counts.modal)
        return 0
    if s.letter == LETTER_M:
        return m_command(r, numbers, counts, s.words, s.bare, s.unclear, values, s.code)
    if s.letter == LETTER_T:
        same = s.code // 10 == counts.tool and (s.code < 0 or not counts.unsure & UNSURE_TOOL)
        return 0 if same else tool_change(numbers, counts, s.code // 10)
    if s.letter == EXTENDED:
        return long_command(r, buf, s.start, stop, s.column, numbers, counts)
    r.flags = r.flags | FLAG_OPAQUE
    if s.garbled and s.unclear & WORD_E and s.unclear & WORDS_XYZ:
        r.flags = r.flags | FLAG_EXTRUDING
    return lose_all(numbers, counts)


@entry(error_model="numpy")
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
