"""The effect of each command on the machine's state: plain G-code, Klipper's long names, and curves as chords."""

import numpy as np

from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.text import *
from printmend.gcode.kernels.text import among
from printmend.jit import entry, inner

# Curves as chords: arcs, and G5, Marlin's cubic curve, as records of straight moves that any reader understands.
#
# A G5 goes from P0 to P3 by (1 − t)³ P0 + 3 (1 − t)² t P1 + 3 (1 − t) t² P2 + t³ P3, where I and J lead from P0 to P1,
# P and Q from P3 to P2; filament and height go with t (Marlin's `cubic_b_spline`).

# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)


# Its many parameters are the fields of a record's arc: a caller that has no record gives them as they are.
@entry(error_model="numpy", _nrt=False)
def arc_chords(x0, y0, z0, x1, y1, z1, c0, c1, plane, clockwise, turns, tolerance, points):
    """Return how many chords an arc needs; fill ``points`` [n, 3] with their ends if it has that length.

    The sagitta r(1 − cos(φ/2)) of each chord is at most ``tolerance`` [mm]. A slightly different end radius (rounded
    coordinates) is blended in linearly, as firmwares do; the last point is the end itself.
    """
    if plane == 0:
        a0, b0, a1, b1, h0, h1 = x0, y0, x1, y1, z0, z1
    elif plane == 1:
        a0, b0, a1, b1, h0, h1 = z0, x0, z1, x1, y0, y1
    else:
        a0, b0, a1, b1, h0, h1 = y0, z0, y1, z1, x0, x1
    radius0, radius1 = np.hypot(a0 - c0, b0 - c1), np.hypot(a1 - c0, b1 - c1)
    angle0 = np.arctan2(b0 - c1, a0 - c0)
    sweep = np.arctan2(b1 - c1, a1 - c0) - angle0
    if clockwise:
        while sweep >= -1e-9:
            sweep -= 2.0 * np.pi
        sweep -= 2.0 * np.pi * turns
    else:
        while sweep <= 1e-9:
            sweep += 2.0 * np.pi
        sweep += 2.0 * np.pi * turns
    widest = max(radius0, radius1)
    step = 2.0 * np.arccos(max(1.0 - tolerance / widest, 0.0)) if widest > 0.0 else np.pi
    count = int(max(min(np.ceil(abs(sweep) / max(step, 1e-4)), 1e6), 1.0))
    if len(points) != count:
        return count
    for i in range(count):
        part = (i + 1) / count
        angle = angle0 + sweep * part
        radius = radius0 + (radius1 - radius0) * part
        a, b, h = c0 + radius * np.cos(angle), c1 + radius * np.sin(angle), h0 + (h1 - h0) * part
        if i + 1 == count:
            a, b = a1, b1
        if plane == 0:
            points[i, 0], points[i, 1], points[i, 2] = a, b, h
        elif plane == 1:
            points[i, 2], points[i, 0], points[i, 1] = a, b, h
        else:
            points[i, 1], points[i, 2], points[i, 0] = a, b, h
    return count


CHORD_OFF_MM = 0.005  # how far a chord may be off the curve: half of the tolerance of mending
MOST_CHORDS = 1024  # of one curve: none that fits on a bed needs more
CURVES_A_LINE = 8  # that are cut into chords: further ones of the line stay as they are
_CONTROLS = WORD_I | WORD_J | WORD_P | WORD_Q


@inner
def most_records(buf, p, stop):
    """Return how many records the line buf[p:stop] may become: one for two bytes, and `MOST_CHORDS` for each curve.

    Every spelling of a number that is read as 5 (`G05`, `G+5.0`, `G4.96`) has 4 or 5 as its first digit other than 0. A
    comment holds no statements. After a remark or a quoted text, which may hold any character, everything is counted.
    """
    begin, found, inside = p, 0, False
    while p < stop:
        byte = buf[p]
        if byte == SEMICOLON and not inside:
            break
        p += 1
        if byte in (OPEN, QUOTE):
            inside = True
        elif upper(byte) == LETTER_G:
            while p < stop and buf[p] in (ZERO, PLUS, MINUS, POINT):
                p += 1
            found += p < stop and buf[p] in (FOUR, FIVE)
    return (p - begin) // 2 + 2 + MOST_CHORDS * min(found, CURVES_A_LINE)


@inner
def chords_of(r, s, values, numbers, counts):
    """Return into how many chords the curve of a statement has to be cut; 0 where its course is unknown.

    For a parameter step h a chord is off by |B″| h²/8 at most, and B″ is largest at an end of the curve.
    Where I and J, or P and Q, are missing, firmwares differ.
    """
    sure = r.flags & FLAG_KNOWN_X0 and r.flags & FLAG_KNOWN_Y0 and counts.known & 3 == 3 and counts.plane == 0
    if not sure or s.unclear or s.twice & _CONTROLS or r.flags & (FLAG_OPAQUE | FLAG_G53) or s.code != 50:
        return 0
    if not (s.words & (WORD_I | WORD_J) and s.words & (WORD_P | WORD_Q)):
        return 0
    x1, y1, x2, y2 = _controls(r, s, values, numbers, counts)
    begin = np.hypot(r.x0 - 2.0 * x1 + x2, r.y0 - 2.0 * y1 + y2)
    end = np.hypot(x1 - 2.0 * x2 + numbers.pos[0], y1 - 2.0 * y2 + numbers.pos[1])
    count = np.ceil(np.sqrt(6.0 * max(begin, end) / (8.0 * CHORD_OFF_MM)))
    stands = r.x0 == numbers.pos[0] and r.y0 == numbers.pos[1] and max(begin, end) == 0.0
    if not count <= MOST_CHORDS or stands:
        return 0
    return max(np.int64(count), 1)  # one: a straight line at an even pace


