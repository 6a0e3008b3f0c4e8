"""Compiled interpreter of G-code text: bytes in, one record for each statement that matters to motion out.

A *statement* is one command with its words: usually a line, but `G91 G1 X5` holds two, and each has its own span.
`interpret` keeps the whole modal state of a machine (`numbers`, `counts`) between calls, so a file of any length
passes through in chunks of whole lines. Imports numpy and numba only; the state's layout is the constants below.

Every statement that can move the carriage, shift its coordinates or make its place uncertain becomes a record
(`RECORD`); everything else (comments, temperatures, fans, unknown text) has none and is copied as it is.
"""

import numpy as np
from numba import njit

# One record. Positions are machine millimetres: G90/G91, G20/G21, G92, G54–G59, tool and gcode offsets are resolved.
RECORD = np.dtype(
    [
        ("begin", "i8"),  # statement's first byte in the chunk, after any N word
        ("end", "i8"),  # its end, comment included, line end excluded
        (
            "next",
            "i8",
        ),  # start of what follows; buf[end:next] is the line end, empty within a line or at the file's end
        ("line", "i8"),  # line in the file, from 0
        ("x0", "f8"),  # place before [mm]
        ("y0", "f8"),
        ("z0", "f8"),
        ("x1", "f8"),  # place after [mm]
        ("y1", "f8"),
        ("z1", "f8"),
        ("c0", "f8"),  # arc centre in its plane [mm]: (x, y) for G17, (z, x) for G18, (y, z) for G19; NaN for straight
        ("c1", "f8"),
        ("e0", "f8"),  # logical E before [mm, or mm³ after M200]
        ("e1", "f8"),  # logical E after
        ("advance", "f8"),  # filament advance [mm]: (e1 − e0) × M221 ÷ filament area of M200
        ("feed", "f8"),  # modal F after this statement [mm/min], 0 before the first F
        ("ox", "f8"),  # machine = logical × unit + offset [mm]
        ("oy", "f8"),
        ("oz", "f8"),
        ("words", "u4"),  # words with a value: bit 0 is A … bit 25 is Z
        ("flags", "u4"),  # FLAG_*
        ("layer", "i4"),  # layer comments seen so far
        ("turns", "i4"),  # further full circles of an arc (P word)
        ("kind", "u1"),  # KIND_*
        ("event", "u1"),  # EVENT_*, 0 unless kind is KIND_EVENT, KIND_HOME or KIND_RETRACT
        ("plane", "u1"),  # 0 XY, 1 ZX, 2 YZ
        ("axes", "u1"),  # axes homed or set: bit 0 X, 1 Y, 2 Z, 3 E
    ]
)

KIND_LINEAR, KIND_CW, KIND_CCW, KIND_HOME, KIND_SET, KIND_RETRACT, KIND_EVENT = 1, 2, 3, 4, 5, 6, 7

# Why the place or the engaged side of the belts is uncertain after an event.
EVENT_MACRO = 1  # a command that the firmware expands: it may have moved anywhere
EVENT_PAUSE = 2  # M0, M25, M600, PAUSE: the head parks and comes back
EVENT_TOOL = 3  # T, M6, ACTIVATE_EXTRUDER
EVENT_EXCLUDE = 4  # EXCLUDE_OBJECT, M486: what follows may be skipped while printing
EVENT_PROBE = 5  # G29, G30, G80: probing moves
EVENT_UNKNOWN = 6  # a motion command that is not followed: G5, G12, G27, canned cycles
EVENT_PLACEHOLDER = 7  # {…} or […] that someone else fills in
EVENT_MOTORS_OFF = 8  # M84
EVENT_RESTORE = 9  # RESTORE_GCODE_STATE MOVE=1
EVENT_OFFSET = 10  # offsets changed; the carriage has not moved

FLAG_RELATIVE = 1 << 0  # X Y Z words are increments
FLAG_E_RELATIVE = 1 << 1
FLAG_INCH = 1 << 2
FLAG_EXTRUDING = 1 << 3  # filament advances while the carriage moves
FLAG_KNOWN_X0, FLAG_KNOWN_Y0, FLAG_KNOWN_Z0 = 1 << 4, 1 << 5, 1 << 6  # the place before is certain
FLAG_KNOWN_X1, FLAG_KNOWN_Y1, FLAG_KNOWN_Z1 = 1 << 7, 1 << 8, 1 << 9
FLAG_MODAL = 1 << 10  # no G word: the motion mode of an earlier line
FLAG_RAPID = 1 << 11  # G0
FLAG_MIXED = 1 << 12  # other commands stand before this one on its line
FLAG_NUMBERED = 1 << 13  # the line has an N word
FLAG_CHECKSUM = 1 << 14  # the line ends in *checksum
FLAG_G53 = 1 << 15  # machine coordinates
FLAG_LOWER = 1 << 16  # the command letter is lower case
FLAG_EXPONENT = 1 << 17  # a number is written with an exponent
FLAG_OPAQUE = 1 << 18  # not every word is a plain number: do not write this statement again
FLAG_SPACED = 1 << 19  # words are separated by blanks

