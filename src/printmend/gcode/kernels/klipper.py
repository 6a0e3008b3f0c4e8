# ruff: noqa: F403, F405 (numba needs the layout's constants as globals of this file)
"""Commands with long names: Klipper's state, offsets, objects and pauses; any other is a macro."""

import numpy as np

from printmend.gcode.kernels.commands import ALL_LOST
from printmend.gcode.kernels.layout import *
from printmend.gcode.kernels.text import *
from printmend.jit import inner

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
_TOOLING = np.array([name_hash("ACTIVATE_EXTRUDER")])
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
    )]
)  # fmt: skip


@inner
def long_command(r, buf, p, stop, numbers, counts):
    """Obey a long name (Klipper): state, offsets, objects, pauses; any other is a macro. Return as `m_command`."""
    name, p = word_hash(buf, p, stop)
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
        for axis in range(3):
            if found and key == _KEY_AXIS[axis]:
                offsets[axis], given = value, given | 1 << axis
            elif found and key == _KEY_ADJUST[axis]:
                offsets[axis], adjusted = value, adjusted | 1 << axis
    if name == _SAVE:
        r.axes = _save(numbers, counts, label)
        return EVENT_SAVE
    r.flags = r.flags | FLAG_OPAQUE
    r.axes = NO_SLOT
    what = EVENT_RESTORE if move else EVENT_OFFSET
    if name == _RESTORE:
        slot = _restore(numbers, counts, label, move)
        if slot < 0:
            counts.offset_known = 0
            return what + ALL_LOST
        r.axes = slot
        return what
    for axis in range(3):
        old = numbers.gcode_offset[axis]
        if given & (1 << axis):
            numbers.gcode_offset[axis] = offsets[axis]
        elif adjusted & (1 << axis):
            numbers.gcode_offset[axis] += offsets[axis]
        if move:
            numbers.pos[axis] += numbers.gcode_offset[axis] - old
    return what


@inner
def _save(numbers, counts, label):
    """SAVE_GCODE_STATE: into the slot of that name, a free one, or the first. Return which."""
    key = np.int64(label)
    slot = 0
    for k in range(SAVED_SLOTS - 1, -1, -1):
        if counts.saved[k].key == 0:
            slot = k
    for k in range(SAVED_SLOTS):
        if counts.saved[k].key == key:
            slot = k
    c, f = counts.saved[slot], numbers.saved[slot]
    c.key, c.relative, c.m83 = key, counts.relative, counts.m83
    c.known, c.offset_known = counts.known, counts.offset_known
    for axis in range(3):
        f.pos[axis] = numbers.pos[axis]
        f.g92[axis] = numbers.g92[axis]
        f.gcode_offset[axis] = numbers.gcode_offset[axis]
    f.e, f.feed, f.flow = numbers.e, numbers.feed, numbers.flow
    return slot


@inner
def _restore(numbers, counts, label, move):
    """RESTORE_GCODE_STATE; return the slot, −1 when nothing was saved under that name."""
    key = np.int64(label)
    for slot in range(SAVED_SLOTS):
        c, f = counts.saved[slot], numbers.saved[slot]
        if c.key == key:
            counts.relative, counts.m83, counts.offset_known = c.relative, c.m83, c.offset_known
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