@inner
def _controls(r, s, values, numbers, counts):
    """Return the places of both control points (x1, y1, x2, y2) [mm]."""
    unit = 25.4 if counts.inch else 1.0
    i, j = values[VALUE_I] if s.words & WORD_I else 0.0, values[VALUE_J] if s.words & WORD_J else 0.0
    p, q = values[VALUE_P] if s.words & WORD_P else 0.0, values[VALUE_Q] if s.words & WORD_Q else 0.0
    return r.x0 + i * unit, r.y0 + j * unit, numbers.pos[0] + p * unit, numbers.pos[1] + q * unit


# Its many parameters are the state of the interpreter and the statement in hand.
@inner
def put_chords(records, n, s, values, numbers, counts, count):
    """Write the curve that record n begins as ``count`` straight moves; return the next free record.

    All but the last have no text of their own: they begin and end where the statement begins.
    """
    r = records[n]
    x0, y0, z0, e0 = r.x0, r.y0, r.z0, r.e0
    begin, end, after, flags = r.begin, r.end, r.next, (r.flags | FLAG_CURVE) & ~np.uint32(FLAG_EXTRUDING)
    x1, y1, x2, y2 = _controls(r, s, values, numbers, counts)
    x3, y3, z3, e3 = numbers.pos[0], numbers.pos[1], numbers.pos[2], numbers.e
    advance = (e3 - e0) * numbers.flow / (numbers.area if numbers.area > 0 else 1.0)
    known = flags & (FLAG_KNOWN_X0 | FLAG_KNOWN_Y0 | FLAG_KNOWN_Z0)
    numbers.pos[0], numbers.pos[1], numbers.pos[2], numbers.e = x0, y0, z0, e0
    for k in range(1, count + 1):
        r = records[n]
        own = k == count
        begin_record(r, begin, end if own else begin, after if own else begin, numbers, counts, flags)
        if k == 1:
            r.flags = r.flags & ~np.uint32(FLAG_KNOWN_Z0) | known
        t = k / count
        a, b, c, d = (1.0 - t) ** 3, 3.0 * (1.0 - t) ** 2 * t, 3.0 * (1.0 - t) * t * t, t**3
        numbers.pos[0] = x3 if own else a * x0 + b * x1 + c * x2 + d * x3
        numbers.pos[1] = y3 if own else a * y0 + b * y1 + c * y2 + d * y3
        numbers.pos[2] = z3 if own else z0 + t * (z3 - z0)
        numbers.e = e3 if own else e0 + t * (e3 - e0)
        r.kind, r.words, r.advance = KIND_LINEAR, s.words & ~np.int64(_CONTROLS), advance / count
        if r.advance > 0.0:
            r.flags = r.flags | FLAG_EXTRUDING
        finish_record(r, numbers, counts)
        n += 1
    return n


# Commands with long names: Klipper's state, offsets, objects and pauses; any other is a macro.

# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)


_SAVE, _RESTORE = name_hash("SAVE_GCODE_STATE"), name_hash("RESTORE_GCODE_STATE")
_OFFSET = name_hash("SET_GCODE_OFFSET")
_KEY_NAME, _KEY_MOVE, _DEFAULT = name_hash("NAME"), name_hash("MOVE"), name_hash("DEFAULT")
_KEY_AXIS = np.array([name_hash("X"), name_hash("Y"), name_hash("Z")])
_KEY_ADJUST = np.array([name_hash("X_ADJUST"), name_hash("Y_ADJUST"), name_hash("Z_ADJUST")])
_EXCLUDING = np.array(
    [name_hash(name) for name in ("EXCLUDE_OBJECT", "EXCLUDE_OBJECT_START", "EXCLUDE_OBJECT_END",
        "START_CURRENT_OBJECT", "END_CURRENT_OBJECT", "CANCEL_OBJECT")]
)  # fmt: skip
_PAUSING = np.array([name_hash(name) for name in ("PAUSE", "RESUME", "CANCEL_PRINT")])
# OctoPrint obeys these behind an @, and its plug-in for objects the last two; others it leaves alone.
_AT_PAUSING = np.array([name_hash(name) for name in ("PAUSE", "RESUME")])
_AT_EXCLUDING = np.array([name_hash(name) for name in ("OBJECT", "ENDOBJECT")])
_TOOLING = np.array([name_hash("ACTIVATE_EXTRUDER")])
_BLOCKS = np.array([name_hash(name) for name in ("IF", "ELIF", "ELSE", "WHILE")])  # RepRapFirmware's
_SKEWING = np.array([name_hash(name) for name in ("SKEW_PROFILE", "SET_SKEW")])
_KEY_SKEWED = np.array([name_hash(name) for name in ("LOAD", "XY", "XZ", "YZ")])
# Extended commands that neither move the carriage nor shift its coordinates.
_STILL = np.array(
    [name_hash(name) for name in (
        "SET_PRESSURE_ADVANCE", "SET_VELOCITY_LIMIT", "EXCLUDE_OBJECT_DEFINE", "DEFINE_OBJECT", "SET_FAN_SPEED",
        "SET_LED", "SET_PRINT_STATS_INFO", "SET_RETRACTION", "TEMPERATURE_WAIT", "SET_HEATER_TEMPERATURE", "RESPOND",
        "GET_POSITION", "SET_INPUT_SHAPER", "UPDATE_DELAYED_GCODE", "SET_GCODE_VARIABLE", "SAVE_VARIABLE",
        "SDCARD_LOOP_BEGIN", "SDCARD_LOOP_END", "SDCARD_LOOP_DESIST", "SET_PIN", "SET_TEMPERATURE_FAN_TARGET",
        "TURN_OFF_HEATERS", "SET_DISPLAY_TEXT", "QUERY_ENDSTOPS", "STATUS",
        "TIMELAPSE_RENDER", "SET_SERVO", "SET_FILAMENT_SENSOR", "M117", "EXCLUDE_OBJECT_RESET", "SET_TMC_CURRENT",
        "BED_MESH_PROFILE", "BED_MESH_CLEAR", "BED_MESH_OFFSET", "SET_IDLE_TIMEOUT",
        "SET_EXTRUDER_ROTATION_DISTANCE", "SYNC_EXTRUDER_MOTION", "TUNING_TOWER", "SET_FAN",
        "VAR", "GLOBAL", "SET", "ECHO", "BREAK", "CONTINUE", "SKIP", "ABORT",
    )]
)  # fmt: skip


