# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)
"""The effect of each command on the machine's state and on the record of its statement."""

import numpy as np

from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.text import among
from printmend.jit import inner


@inner
def add_offsets(numbers, counts):
    """Sum the work, G92, gcode, home and tool offsets of each axis: machine − logical [mm]."""
    tool = counts.tool
    for axis in range(3):
        tools = numbers.tools[tool, axis] if 0 <= tool < TOOLS else 0.0
        work = numbers.work[counts.wcs, axis]
        shift = numbers.g92[axis] + numbers.gcode_offset[axis] - numbers.m206[axis]
        numbers.offset[axis] = work + shift - tools


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
    """Move the state's place by the X Y Z words; an axis named with an unclear value is lost."""
    for axis in range(3):
        bit = WORD_X << axis
        if unclear & bit:
            counts.known &= ~(1 << axis)
        elif words & bit:
            value = values[VALUE_X + axis] * unit
            if g53:
                numbers.pos[axis] = value
                counts.known |= 1 << axis
            elif counts.relative:
                numbers.pos[axis] += value
            else:
                numbers.pos[axis] = value + numbers.offset[axis]
                if counts.offset_known & (1 << axis):
                    counts.known |= 1 << axis
                else:
                    counts.known &= ~(1 << axis)


@inner
def move(r, numbers, counts, words, unclear, values, motion):
    """G0 G1 G2 G3: the state moves on; the record learns the rest in `_close_move`."""
    unit = 25.4 if counts.inch else 1.0
    if motion == 0:
        r.flags = r.flags | FLAG_RAPID
    if words & WORD_F:
        numbers.feed = abs(values[VALUE_F]) * unit
    r.kind = KIND_LINEAR if motion < 2 else (KIND_CW if motion == 2 else KIND_CCW)
    _goto(numbers, counts, words, unclear, values, unit, np.int64(r.flags & FLAG_G53))
    if words & WORD_E:
        value = values[VALUE_E] * unit
        numbers.e = r.e0 + value if e_is_relative(counts) else value
        advance = (numbers.e - r.e0) * numbers.flow
        r.advance = advance / numbers.area if numbers.area > 0 else advance
    moves = r.x0 != numbers.pos[0] or r.y0 != numbers.pos[1] or r.z0 != numbers.pos[2]
    if motion >= 2:
        _centre(r, numbers, counts, words, values, unit, motion)
        moves = True
        if words & WORD_P and values[VALUE_P] > 1 and values[VALUE_P] < 1000:
            r.turns = np.int64(values[VALUE_P]) - 1
    if moves and r.advance > 0:
        r.flags = r.flags | FLAG_EXTRUDING
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
            counts.offset_known |= 1 << axis


@inner
def _set_position(r, numbers, counts, words, values, code):
    """G92: the place stays, its coordinates change. Bare, Klipper sets all to zero; Marlin and RRF do nothing."""
    unit = 25.4 if counts.inch else 1.0
    flavour = counts.flavour
    bare = (words & (WORDS_XYZ | WORD_E)) == 0 and code == 920
    zero = bare and flavour in (FLAVOUR_UNKNOWN, FLAVOUR_KLIPPER)
    r.kind = KIND_SET
    axes = 0
    for axis in range(3):
        if code != 920:  # G92.1, G92.2: LinuxCNC forgets the shift
            numbers.g92[axis] = 0.0
            counts.offset_known |= 1 << axis
            axes |= 16 | 1 << axis
        elif zero or words & (WORD_X << axis):
            value = 0.0 if zero else values[VALUE_X + axis] * unit
            numbers.g92[axis] += numbers.pos[axis] - value - numbers.offset[axis]
            axes |= 1 << axis
            if not counts.known & (1 << axis):
                counts.offset_known &= ~(1 << axis)
    if zero or (words & WORD_E and code == 920):
        numbers.e = 0.0 if zero else values[VALUE_E] * unit
        axes |= 8
    r.axes = axes


@inner
def set_mode(numbers, counts, code):
    """Obey a G word that only sets a mode; False if it is another kind. Codes are tenths: G92.1 is 921."""
    if code == 900 or code == 910:
        counts.relative = code == 910
        if counts.rule == E_FOLLOWS:
            counts.m83 = code == 910
    elif code == 200 or code == 210:
        counts.inch = code == 200
    elif 170 <= code <= 190 and code % 10 == 0:
        counts.plane = code // 10 - 17
    elif code == 901 or code == 911:
        counts.arc_absolute = code == 901
    elif 540 <= code <= 590 and code % 10 == 0:
        counts.wcs = code // 10 - 54
        add_offsets(numbers, counts)
    elif 591 <= code <= 593:
        counts.wcs = code - 585
        add_offsets(numbers, counts)
    elif not (code == 400 or code == 490 or code == 640 or 930 <= code <= 990 or code == 90):
        return False
    return True