# What the firmware is: the cases in which firmwares differ.
FLAVOUR_UNKNOWN, FLAVOUR_MARLIN2, FLAVOUR_MARLIN1, FLAVOUR_KLIPPER, FLAVOUR_RRF, FLAVOUR_PRUSA = 0, 1, 2, 3, 4, 5
E_EITHER, E_FOLLOWS, E_APART = 0, 1, 2  # how G90/G91 act on E: relative if G91 or M83; sets E too; not at all

# numbers: float64 state
N_POS, N_E, N_FEED, N_HOME, N_G92, N_GCODE_OFFSET, N_M206 = 0, 3, 4, 5, 8, 11, 14
N_FLOW, N_AREA, N_WCS, N_TOOLS, N_SAVED = 17, 18, 20, 47, 96
SAVED_SLOTS, SAVED_NUMBERS = 8, 12
NUMBERS = N_SAVED + SAVED_SLOTS * SAVED_NUMBERS
# counts: int64 state
C_LINE, C_RELATIVE, C_M83, C_INCH, C_PLANE, C_MODAL, C_KNOWN, C_OFFSET_KNOWN, C_TOOL, C_WCS = range(10)
C_LAYER, C_RULE, C_ARC_ABSOLUTE, C_FLAVOUR, C_NUMBERED, C_CHECKSUMS, C_CRLF, C_LF = range(10, 18)
C_SAVED, SAVED_COUNTS = 24, 6
COUNTS = C_SAVED + SAVED_SLOTS * SAVED_COUNTS
TOOLS = 16

_LF, _CR, _SPACE = 10, 13, 32
_EXTENDED, _FILLED_IN = 1, 2  # stand in for a command letter
_SEMICOLON, _OPEN, _CLOSE, _STAR, _PERCENT, _QUOTE = 59, 40, 41, 42, 37, 34
_BIT_D, _BIT_E, _BIT_F, _BIT_I, _BIT_L, _BIT_P = 1 << 3, 1 << 4, 1 << 5, 1 << 8, 1 << 11, 1 << 15
_BIT_R, _BIT_S, _BIT_T = 1 << 17, 1 << 18, 1 << 19
_BIT_X, _BIT_XYZ, _BIT_IJK = 1 << 23, 7 << 23, 7 << 8
_POWERS = np.array([10.0**k for k in range(23)])
_FNV_SEED, _FNV_PRIME = np.uint64(14695981039346656037), np.uint64(1099511628211)


def _hash(name: str) -> np.uint64:
    value = int(_FNV_SEED)
    for byte in name.encode():
        value = ((value ^ byte) * int(_FNV_PRIME)) & 0xFFFFFFFFFFFFFFFF
    return np.uint64(value)


_SAVE, _RESTORE, _OFFSET = _hash("SAVE_GCODE_STATE"), _hash("RESTORE_GCODE_STATE"), _hash("SET_GCODE_OFFSET")
_KEY_NAME, _KEY_MOVE, _DEFAULT = _hash("NAME"), _hash("MOVE"), _hash("DEFAULT")
_KEY_AXIS = np.array([_hash("X"), _hash("Y"), _hash("Z")])
_KEY_ADJUST = np.array([_hash("X_ADJUST"), _hash("Y_ADJUST"), _hash("Z_ADJUST")])
_EXCLUDING = np.array(
    [_hash(name) for name in ("EXCLUDE_OBJECT", "EXCLUDE_OBJECT_START", "EXCLUDE_OBJECT_END", "START_CURRENT_OBJECT",
                              "END_CURRENT_OBJECT", "CANCEL_OBJECT")]
)  # fmt: skip
_PAUSING = np.array([_hash(name) for name in ("PAUSE", "RESUME", "CANCEL_PRINT")])
_TOOLING = np.array([_hash("ACTIVATE_EXTRUDER")])
# Extended commands that neither move the carriage nor shift its coordinates.
_STILL = np.array(
    [_hash(name) for name in (
        "SET_PRESSURE_ADVANCE", "SET_VELOCITY_LIMIT", "EXCLUDE_OBJECT_DEFINE", "DEFINE_OBJECT", "SET_FAN_SPEED", "SET_LED",
        "SET_PRINT_STATS_INFO", "SET_RETRACTION", "TEMPERATURE_WAIT", "SET_HEATER_TEMPERATURE", "RESPOND",
        "GET_POSITION", "SET_INPUT_SHAPER", "UPDATE_DELAYED_GCODE", "SET_GCODE_VARIABLE", "SAVE_VARIABLE",
        "SDCARD_LOOP_BEGIN", "SDCARD_LOOP_END", "SDCARD_LOOP_DESIST", "SET_PIN", "SET_TEMPERATURE_FAN_TARGET",
        "TURN_OFF_HEATERS", "SET_DISPLAY_TEXT", "SET_STEPPER_ENABLE_NOTHING", "QUERY_ENDSTOPS", "STATUS",
        "TIMELAPSE_RENDER", "SET_SERVO", "SET_FILAMENT_SENSOR", "M117", "EXCLUDE_OBJECT_RESET", "SET_TMC_CURRENT",
    )]
)  # fmt: skip


@njit
def _upper(byte):
    return byte - 32 if 97 <= byte <= 122 else byte


