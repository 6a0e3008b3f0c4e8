# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)
"""Notes beside the records: what a text says of time, of the machine's limits, and of what lines are printed for.

None of it moves anything by itself. Slicers write `;TYPE:External perimeter`, `;TYPE:WALL-OUTER`,
`; FEATURE: Outer wall` or `; feature outer perimeter`.
"""

import numpy as np

from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.statement import EXTENDED
from printmend.gcode.kernels.text import *
from printmend.jit import inner

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
    if first not in (LETTER_T, LETTER_P, LETTER_B, LETTER_E, LETTER_M):
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
    if note.values[1] > 0.0:  # Klipper takes M204 S for the same
        numbers.accel, counts.tell = note.values[1], TELL_S