@inner
def g_command(r, numbers, counts, words, bare, unclear, values, code):
    """Obey a G command other than G0–G3; return what it makes uncertain, for `event`, or 0."""
    if code == 280:
        axes = ((words | bare | unclear) >> 23) & 7
        flavour = counts.flavour
        if (words | bare) & WORD_O and flavour != FLAVOUR_KLIPPER and flavour != FLAVOUR_RRF:
            # Marlin then homes only axes with an unknown place, and leaves the others.
            return 0 if counts.known == 7 and flavour != FLAVOUR_UNKNOWN else EVENT_PROBE + ALL_LOST
        _home(r, numbers, counts, axes if axes else 7)
    elif code == 920 or code == 921 or code == 922:
        _set_position(r, numbers, counts, words, values, code)
    elif code == 100 or code == 110:
        return _g10(r, numbers, counts, words, values, code)
    elif code == 923:  # LinuxCNC remembers a shift that may be another file's
        counts.offset_known = 0
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
        if words & WORD_F:
            numbers.feed = abs(values[VALUE_F]) * unit
        if words & WORD_E:
            numbers.e = r.e0 + values[VALUE_E] * unit if e_is_relative(counts) else values[VALUE_E] * unit
        return EVENT_SPLINE
    else:
        r.flags = r.flags | FLAG_OPAQUE
        return EVENT_UNKNOWN + ALL_LOST
    return 0


@inner
def _g10(r, numbers, counts, words, values, code):
    """G10/G11: firmware retraction; with L or P and axes, work offsets (LinuxCNC) or tool offsets (RRF)."""
    has_p, has_l = words & WORD_P, words & WORD_L
    if not has_p and not has_l:
        r.kind, r.axes = KIND_RETRACT, code == 100
        return 0
    if not words & WORDS_XYZ:
        return 0
    unit = 25.4 if counts.inch else 1.0
    index = np.int64(min(max(values[VALUE_P], -1.0), 99.0)) if has_p else -1
    level = np.int64(min(max(values[VALUE_L], 0.0), 99.0)) if has_l else 0
    for axis in range(3):
        if words & (WORD_X << axis):
            value = values[VALUE_X + axis] * unit
            if level == 2 or level == 20:
                work = counts.wcs if index <= 0 else index - 1
                if 0 <= work < 9:
                    if level == 2:
                        numbers.work[work, axis] = value
                    elif work == counts.wcs:
                        numbers.work[work, axis] += numbers.pos[axis] - value - numbers.offset[axis]
                    if level == 20 and not counts.known & (1 << axis):
                        counts.offset_known &= ~(1 << axis)
            elif 0 <= index < TOOLS:
                numbers.tools[index, axis] = value
    return EVENT_OFFSET


@inner
def tool_change(numbers, counts, tool):
    """Obey T: its macro is taken to leave the head where the file thinks it is.

    Otherwise every extruding line after it would be lost. In increments, or if the tools' offsets differ, the place is
    unknown. A file's first T0 names the tool at hand.
    """
    old = counts.tool
    same = counts.relative == 0 or (old < 0 and tool == 0)
    for axis in range(3):
        before = numbers.tools[old, axis] if 0 <= old < TOOLS else 0.0
        after = numbers.tools[tool, axis] if 0 <= tool < TOOLS else 0.0
        same = same and before == after
    counts.tool = tool
    return EVENT_TOOL if same else EVENT_TOOL + ALL_LOST


# M commands in tenths. The place is kept by the first three groups and lost by the last two.
_M_GEOMETRY = np.array([4250, 5560, 5790, 8520])  # from here on the firmware changes commanded positions
_M_PAUSE = np.array([0, 10, 250, 600, 1250, 2260, 6000, 6010, 6020])  # the head parks and comes back
_M_EXCLUDE = np.array([4860, 6240, 6250])  # what follows may be skipped
_M_TOOL = np.array([60, 6200, 6210, 7010, 7020, 7030])  # tools, and filament that is changed
_M_MACRO = np.array([240, 320, 480, 980, 6050, 6220, 6230, 8080, 9700, 9703, 9710])  # the firmware expands them


@inner
def m_command(numbers, counts, words, bare, values, code):
    """Obey an M command (in tenths); return what it makes uncertain, for `event`, or 0."""
    if code == 820 or code == 830:
        counts.m83 = code == 830
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
        for axis in range(3):
            if words & (WORD_X << axis):
                value = values[VALUE_X + axis] * (25.4 if counts.inch else 1.0)
                if code == 2060:
                    numbers.m206[axis] = value
                elif 0 < tool < TOOLS:
                    numbers.tools[tool, axis] = value
        if words & WORDS_XYZ:
            return EVENT_OFFSET
    elif code == 180 or code == 840:
        named = words | bare
        axes = (named >> VALUE_X) & 7
        if words & WORD_S == 0 and (axes or named & WORD_E == 0):
            return EVENT_MOTORS_OFF + (axes if axes else 7) * _LOST
    elif among(code, _M_GEOMETRY):
        if words & (WORDS_XYZ | WORD_S | WORDS_IJK):
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