@njit
def _is_letter(byte):
    return 65 <= byte <= 90 or 97 <= byte <= 122


@njit
def _is_digit(byte):
    return 48 <= byte <= 57


@njit
def _has_letter(buf, p, stop):
    for k in range(p, stop):
        if _is_letter(buf[k]):
            return True
    return False


@njit
def _blank(byte):
    """Blanks are every control character and the space: a NUL in a file is passed over."""
    return byte <= _SPACE


@njit
def _divide(whole, power):
    """Round whole/power to the nearest double, for an integer below 2^63 and an exact power of ten.

    hi + lo = whole exactly, q = hi/power; the remainder hi − q·power is exact by Dekker's product, so the second
    quotient corrects q to beyond 100 bits before the last rounding.
    """
    if whole < 9007199254740992:
        return float(whole) / power
    high = float(whole)
    low = float(whole - np.int64(high)) if high < 9.2e18 else 0.0
    quotient = high / power
    a = 134217729.0 * quotient
    a_high = a - (a - quotient)
    a_low = quotient - a_high
    b = 134217729.0 * power
    b_high = b - (b - power)
    b_low = power - b_high
    product = quotient * power
    error = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return quotient + ((high - product) - error + low) / power


@njit
def parse_number(buf, p, stop, spaced, capital):
    """Read a number at p: (value, next, found). Nothing found leaves next at p.

    ``spaced`` and ``capital`` say how the line is written, which tells an exponent (`Y2.4e-15`, `X1.0E-4`) from an
    E word that follows without a blank (`X1E-4` in `G1X1E-4`).
    """
    start = p
    negative = False
    if p < stop and (buf[p] == 43 or buf[p] == 45):
        negative = buf[p] == 45
        p += 1
    whole = np.int64(0)
    digits, significant, power = 0, 0, 0
    point = False
    while p < stop:
        byte = buf[p]
        if 48 <= byte <= 57:
            digits += 1
            if significant < 18:
                whole = whole * 10 + (byte - 48)
                if whole > 0:
                    significant += 1
                if point:
                    power -= 1
            elif not point:
                power += 1
        elif byte == 46 and not point:
            point = True
        else:
            break
        p += 1
    if digits == 0:
        return 0.0, start, False
    if p + 1 < stop and (buf[p] == 101 or buf[p] == 69):
        signed = buf[p + 1] == 43 or buf[p + 1] == 45
        q = p + 2 if signed else p + 1
        first, exponent = q, 0
        while q < stop and _is_digit(buf[q]) and q < first + 4:
            exponent = exponent * 10 + (buf[q] - 48)
            q += 1
        closed = q == stop or _blank(buf[q]) or buf[q] == _SEMICOLON or buf[q] == _STAR or buf[q] == _OPEN
        sure = buf[p] == 101 and capital
        if q > first and closed and (sure or (spaced and signed)):
            power += -exponent if buf[p + 1] == 45 else exponent
            p = q
    if power == 0:
        value = float(whole)
    elif power < 0:
        value = _divide(whole, _POWERS[-power]) if power >= -22 else float(whole) * 10.0**power
    else:
        value = float(whole) * _POWERS[power] if power <= 22 else float(whole) * 10.0 ** min(power, 400)
    if not value < 1e15:  # no machine is that large: keep the arithmetic finite
        value = 1e15
    return (-value if negative else value), p, True


@njit
def _offset(numbers, counts, axis):
    """machine − logical [mm] of an axis: work, G92, gcode, home and tool offsets together."""
    tool = counts[C_TOOL]
    tools = numbers[N_TOOLS + 3 * tool + axis] if 0 <= tool < TOOLS else 0.0
    work = numbers[N_WCS + 3 * counts[C_WCS] + axis]
    return work + numbers[N_G92 + axis] + numbers[N_GCODE_OFFSET + axis] - numbers[N_M206 + axis] - tools


@njit
def _e_is_relative(counts):
    if counts[C_RULE] == E_EITHER:
        return counts[C_M83] != 0 or counts[C_RELATIVE] != 0
    return counts[C_M83] != 0


@njit
def _begin(r, begin, end, after, numbers, counts, flags):
    """Fill a record with the state as it is before the statement."""
    r.begin, r.end, r.next, r.line = begin, end, after, counts[C_LINE]
    r.x0, r.y0, r.z0, r.e0 = numbers[N_POS], numbers[N_POS + 1], numbers[N_POS + 2], numbers[N_E]
    r.c0 = r.c1 = np.nan
    r.advance = 0.0
    if counts[C_RELATIVE]:
        flags |= FLAG_RELATIVE
    if _e_is_relative(counts):
        flags |= FLAG_E_RELATIVE
    if counts[C_INCH]:
        flags |= FLAG_INCH
    r.flags = flags | counts[C_KNOWN] << 4
    r.layer, r.turns, r.plane = counts[C_LAYER], 0, counts[C_PLANE]
    r.kind = r.event = r.axes = 0