# Long because the keys of three commands are read in one pass, and each command takes its own of them.
@inner(error_model="python", _nrt=True)
def long_command(r, buf, p, stop, column, numbers, counts):
    """Obey a long name: Klipper's state, offsets, objects, pauses, and the beginnings of RepRapFirmware's blocks.

    Any other is a macro. ``column`` is where it stands on its line. Return as `m_command`.
    """
    name, p = word_hash(buf, p, stop)
    if counts.flavour != FLAVOUR_KLIPPER and among(name, _BLOCKS):
        change_modes(counts)
        counts.block = counts.block if counts.block else column + 1
        return EVENT_MACRO
    if name != _SAVE and name != _RESTORE and name != _OFFSET:
        if among(name, _EXCLUDING):
            return EVENT_EXCLUDE
        elif among(name, _PAUSING):
            return EVENT_PAUSE
        elif among(name, _TOOLING):
            return EVENT_TOOL + ALL_LOST
        elif among(name, _SKEWING):
            while p < stop and not is_letter(buf[p]):
                p += 1
            return EVENT_GEOMETRY if among(word_hash(buf, p, stop)[0], _KEY_SKEWED) else 0
        elif not among(name, _STILL):
            return EVENT_MACRO + ALL_LOST
        return 0
    label, move, given, adjusted = _DEFAULT, False, 0, 0
    offsets = np.zeros(3)
    while p < stop and buf[p] != SEMICOLON:
        if not is_letter(buf[p]):
            p += 1
            continue
        key, p = word_hash(buf, p, stop)
        if p >= stop or buf[p] != EQUALS:
            continue
        if key == _KEY_NAME:
            label, p = word_hash(buf, p + 1, stop)
            continue
        value, p, found = parse_number(buf, p + 1, stop, np.int64(SPACED | CAPITAL))
        move = move or (key == _KEY_MOVE and value == 1)
        whole = p >= stop or is_blank(buf[p]) or buf[p] == SEMICOLON or buf[p] == STAR
        value = value if found and whole and counts.block == 0 else np.nan
        for axis in range(3):
            if key == _KEY_AXIS[axis]:
                offsets[axis], given = value, given | 1 << axis
            elif key == _KEY_ADJUST[axis]:
                offsets[axis], adjusted = value, adjusted | 1 << axis
    if name == _SAVE:
        r.axes = _save(numbers, counts, np.int64(label))
        return EVENT_SAVE
    r.flags = r.flags | FLAG_OPAQUE
    r.axes = NO_SLOT
    what = EVENT_RESTORE if move else EVENT_OFFSET
    if name == _RESTORE:
        slot = _restore(numbers, counts, np.int64(label), move) if counts.block == 0 else -1
        if slot < 0:
            lose_shifts(numbers, counts)
            counts.unsure |= UNSURE_SAVED
            numbers.feed = 0.0
            return what + ALL_LOST
        r.axes = slot
        return what
    for axis in range(3):
        old = numbers.gcode_offset[axis]
        if given & (1 << axis):
            numbers.gcode_offset[axis] = offsets[axis]
        elif adjusted & (1 << axis):
            numbers.gcode_offset[axis] += offsets[axis]
        if move and np.isnan(numbers.gcode_offset[axis] - old):
            what += _LOST << axis
        elif move:
            numbers.pos[axis] += numbers.gcode_offset[axis] - old
    return what


@inner
def host_event(buf, p, stop):
    """Return what event a line with an @ at p is to a host, or 0."""
    name, _ = word_hash(buf, p + 1, stop)
    if among(name, _AT_PAUSING):
        return EVENT_PAUSE
    return EVENT_EXCLUDE if among(name, _AT_EXCLUDING) else 0


@inner
def lose_shifts(numbers, counts):
    """Note that the shifts of all axes are unknown; of G92's a guess stays."""
    counts.zero_known = 0
    for axis in range(3):
        numbers.gcode_offset[axis] = np.nan