@njit
def _finish(r, numbers, counts):
    """Close a record with the place, E, feed, offsets and certainty after the statement."""
    r.x1, r.y1, r.z1 = numbers[N_POS], numbers[N_POS + 1], numbers[N_POS + 2]
    r.e1, r.feed = numbers[N_E], numbers[N_FEED]
    r.ox, r.oy, r.oz = _offset(numbers, counts, 0), _offset(numbers, counts, 1), _offset(numbers, counts, 2)
    r.flags = r.flags | (counts[C_KNOWN] << 7)


@njit
def _event(r, counts, event, lost):
    """Say why the place (axes in ``lost``) or the belts' engaged side is uncertain after this statement."""
    r.kind, r.event = KIND_EVENT, event
    counts[C_KNOWN] &= ~lost & 7


@njit
def _goto(numbers, counts, words, unclear, values, unit, g53):
    """Move the state's place by the X Y Z words; an axis named with an unclear value is lost."""
    for axis in range(3):
        bit = _BIT_X << axis
        if unclear & bit:
            counts[C_KNOWN] &= ~(1 << axis)
        elif words & bit:
            value = values[23 + axis] * unit
            if g53:
                numbers[N_POS + axis] = value
                counts[C_KNOWN] |= 1 << axis
            elif counts[C_RELATIVE]:
                numbers[N_POS + axis] += value
            else:
                numbers[N_POS + axis] = value + _offset(numbers, counts, axis)
                if counts[C_OFFSET_KNOWN] & (1 << axis):
                    counts[C_KNOWN] |= 1 << axis
                else:
                    counts[C_KNOWN] &= ~(1 << axis)


@njit
def _move(r, numbers, counts, words, unclear, values, motion):
    """G0 G1 G2 G3: the state moves on; the record learns the rest in `_close_move`."""
    unit = 25.4 if counts[C_INCH] else 1.0
    if motion == 0:
        r.flags = r.flags | FLAG_RAPID
    if words & _BIT_F:
        numbers[N_FEED] = abs(values[5]) * unit
    r.kind = KIND_LINEAR if motion < 2 else (KIND_CW if motion == 2 else KIND_CCW)
    _goto(numbers, counts, words, unclear, values, unit, (r.flags & FLAG_G53) != 0)
    if words & _BIT_E:
        value = values[4] * unit
        numbers[N_E] = r.e0 + value if _e_is_relative(counts) else value
        advance = (numbers[N_E] - r.e0) * numbers[N_FLOW]
        r.advance = advance / numbers[N_AREA] if numbers[N_AREA] > 0 else advance
    moves = r.x0 != numbers[N_POS] or r.y0 != numbers[N_POS + 1] or r.z0 != numbers[N_POS + 2]
    if motion >= 2:
        _centre(r, numbers, counts, words, values, unit, motion)
        moves = True
        if words & _BIT_P and values[15] > 1 and values[15] < 1000:
            r.turns = np.int64(values[15]) - 1
    if moves and r.advance > 0:
        r.flags = r.flags | FLAG_EXTRUDING
    if unclear:
        r.flags = r.flags | FLAG_OPAQUE
        if unclear & (_BIT_XYZ | _BIT_IJK | _BIT_R):
            r.kind, r.event = KIND_EVENT, EVENT_PLACEHOLDER


@njit
def _centre(r, numbers, counts, words, values, unit, motion):
    """Find an arc's centre from I J K or from R; an arc without one becomes an unknown event."""
    a = (0, 2, 1)[counts[C_PLANE]]
    b = (1, 0, 2)[counts[C_PLANE]]
    first = r.x0 if a == 0 else (r.z0 if a == 2 else r.y0)
    second = r.y0 if b == 1 else (r.x0 if b == 0 else r.z0)
    bit_a, bit_b = _BIT_I << a, _BIT_I << b
    if words & (bit_a | bit_b):
        if counts[C_ARC_ABSOLUTE]:
            r.c0 = values[8 + a] * unit + _offset(numbers, counts, a) if words & bit_a else first
            r.c1 = values[8 + b] * unit + _offset(numbers, counts, b) if words & bit_b else second
        else:
            r.c0 = first + (values[8 + a] * unit if words & bit_a else 0.0)
            r.c1 = second + (values[8 + b] * unit if words & bit_b else 0.0)
        if r.c0 != first or r.c1 != second:
            return
    elif words & _BIT_R:
        # The centre lies on the chord's bisector, at h from its middle: (2h/d)² = (4r² − d²)/d².
        radius = values[17] * unit
        x, y = numbers[N_POS + a] - first, numbers[N_POS + b] - second
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


@njit
def _home(r, numbers, counts, axes):
    """G28: the named axes are at home; their shifts are forgotten."""
    r.kind, r.axes = KIND_HOME, axes
    for axis in range(3):
        if axes & (1 << axis):
            numbers[N_POS + axis] = numbers[N_HOME + axis]
            numbers[N_G92 + axis] = 0.0
            counts[C_KNOWN] |= 1 << axis
            counts[C_OFFSET_KNOWN] |= 1 << axis


@njit
def _set_position(r, numbers, counts, words, values, code):
    """G92: the place stays, its coordinates change. Bare, Klipper sets all to zero; Marlin and RRF do nothing."""
    unit = 25.4 if counts[C_INCH] else 1.0
    flavour = counts[C_FLAVOUR]
    bare = (words & (_BIT_XYZ | _BIT_E)) == 0 and code == 920
    zero = bare and (flavour == FLAVOUR_UNKNOWN or flavour == FLAVOUR_KLIPPER)
    r.kind = KIND_SET
    axes = 0
    for axis in range(3):
        if code != 920:  # G92.1, G92.2: LinuxCNC forgets the shift
            numbers[N_G92 + axis] = 0.0
        elif zero or words & (_BIT_X << axis):
            value = 0.0 if zero else values[23 + axis] * unit
            numbers[N_G92 + axis] += numbers[N_POS + axis] - value - _offset(numbers, counts, axis)
            axes |= 1 << axis
            if not counts[C_KNOWN] & (1 << axis):
                counts[C_OFFSET_KNOWN] &= ~(1 << axis)
    if zero or words & _BIT_E and code == 920:
        numbers[N_E] = 0.0 if zero else values[4] * unit
        axes |= 8
    r.axes = axes


@njit
def _mode(numbers, counts, code):
    """Obey a G word that only sets a mode; False if it is another kind. Codes are tenths: G92.1 is 921."""
    if code == 900 or code == 910:
        counts[C_RELATIVE] = code == 910
        if counts[C_RULE] == E_FOLLOWS:
            counts[C_M83] = code == 910
    elif code == 200 or code == 210:
        counts[C_INCH] = code == 200
    elif 170 <= code <= 190 and code % 10 == 0:
        counts[C_PLANE] = code // 10 - 17
    elif code == 901 or code == 911:
        counts[C_ARC_ABSOLUTE] = code == 901
    elif 540 <= code <= 590 and code % 10 == 0:
        counts[C_WCS] = code // 10 - 54
    elif 591 <= code <= 593:
        counts[C_WCS] = code - 585
    elif not (code == 400 or code == 490 or code == 640 or code == 610 or 930 <= code <= 990 or code == 90):
        return False
    return True


@njit
def _g_command(r, numbers, counts, words, bare, unclear, values, code):
    """Obey a G command with its words, motion G0–G3 excepted; a record without a kind is dropped."""
    if code == 280:
        axes = ((words | bare | unclear) >> 23) & 7
        _home(r, numbers, counts, axes if axes else 7)
    elif code == 920 or code == 921 or code == 922:
        _set_position(r, numbers, counts, words, values, code)
    elif code == 100 or code == 110:
        _g10(r, numbers, counts, words, values, code)
    elif code == 40 or code == 430 or code == 923 or code == 290 and words & _BIT_S:
        pass  # dwell, tool length from the table, RRF's `G29 S1` (load a map)
    elif code in (281, 301, 291, 292, 294, 220, 230):
        pass  # stored places; Bambu's and Marlin's switches
    elif code in (290, 300, 320, 330, 340, 800) or 380 <= code <= 385:
        if code == 800:
            counts[C_MODAL] = -1
        _event(r, counts, EVENT_PROBE, 7)
    elif code == 50 or code == 51:  # splines end where they say
        _goto(numbers, counts, words, unclear, values, 25.4 if counts[C_INCH] else 1.0, False)
        if words & _BIT_E:
            value = values[4] * (25.4 if counts[C_INCH] else 1.0)
            numbers[N_E] = r.e0 + value if _e_is_relative(counts) else value
        _event(r, counts, EVENT_UNKNOWN, 0)
        r.flags = r.flags | FLAG_OPAQUE
    else:
        _event(r, counts, EVENT_UNKNOWN, 7)
        r.flags = r.flags | FLAG_OPAQUE


@njit
def _g10(r, numbers, counts, words, values, code):
    """G10/G11: firmware retraction; with L or P and axes, work offsets (LinuxCNC) or tool offsets (RRF)."""
    has_p, has_l = words & _BIT_P, words & _BIT_L
    if not has_p and not has_l:
        r.kind, r.axes = KIND_RETRACT, code == 100
        return
    if not words & _BIT_XYZ:
        return
    unit = 25.4 if counts[C_INCH] else 1.0
    index = np.int64(min(max(values[15], -1.0), 99.0)) if has_p else -1
    level = np.int64(min(max(values[11], 0.0), 99.0)) if has_l else 0
    _event(r, counts, EVENT_OFFSET, 0)
    for axis in range(3):
        if words & (_BIT_X << axis):
            value = values[23 + axis] * unit
            if level == 2 or level == 20:
                work = counts[C_WCS] if index <= 0 else index - 1
                if 0 <= work < 9:
                    place = N_WCS + 3 * work + axis
                    if level == 2:
                        numbers[place] = value
                    elif work == counts[C_WCS]:
                        numbers[place] += numbers[N_POS + axis] - value - _offset(numbers, counts, axis)
                    if level == 20 and not counts[C_KNOWN] & (1 << axis):
                        counts[C_OFFSET_KNOWN] &= ~(1 << axis)
            elif 0 <= index < TOOLS:
                numbers[N_TOOLS + 3 * index + axis] = value