@inner
def _save(numbers, counts, key):
    """SAVE_GCODE_STATE: into the slot of that name's key, a free one, or the first. Return which."""
    slot = 0
    for k in range(SAVED_SLOTS - 1, -1, -1):
        if counts.saved[k].key == 0:
            slot = k
    for k in range(SAVED_SLOTS):
        if counts.saved[k].key == key:
            slot = k
    c, f = counts.saved[slot], numbers.saved[slot]
    c.key, c.relative, c.m83 = key, counts.relative, counts.m83
    c.known, c.zero_known, c.unsure = counts.known, counts.zero_known, counts.unsure
    for axis in range(3):
        f.pos[axis] = numbers.pos[axis]
        f.g92[axis] = numbers.g92[axis]
        f.gcode_offset[axis] = numbers.gcode_offset[axis]
    f.e, f.feed, f.flow = numbers.e, numbers.feed, numbers.flow
    return slot


@inner
def _restore(numbers, counts, key, move):
    """RESTORE_GCODE_STATE; return the slot, −1 when nothing was saved under that name's key."""
    for slot in range(SAVED_SLOTS):
        c, f = counts.saved[slot], numbers.saved[slot]
        if c.key == key:
            counts.relative, counts.m83, counts.zero_known = c.relative, c.m83, c.zero_known
            counts.unsure = counts.unsure & ~UNSURE_SAVED | c.unsure & UNSURE_SAVED
            for axis in range(3):
                numbers.g92[axis] = f.g92[axis]
                numbers.gcode_offset[axis] = f.gcode_offset[axis]
                if move:
                    numbers.pos[axis] = f.pos[axis]
            if move:
                counts.known = c.known
            numbers.e, numbers.feed, numbers.flow = f.e, f.feed, f.flow
            return slot
    return -1


@inner
def _pull(numbers, counts):
    """M121: the modes and the feed are again those of the last M120. Firmwares other than RepRapFirmware may ignore it:
    there, and where it may be skipped, what it would change is unknown."""
    counts.pushed -= 1
    sure = counts.flavour == FLAVOUR_RRF and counts.block == 0
    for slot in range(SAVED_SLOTS):
        c, f = counts.saved[slot], numbers.saved[slot]
        if c.key != -1 - counts.pushed:
            continue
        c.key = 0
        if sure:
            counts.unsure = counts.unsure & ~UNSURE_PUSHED | c.unsure & UNSURE_PUSHED
            counts.relative, counts.m83, numbers.feed = c.relative, c.m83, f.feed
            return
        counts.unsure |= c.unsure & UNSURE_PUSHED
        if counts.relative != c.relative:
            counts.unsure |= UNSURE_AXES
        if counts.m83 != c.m83:
            counts.unsure |= UNSURE_E_MODE
        if numbers.feed != f.feed:
            counts.unsure |= UNSURE_FEED
            numbers.feed = 0.0


# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)


@inner
def add_offsets(numbers, counts):
    """Sum the work, G92, gcode, home and tool offsets of each axis: machine − logical [mm]. An unknown sum stays."""
    tool = counts.tool
    sure = counts.zero_known
    for axis in range(3):
        tools = numbers.tools[tool, axis] if 0 <= tool < TOOLS else 0.0
        work = numbers.work[counts.wcs, axis]
        shift = numbers.g92[axis] + numbers.gcode_offset[axis] - numbers.m206[axis]
        total = work + shift - tools
        if not np.isnan(total):
            numbers.offset[axis] = total
        unsure = counts.unsure & UNSURE_WORK != 0 and _is_shifted(numbers.work, axis)
        unsure = unsure or (counts.unsure & UNSURE_TOOL != 0 and _is_shifted(numbers.tools, axis))
        if np.isnan(total) or unsure:
            sure &= ~(1 << axis)
    counts.offset_known = sure


@inner
def _is_shifted(offsets, axis):
    """Say whether any tool, or any coordinate system, has an offset along an axis."""
    for row in range(len(offsets)):  # noqa: SIM110 (numba compiles the loop, not the generator)
        if offsets[row, axis] != 0.0:
            return True
    return False


@inner
def settle(counts, mode, same):
    """Note that a command sets a mode, to what it is if ``same``. In a block, which may be skipped, note only whether
    it is now another than before: of more than two, that it was changed."""
    if counts.block == 0:
        counts.unsure &= ~mode
    elif not same:
        counts.changed = counts.changed ^ mode if mode & UNSURE_OF_TWO else counts.changed | mode


@inner
def change_modes(counts):
    """End a part of a block that is skipped or obeyed as a whole: a mode that is another after it is unknown, and
    guessed to be what it was before: only then can the file print right without the block."""
    if counts.changed & UNSURE_AXES:
        counts.relative = 1 - counts.relative
    if counts.changed & UNSURE_E_MODE:
        counts.m83 = 1 - counts.m83
    if counts.changed & UNSURE_UNIT:
        counts.inch = 1 - counts.inch
    counts.unsure |= counts.changed
    counts.changed = 0


@inner
def unsure_words(counts, letter, moves):
    """Return the words whose meaning is unknown, for a statement with a command's letter that ``moves`` or does not."""
    words = WORDS_ALL if letter == 0 and counts.unsure & UNSURE_MOTION else 0
    if counts.unsure & UNSURE_UNIT:
        words |= WORDS_MOVING | WORDS_IJK | WORD_R
    if not moves:
        return words
    if counts.unsure & UNSURE_AXES:
        words |= WORDS_XYZ | (WORD_E if counts.rule == E_EITHER else 0)
    if counts.unsure & UNSURE_E_MODE:
        words |= WORD_E
    if counts.unsure & UNSURE_CENTRE:
        words |= WORDS_IJK
    if counts.unsure & UNSURE_PLANE:
        words |= WORDS_IJK | WORD_R
    return words