# M commands in tenths. The place is kept by the first three groups and lost by the last.
_M_PAUSE = np.array([0, 10, 250, 600, 1250, 2260, 6000, 6010, 6020])
_M_EXCLUDE = np.array([4860, 6240, 6250])
_M_TOOL = np.array([60, 6200, 6210, 7010, 7020, 7030])
_M_MACRO = np.array([240, 320, 480, 980, 6050, 6220, 6230, 8080, 9700, 9703, 9710])


@njit
def _m_command(r, numbers, counts, words, bare, values, code):
    """Obey an M command; a record without a kind is dropped. Codes are tenths."""
    if code == 820 or code == 830:
        counts[C_M83] = code == 830
    elif code == 2210:
        if words & _BIT_S:
            numbers[N_FLOW] = values[18] / 100.0
    elif code == 2000:
        if words & _BIT_D:
            numbers[N_AREA] = np.pi * values[3] * values[3] / 4.0
        if words & _BIT_S and values[18] == 0:
            numbers[N_AREA] = 0.0
    elif code == 2180 or code == 2060:
        tool = np.int64(min(max(values[19], -1.0), 99.0)) if words & _BIT_T else counts[C_TOOL]
        for axis in range(3):
            if words & (_BIT_X << axis):
                value = values[23 + axis] * (25.4 if counts[C_INCH] else 1.0)
                if code == 2060:
                    numbers[N_M206 + axis] = value
                elif 0 < tool < TOOLS:
                    numbers[N_TOOLS + 3 * tool + axis] = value
        if words & _BIT_XYZ:
            _event(r, counts, EVENT_OFFSET, 0)
    elif code == 180 or code == 840:
        named = words | bare
        axes = (named >> 23) & 7
        if words & _BIT_S == 0 and (axes or named & _BIT_E == 0):
            _event(r, counts, EVENT_MOTORS_OFF, axes if axes else 7)
    elif _among(code, _M_PAUSE):
        _event(r, counts, EVENT_PAUSE, 0)
    elif _among(code, _M_EXCLUDE):
        _event(r, counts, EVENT_EXCLUDE, 0)
    elif _among(code, _M_TOOL):
        _event(r, counts, EVENT_TOOL, 7)
    elif _among(code, _M_MACRO):
        _event(r, counts, EVENT_MACRO, 7)


@njit
def _among(value, table):
    for k in range(len(table)):
        if table[k] == value:
            return True
    return False


@njit
def _word_hash(buf, p, stop):
    """Hash of the upper-cased name at p, and where it ends."""
    value = _FNV_SEED
    while p < stop and (_is_letter(buf[p]) or _is_digit(buf[p]) or buf[p] == 95):
        value = (value ^ np.uint64(_upper(buf[p]))) * _FNV_PRIME
        p += 1
    return value, p


@njit
def _extended(r, buf, p, stop, numbers, counts):
    """Obey a command with a long name (Klipper): state, offsets, objects, pauses; every other one is a macro."""
    name, p = _word_hash(buf, p, stop)
    if name != _SAVE and name != _RESTORE and name != _OFFSET:
        if _among(name, _EXCLUDING):
            _event(r, counts, EVENT_EXCLUDE, 0)
        elif _among(name, _PAUSING):
            _event(r, counts, EVENT_PAUSE, 0)
        elif _among(name, _TOOLING):
            _event(r, counts, EVENT_TOOL, 7)
        elif not _among(name, _STILL):
            _event(r, counts, EVENT_MACRO, 7)
        return
    label, move, given, adjusted = _DEFAULT, False, 0, 0
    offsets = np.zeros(3)
    while p < stop and buf[p] != _SEMICOLON:
        if not _is_letter(buf[p]):
            p += 1
            continue
        key, p = _word_hash(buf, p, stop)
        if p >= stop or buf[p] != 61:
            continue
        if key == _KEY_NAME:
            label, p = _word_hash(buf, p + 1, stop)
            continue
        value, p, found = parse_number(buf, p + 1, stop, True, True)
        move = move or key == _KEY_MOVE and value == 1
        for axis in range(3):
            if found and key == _KEY_AXIS[axis]:
                offsets[axis], given = value, given | 1 << axis
            elif found and key == _KEY_ADJUST[axis]:
                offsets[axis], adjusted = value, adjusted | 1 << axis
    if name == _SAVE:
        _save(numbers, counts, label)
        return
    r.kind, r.event = KIND_EVENT, EVENT_RESTORE if move else EVENT_OFFSET
    r.flags = r.flags | FLAG_OPAQUE
    if name == _RESTORE:
        if not _restore(numbers, counts, label, move):
            counts[C_KNOWN] = counts[C_OFFSET_KNOWN] = 0
        return
    for axis in range(3):
        old = numbers[N_GCODE_OFFSET + axis]
        if given & (1 << axis):
            numbers[N_GCODE_OFFSET + axis] = offsets[axis]
        elif adjusted & (1 << axis):
            numbers[N_GCODE_OFFSET + axis] += offsets[axis]
        if move:
            numbers[N_POS + axis] += numbers[N_GCODE_OFFSET + axis] - old


@njit
def _save(numbers, counts, label):
    """SAVE_GCODE_STATE: into the slot of that name, a free one, or the first."""
    key = np.int64(label)
    slot = 0
    for k in range(SAVED_SLOTS - 1, -1, -1):
        if counts[C_SAVED + k * SAVED_COUNTS] == 0:
            slot = k
    for k in range(SAVED_SLOTS):
        if counts[C_SAVED + k * SAVED_COUNTS] == key:
            slot = k
    c, f = C_SAVED + slot * SAVED_COUNTS, N_SAVED + slot * SAVED_NUMBERS
    counts[c], counts[c + 1], counts[c + 2] = key, counts[C_RELATIVE], counts[C_M83]
    counts[c + 3], counts[c + 4] = counts[C_KNOWN], counts[C_OFFSET_KNOWN]
    for axis in range(3):
        numbers[f + axis] = numbers[N_POS + axis]
        numbers[f + 3 + axis] = numbers[N_G92 + axis]
        numbers[f + 6 + axis] = numbers[N_GCODE_OFFSET + axis]
    numbers[f + 9], numbers[f + 10], numbers[f + 11] = numbers[N_E], numbers[N_FEED], numbers[N_FLOW]


@njit
def _restore(numbers, counts, label, move):
    """RESTORE_GCODE_STATE; False when nothing was saved under that name."""
    key = np.int64(label)
    for slot in range(SAVED_SLOTS):
        c, f = C_SAVED + slot * SAVED_COUNTS, N_SAVED + slot * SAVED_NUMBERS
        if counts[c] == key:
            counts[C_RELATIVE], counts[C_M83], counts[C_OFFSET_KNOWN] = counts[c + 1], counts[c + 2], counts[c + 4]
            for axis in range(3):
                numbers[N_G92 + axis] = numbers[f + 3 + axis]
                numbers[N_GCODE_OFFSET + axis] = numbers[f + 6 + axis]
                if move:
                    numbers[N_POS + axis] = numbers[f + axis]
            if move:
                counts[C_KNOWN] = counts[c + 3]
            numbers[N_E], numbers[N_FEED], numbers[N_FLOW] = numbers[f + 9], numbers[f + 10], numbers[f + 11]
            return True
    return False


@njit
def _starts_with(buf, p, stop, text):
    if stop - p < len(text):
        return False
    for k in range(len(text)):
        if _upper(buf[p + k]) != text[k]:
            return False
    return True


_LAYER_CHANGE = np.frombuffer(b"LAYER_CHANGE", np.uint8)
_CHANGE_LAYER = np.frombuffer(b"CHANGE_LAYER", np.uint8)
_LAYER = np.frombuffer(b"LAYER", np.uint8)
_LAYER_OBJECT = np.frombuffer(b"BEGIN_LAYER_OBJECT", np.uint8)


@njit
def _comment(buf, p, stop, counts):
    """Count layer comments: `;LAYER_CHANGE`, `;LAYER:3`, `; CHANGE_LAYER`, `; layer 3, Z = …`, KISSlicer's."""
    while p < stop and _blank(buf[p]):
        p += 1
    if p >= stop:
        return
    first = _upper(buf[p])
    if first == 76 and _starts_with(buf, p, stop, _LAYER):
        q = p + 5
        if _starts_with(buf, p, stop, _LAYER_CHANGE):
            counts[C_LAYER] += q + 7 == stop or _blank(buf[min(q + 7, stop - 1)])
        elif q + 1 < stop and (buf[q] == 58 or buf[q] == _SPACE) and (_is_digit(buf[q + 1]) or buf[q + 1] == 45):
            counts[C_LAYER] += 1
    elif (first == 67 and _starts_with(buf, p, stop, _CHANGE_LAYER)) or (
        first == 66 and _starts_with(buf, p, stop, _LAYER_OBJECT)
    ):
        counts[C_LAYER] += 1


# M commands in tenths whose argument is free text.
_M_TEXT = np.array([1170, 1180, 230, 280, 300, 320, 360, 980, 5500, 5870, 4700, 9280, 8620, 8623, 8626, 10020])