@inner
def lose_all(numbers, counts):
    """Note that a command may have done anything but change the unit or the plane, which nobody does in the middle of a
    print, or set Klipper's offset, if the file sets none; return what `event` is to note."""
    counts.zero_known = 0
    for axis in range(3):
        if numbers.gcode_offset[axis] != 0.0:
            numbers.gcode_offset[axis] = np.nan
    counts.unsure |= UNSURE_SAVED | UNSURE_MOTION | UNSURE_WORK | UNSURE_TOOL
    numbers.feed = 0.0
    return EVENT_PLACEHOLDER + ALL_LOST


@inner
def e_is_relative(counts):
    """Say whether E words are increments."""
    if counts.rule == E_EITHER:
        return counts.m83 != 0 or counts.relative != 0
    return counts.m83 != 0


@inner
def begin_record(r, begin, end, after, numbers, counts, flags):
    """Fill a record with the state as it is before the statement."""
    r.begin, r.end, r.next, r.line = begin, end, after, counts.line
    r.x0, r.y0, r.z0, r.e0 = numbers.pos[0], numbers.pos[1], numbers.pos[2], numbers.e
    r.c0 = r.c1 = np.nan
    r.advance, r.accel = 0.0, numbers.accel
    if counts.relative:
        flags |= FLAG_RELATIVE
    if e_is_relative(counts):
        flags |= FLAG_E_RELATIVE
    if counts.inch:
        flags |= FLAG_INCH
    if counts.arc_absolute:
        flags |= FLAG_ARC_ABSOLUTE
    if counts.e_is_a:
        flags |= FLAG_E_IS_A
    r.flags = flags | counts.known * FLAG_KNOWN_X0 | counts.role << ROLE_SHIFT | counts.tell << TELL_SHIFT
    r.layer, r.turns, r.plane = counts.layer, 0, counts.plane
    r.kind, r.event, r.axes = 0, 0, NO_SLOT


@inner
def finish_record(r, numbers, counts):
    """Close a record with the place, E, feed, offsets and certainty after the statement."""
    r.x1, r.y1, r.z1 = numbers.pos[0], numbers.pos[1], numbers.pos[2]
    r.e1, r.feed = numbers.e, numbers.feed
    r.ox, r.oy, r.oz = numbers.offset[0], numbers.offset[1], numbers.offset[2]
    r.doubted = counts.doubted
    r.flags = r.flags | counts.known * FLAG_KNOWN_X1


# The higher byte of an event holds the axes (bits) whose place is uncertain afterwards.
_LOST = 256
ALL_LOST = 7 * _LOST


@inner
def event(r, counts, what):
    """Note why the place (the axes in the higher byte of ``what``) or the engaged side of the belts is uncertain."""
    r.kind, r.event = KIND_EVENT, what % _LOST
    counts.known &= ~(what // _LOST) & 7


@inner
def _goto(numbers, counts, words, unclear, values, unit, g53):
    """Move the state's place by the X Y Z words; an axis named with an unclear value is lost: where it seems to go, if
    it has one (else NaN), is a guess."""
    for axis in range(3):
        bit = WORD_X << axis
        value = values[VALUE_X + axis] * unit
        if (words | unclear) & bit and not np.isnan(value):
            if g53:
                numbers.pos[axis] = value
            elif counts.relative:
                numbers.pos[axis] += value
            else:
                numbers.pos[axis] = value + numbers.offset[axis]
        if unclear & bit:
            counts.known &= ~(1 << axis)
        elif words & bit and g53:
            counts.known |= 1 << axis
        elif words & bit and not counts.relative:
            counts.known = counts.known & ~(1 << axis) | counts.offset_known & 1 << axis


@inner
def _set_feed(numbers, counts, words, unclear, values, unit):
    """Set the speed by an F word. A move at an unknown one cannot be written again: return whether it is known."""
    if words & WORD_F:
        numbers.feed = abs(values[VALUE_F]) * unit
        counts.unsure &= ~UNSURE_FEED
    elif unclear & WORD_F:
        numbers.feed = 0.0
        counts.unsure |= UNSURE_FEED
    return counts.unsure & UNSURE_FEED == 0


@inner
def _set_e(r, numbers, counts, words, unclear, values, unit):
    """Move E by its word; return whether it is known how far: an absolute number after an unknown one does not say."""
    if unclear & WORD_E:
        counts.unsure |= UNSURE_E
        return False
    if not words & WORD_E:
        return True
    value = values[VALUE_E] * unit
    sure = True
    if e_is_relative(counts):
        numbers.e = r.e0 + value
    else:
        numbers.e = value
        sure = counts.unsure & UNSURE_E == 0
        counts.unsure &= ~UNSURE_E
    return sure


@inner
def move(r, numbers, counts, words, unclear, values, motion):
    """G0 G1 G2 G3: the state moves on; the record learns the rest in `_close_move`."""
    unit = 25.4 if counts.inch else 1.0
    if motion == 0:
        r.flags = r.flags | FLAG_RAPID
    r.kind = KIND_LINEAR if motion < 2 else (KIND_CW if motion == 2 else KIND_CCW)
    _goto(numbers, counts, words, unclear, values, unit, np.int64(r.flags & FLAG_G53))
    paced = _set_feed(numbers, counts, words, unclear, values, unit)
    measured = _set_e(r, numbers, counts, words, unclear, values, unit)
    if measured and words & WORD_E:
        advance = (numbers.e - r.e0) * numbers.flow
        r.advance = advance / numbers.area if numbers.area > 0 else advance
    moves = r.x0 != numbers.pos[0] or r.y0 != numbers.pos[1] or r.z0 != numbers.pos[2]
    moves = moves or unclear & WORDS_XYZ != 0
    if motion >= 2:
        _centre(r, numbers, counts, words, values, unit, motion)
        moves = True
        if words & WORD_P and 1 <= values[VALUE_P] < 1000:  # Marlin counts the full circles, others all turns
            further = counts.flavour in (FLAVOUR_MARLIN1, FLAVOUR_MARLIN2, FLAVOUR_PRUSA)
            r.turns = np.int64(values[VALUE_P]) - (0 if further else 1)
    if moves and (r.advance > 0 or not measured):
        r.flags = r.flags | FLAG_EXTRUDING
    if not (paced and measured):
        r.flags = r.flags | FLAG_OPAQUE
    if words & WORD_H and values[VALUE_H] > 0:  # RRF: towards an end stop, or of one motor
        r.flags = r.flags | FLAG_OPAQUE
        r.kind, r.event = KIND_EVENT, EVENT_UNKNOWN
        counts.known &= ~(words >> VALUE_X) & 7
    if motion < 2 and words & WORD_R and counts.flavour in (FLAVOUR_UNKNOWN, FLAVOUR_RRF):
        r.flags = r.flags | FLAG_OPAQUE  # RRF: from a stored place
        r.kind, r.event = KIND_EVENT, EVENT_UNKNOWN
        counts.known &= ~(words >> VALUE_X) & 7
    if unclear:
        r.flags = r.flags | FLAG_OPAQUE
        if unclear & (WORDS_XYZ | WORDS_IJK | WORD_R):
            r.kind, r.event = KIND_EVENT, EVENT_PLACEHOLDER


@inner
def _centre(r, numbers, counts, words, values, unit, motion):
    """Find an arc's centre from I J K or from R; an arc without one becomes an unknown event."""
    a = (0, 2, 1)[counts.plane]
    b = (1, 0, 2)[counts.plane]
    first = r.x0 if a == 0 else (r.z0 if a == 2 else r.y0)
    second = r.y0 if b == 1 else (r.x0 if b == 0 else r.z0)
    bit_a, bit_b = WORD_I << a, WORD_I << b
    if words & (bit_a | bit_b):
        if counts.arc_absolute:
            r.c0 = values[VALUE_I + a] * unit + numbers.offset[a] if words & bit_a else first
            r.c1 = values[VALUE_I + b] * unit + numbers.offset[b] if words & bit_b else second
        else:
            r.c0 = first + (values[VALUE_I + a] * unit if words & bit_a else 0.0)
            r.c1 = second + (values[VALUE_I + b] * unit if words & bit_b else 0.0)
        if r.c0 != first or r.c1 != second:
            return
    elif words & WORD_R:
        # The centre lies on the chord's bisector, at h from its middle: (2h/d)² = (4r² − d²)/d².
        radius = values[VALUE_R] * unit
        x, y = numbers.pos[a] - first, numbers.pos[b] - second
        square = x * x + y * y
        if square > 0 and radius != 0:
            ratio = -np.sqrt(max(4.0 * radius * radius - square, 0.0) / square)
            if motion == 3:
                ratio = -ratio
            if radius < 0:
                ratio = -ratio
            r.c0 = first + 0.5 * (x - y * ratio)
            r.c1 = second + 0.5 * (y + x * ratio)
            return
    r.c0 = r.c1 = np.nan
    r.kind, r.event = KIND_EVENT, EVENT_UNKNOWN


@inner
def _home(r, numbers, counts, axes):
    """G28: the named axes are at home; their shifts are forgotten."""
    r.kind, r.axes = KIND_HOME, axes
    for axis in range(3):
        if axes & (1 << axis):
            numbers.pos[axis] = numbers.home[axis]
            numbers.g92[axis] = 0.0
            counts.known |= 1 << axis
            counts.zero_known |= 1 << axis


@inner
def _set_position(r, numbers, counts, words, unclear, values, code):
    """G92: the place stays, its coordinates change. Bare, Klipper sets all to zero; Marlin and RRF do nothing."""
    unit = 25.4 if counts.inch else 1.0
    bare = ((words | unclear) & (WORDS_XYZ | WORD_E)) == 0 and code == 920
    zero = bare and counts.flavour in (FLAVOUR_UNKNOWN, FLAVOUR_KLIPPER)
    if unclear & WORD_ITSELF and (zero or code != 920):
        unclear |= WORDS_XYZ | WORD_E
    r.kind = KIND_SET
    axes = 0
    for axis in range(3):
        if unclear & (WORD_X << axis):
            counts.zero_known &= ~(1 << axis)
        elif code != 920:  # G92.1, G92.2: LinuxCNC forgets the shift
            numbers.g92[axis] = 0.0
            counts.zero_known |= 1 << axis
            axes |= 16 | 1 << axis
        elif zero or words & (WORD_X << axis):
            value = 0.0 if zero else values[VALUE_X + axis] * unit
            numbers.g92[axis] += numbers.pos[axis] - value - numbers.offset[axis]
            axes |= 1 << axis
            if not counts.known & (1 << axis):
                counts.zero_known &= ~(1 << axis)
    if unclear & WORD_E:
        counts.unsure |= UNSURE_E
    elif zero or (words & WORD_E and code == 920):
        numbers.e = 0.0 if zero else values[VALUE_E] * unit
        counts.unsure &= ~UNSURE_E
        axes |= 8
    r.axes = axes


@inner
def set_mode(numbers, counts, code):
    """Obey a G word that only sets a mode; False if it is another kind. Codes are tenths: G92.1 is 921."""
    if code == 900 or code == 910:
        on = np.int64(code == 910)
        settle(counts, UNSURE_AXES, counts.relative == on)
        counts.relative = on
        if counts.rule == E_FOLLOWS:
            set_e_mode(counts, on)
    elif code == 200 or code == 210:
        on = np.int64(code == 200)
        settle(counts, UNSURE_UNIT, counts.inch == on)
        counts.inch = on
    elif 170 <= code <= 190 and code % 10 == 0:
        plane = np.int64(code // 10 - 17)
        settle(counts, UNSURE_PLANE, counts.plane == plane)
        counts.plane = plane
    elif code == 901 or code == 911:
        on = np.int64(code == 901)
        settle(counts, UNSURE_CENTRE, counts.arc_absolute == on)
        counts.arc_absolute = on
    elif (540 <= code <= 590 and code % 10 == 0) or 591 <= code <= 593:
        wcs = np.int64(code - 585 if code > 590 else code // 10 - 54)
        settle(counts, UNSURE_WORK, counts.wcs == wcs)
        counts.wcs = wcs
        add_offsets(numbers, counts)
    elif not (code == 400 or code == 490 or code == 640 or 930 <= code <= 990 or code == 90):
        return False
    return True


@inner
def set_e_mode(counts, on):
    """M82 or M83: E words are coordinates or increments."""
    settle(counts, UNSURE_E_MODE, counts.m83 == on)
    counts.m83 = on


@inner
def g_command(r, numbers, counts, words, bare, unclear, values, code):
    """Obey a G command other than G0–G3; return what it makes uncertain, for `event`, or 0."""
    if code == 280:
        axes = ((words | bare) >> VALUE_X) & 7
        flavour = counts.flavour
        if unclear:  # which axes it homes is unknown
            for axis in range(3):
                if numbers.g92[axis] != 0.0:
                    counts.zero_known &= ~(1 << axis)
            return EVENT_PROBE + ALL_LOST
        if (words | bare) & WORD_O and flavour != FLAVOUR_KLIPPER and flavour != FLAVOUR_RRF:
            # Marlin then homes only axes with an unknown place, and leaves the others.
            return 0 if counts.known == 7 and flavour != FLAVOUR_UNKNOWN else EVENT_PROBE + ALL_LOST
        _home(r, numbers, counts, axes if axes else 7)
    elif code == 920 or code == 921 or code == 922:
        _set_position(r, numbers, counts, words, unclear | bare, values, code)
        if unclear & WORD_ITSELF:
            return EVENT_OFFSET
    elif code == 100 or code == 110:
        return _g10(r, numbers, counts, words, unclear | bare, values, code)
    elif code == 923:  # LinuxCNC remembers a shift that may be another file's
        counts.zero_known = 0
        return EVENT_OFFSET + ALL_LOST
    elif code == 40 or code == 430 or (code == 290 and words & WORD_S):
        pass  # dwell, tool length from the table, RRF's `G29 S1` (load a map)
    elif code == 610:  # back to a stored place, or LinuxCNC's exact path
        if (words | bare) & ~np.int64(WORD_G) or counts.flavour in (FLAVOUR_MARLIN2, FLAVOUR_RRF):
            return EVENT_UNKNOWN + ALL_LOST
    elif code in (600, 281, 301, 291, 292, 294, 220, 230):
        pass  # stored places; Bambu's and Marlin's switches
    elif code in (290, 300, 320, 330, 340, 800) or 380 <= code <= 385:
        if code == 800:
            counts.modal = -1
        return EVENT_PROBE + ALL_LOST
    elif code == 50 or code == 51:  # splines end where they say
        unit = 25.4 if counts.inch else 1.0
        _goto(numbers, counts, words, unclear, values, unit, np.int64(0))
        paced = _set_feed(numbers, counts, words, unclear, values, unit)
        measured = _set_e(r, numbers, counts, words, unclear, values, unit)
        if not (paced and measured):
            r.flags = r.flags | FLAG_OPAQUE
        return EVENT_SPLINE
    elif code == 510 or code == 680:  # scaled or turned from here on
        return EVENT_GEOMETRY
    else:
        r.flags = r.flags | FLAG_OPAQUE
        return EVENT_UNKNOWN + ALL_LOST
    return 0


@inner
def _lose_offsets(offsets, row, axis):
    """Note that an offset along an axis is unknown, of one row, or below 0 of all."""
    for k in range(len(offsets)):
        if row < 0 or k == row:
            offsets[k, axis] = np.nan


@inner
def _g10(r, numbers, counts, words, unclear, values, code):
    """G10/G11: firmware retraction; with L or P and axes, work offsets (LinuxCNC) or tool offsets (RRF)."""
    has_p, has_l = words & WORD_P, words & WORD_L
    if not has_p and not has_l and not unclear & (WORD_P | WORD_L):
        r.kind, r.axes = KIND_RETRACT, code == 100
        return 0
    if not (words | unclear) & WORDS_XYZ:
        return 0
    if unclear & (WORD_P | WORD_L):  # of any tool, or any system
        unclear |= words
    unit = 25.4 if counts.inch else 1.0
    index = np.int64(min(max(values[VALUE_P], -1.0), 99.0)) if has_p else -1
    level = np.int64(min(max(values[VALUE_L], 0.0), 99.0)) if has_l else 0
    work = counts.wcs if index <= 0 else index - 1
    for axis in range(3):
        if unclear & (WORD_X << axis):
            if unclear & WORD_L or level == 2 or level == 20:
                _lose_offsets(numbers.work, -1 if unclear & (WORD_P | WORD_L) else work, axis)
            if unclear & WORD_L or not has_l:
                _lose_offsets(numbers.tools, -1 if unclear & (WORD_P | WORD_L) else index, axis)
        elif words & (WORD_X << axis):
            value = values[VALUE_X + axis] * unit
            if level == 2 or level == 20:
                if 0 <= work < WORK_OFFSETS:
                    if level == 20:  # the value is that of the place
                        value = numbers.pos[axis] - value - (numbers.offset[axis] - numbers.work[counts.wcs, axis])
                        value = value if counts.known & (1 << axis) else np.nan
                    numbers.work[work, axis] = value
            elif 0 <= index < TOOLS:
                numbers.tools[index, axis] = value
    return EVENT_ZERO if level == 20 else EVENT_OFFSET


@inner
def tool_change(numbers, counts, tool):
    """Obey T: its macro is taken to leave the head where the file thinks it is.

    Otherwise every extruding line after it would be lost. In increments, or if the tools' offsets differ, the place is
    unknown. A file's first T0 names the tool at hand. Below 0 the tool is one that the file does not name.
    """
    old = counts.tool
    same = counts.relative == 0 or (old < 0 and tool == 0)
    unsure = tool < 0 or counts.block != 0 or counts.unsure & UNSURE_TOOL != 0
    for axis in range(3):
        before = numbers.tools[old, axis] if 0 <= old < TOOLS else 0.0
        after = numbers.tools[tool, axis] if 0 <= tool < TOOLS else 0.0
        same = same and before == after and not (unsure and _is_shifted(numbers.tools, axis))
    if tool < 0:
        counts.unsure |= UNSURE_TOOL
    else:
        settle(counts, UNSURE_TOOL, old == tool)
    counts.tool = tool
    return EVENT_TOOL if same else EVENT_TOOL + ALL_LOST


# M commands in tenths. The place is kept by the first three groups and lost by the last two.
_M_GEOMETRY = np.array([920, 4250, 5560, 5790, 8520])  # from here on the firmware changes commanded positions
_M_PAUSE = np.array([0, 10, 250, 600, 1250, 2260, 6000, 6010, 6020])  # the head parks and comes back
_M_EXCLUDE = np.array([4860, 6240, 6250])  # what follows may be skipped
_M_TOOL = np.array([60, 6200, 6210, 7010, 7020, 7030])  # tools, and filament that is changed
_M_MACRO = np.array([240, 320, 480, 980, 4280, 6050, 6220, 6230, 8080, 9700, 9703, 9710])  # the firmware's own


@inner
def m_command(r, numbers, counts, words, bare, unclear, values, code):
    """Obey an M command (in tenths); return what it makes uncertain, for `event`, or 0."""
    if code == 820 or code == 830:
        set_e_mode(counts, np.int64(code == 830))
    elif code == 1200:
        counts.pushed += 1
        r.axes = _save(numbers, counts, -counts.pushed)
        return EVENT_SAVE
    elif code == 1210 and counts.pushed > 0:
        _pull(numbers, counts)
        return EVENT_OFFSET
    elif code == 2210:
        if words & WORD_S:
            numbers.flow = values[VALUE_S] / 100.0
    elif code == 2000:
        if words & WORD_D:
            numbers.area = np.pi * values[VALUE_D] * values[VALUE_D] / 4.0
        if words & WORD_S and values[VALUE_S] == 0:
            numbers.area = 0.0
    elif code == 2180 or code == 2060:
        tool = np.int64(min(max(values[VALUE_T], -1.0), 99.0)) if words & WORD_T else counts.tool
        unclear |= bare
        any_tool = unclear & WORD_T != 0 or (words & WORD_T == 0 and counts.unsure & UNSURE_TOOL != 0)
        for axis in range(3):
            named = (words | unclear) & (WORD_X << axis)
            if named and code == 2180 and (any_tool or unclear & named):
                _lose_offsets(numbers.tools, -1 if any_tool else tool, axis)
            elif unclear & (WORD_X << axis):
                numbers.m206[axis] = np.nan
            elif named:
                value = values[VALUE_X + axis] * (25.4 if counts.inch else 1.0)
                if code == 2060:
                    numbers.m206[axis] = value
                elif 0 < tool < TOOLS:
                    numbers.tools[tool, axis] = value
        if (words | unclear) & WORDS_XYZ:
            return EVENT_OFFSET
    elif code == 180 or code == 840:
        named = words | bare | unclear
        axes = (named >> VALUE_X) & 7
        if words & WORD_S == 0 and (axes or named & WORD_E == 0):
            return EVENT_MOTORS_OFF + (axes if axes else 7) * _LOST
    elif among(code, _M_GEOMETRY):
        if (words | unclear) & (WORDS_XYZ | WORD_S | WORDS_IJK):
            return EVENT_GEOMETRY
    elif among(code, _M_PAUSE):
        return EVENT_PAUSE
    elif among(code, _M_EXCLUDE):
        return EVENT_EXCLUDE
    elif among(code, _M_TOOL):
        return EVENT_TOOL + ALL_LOST
    elif among(code, _M_MACRO):
        return EVENT_MACRO + ALL_LOST
    return 0