@njit
def _line(buf, p, stop, after, values, numbers, counts, records, n):
    """Obey one line, buf[p:stop]; return the next free record."""
    while p < stop and _blank(buf[p]):
        p += 1
    if p + 2 < stop and buf[p] == 0xEF and buf[p + 1] == 0xBB and buf[p + 2] == 0xBF:
        p += 3
    if p >= stop:
        return n
    if buf[p] == _SEMICOLON:
        _comment(buf, p + 1, stop, counts)
        return n
    flags = 0
    if _upper(buf[p]) == 78 and p + 1 < stop and _is_digit(buf[p + 1]):
        p += 1
        while p < stop and _is_digit(buf[p]):
            p += 1
        while p < stop and _blank(buf[p]):
            p += 1
        flags |= FLAG_NUMBERED
        counts[C_NUMBERED] += 1
    spaced = False
    while p < stop:  # one statement a turn
        start, letter, code = p, 0, 0
        words, bare, unclear = 0, 0, 0
        long = p + 1 < stop and (_is_letter(buf[p]) or buf[p] == 95) and (_is_letter(buf[p + 1]) or buf[p + 1] == 95)
        if long:
            letter, q = _EXTENDED, p
            p = stop
        again = False
        while p < stop:
            byte = _upper(buf[p])
            if byte <= _SPACE:
                spaced = True
                p += 1
                continue
            if not 65 <= byte <= 90:
                if byte == _OPEN or byte == _QUOTE:
                    closing = _CLOSE if byte == _OPEN else _QUOTE
                    p += 1
                    while p < stop and buf[p] != closing:
                        p += 1
                    p += 1
                    continue
                if byte == _STAR:
                    flags |= FLAG_CHECKSUM
                    counts[C_CHECKSUMS] += 1
                elif (byte == 123 or byte == 91 or byte == 35) and letter != 77:  # { [ #: filled in by someone else
                    unclear |= _BIT_XYZ
                    if letter == 0:
                        letter = _FILLED_IN
                break
            value, q, found = parse_number(buf, p + 1, stop, spaced, buf[p] < 97)
            if byte == 71 or byte == 77 or (byte == 84 and letter == 0):
                if found and 0 <= value < 100000:
                    tenths = np.int64(value * 10.0 + 0.5)
                    if letter != 0 or (words != 0 and (byte != 71 or tenths > 30)):
                        again = True  # this one begins the next statement
                        break
                    if buf[p] >= 97:
                        flags |= FLAG_LOWER
                    if byte == 71 and (tenths == 530 or _mode(numbers, counts, tenths)):
                        flags |= FLAG_MIXED
                        if tenths == 530:
                            flags |= FLAG_G53
                        if words == 0:
                            start = q
                    else:
                        if words == 0:
                            start = p
                        letter, code = byte, tenths
                        if byte == 77 and _among(tenths, _M_TEXT):
                            break
                    p = q
                    continue
                if byte == 84 and letter == 0:  # `T?`, `Tx`: the printer asks
                    letter, code, start = 84, -20, p
                    break
            bit = 1 << (byte - 65)
            if found:
                values[byte - 65] = value
                words |= bit
                if _is_letter(buf[q - 1]) or (q - p > 4 and _has_letter(buf, p + 1, q)):
                    flags |= FLAG_EXPONENT
            else:
                while q < stop and _blank(buf[q]):
                    q += 1
                if q < stop and (buf[q] == 123 or buf[q] == 91 or buf[q] == 35):
                    unclear |= bit
                    closing = 125 if buf[q] == 123 else 93
                    while q < stop and buf[q] != closing and buf[q] != _SEMICOLON:
                        q += 1
                    q += q < stop and buf[q] == closing
                elif letter == 0 and (q >= stop or not _is_letter(buf[q])):
                    break  # a letter that begins nothing
                else:
                    bare |= bit
            p = q
        if spaced:
            flags |= FLAG_SPACED
        r = records[n]
        _begin(r, start, p if again else stop, p if again else after, numbers, counts, flags)
        r.words = words
        if letter == 71 and code <= 30 or letter == 0:
            if letter == 71:
                counts[C_MODAL] = code // 10
            else:
                r.flags = r.flags | FLAG_MODAL
            if counts[C_MODAL] >= 0 and (letter == 71 or (words | unclear) & (_BIT_XYZ | _BIT_E | _BIT_F)):
                _move(r, numbers, counts, words, unclear, values, counts[C_MODAL])
        elif letter == 71:
            _g_command(r, numbers, counts, words, bare, unclear, values, code)
        elif letter == 77:
            _m_command(r, numbers, counts, words, bare, values, code)
        elif letter == 84:
            if code // 10 != counts[C_TOOL]:
                counts[C_TOOL] = code // 10
                _event(r, counts, EVENT_TOOL, 7)
        elif letter == _EXTENDED:
            _extended(r, buf, start, stop, numbers, counts)
        else:
            _event(r, counts, EVENT_PLACEHOLDER, 7)
            r.flags = r.flags | FLAG_OPAQUE
        if r.kind != 0:
            _finish(r, numbers, counts)
            n += 1
        if not again:
            break
        flags = flags & FLAG_NUMBERED | FLAG_MIXED
    return n


@njit(cache=True)
def interpret(buf, begin, end, numbers, counts, records):
    """Interpret the whole lines buf[begin:end]; return (records filled, where it stopped).

    ``buf`` uint8, ``numbers`` float64 [NUMBERS] and ``counts`` int64 [COUNTS] are the machine's state and are
    advanced; ``records`` is an array of RECORD. It stops before a line whose statements may not fit in ``records``
    (a line of L bytes needs at most L/2 + 2): call again with the rest.
    """
    values = np.zeros(26)
    n = 0
    capacity = len(records)
    p = begin
    while p < end:
        stop = p
        while stop < end and buf[stop] != _LF and buf[stop] != _CR:
            stop += 1
        after = stop
        while after < end and buf[after] == _CR:
            after += 1
        if after < end and buf[after] == _LF:
            after += 1
        elif after > stop:  # a lone carriage return ends a line too
            after = stop + 1
        if n + (stop - p) // 2 + 2 > capacity:
            break
        n = _line(buf, p, stop, after, values, numbers, counts, records, n)
        counts[C_LINE] += 1
        p = after
    return n, p


@njit(cache=True)
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
    count = np.int64(min(np.ceil(abs(sweep) / max(step, 1e-4)), 1e6))
    count = max(count, 1)
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
