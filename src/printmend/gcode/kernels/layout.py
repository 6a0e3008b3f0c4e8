"""The arrays that the kernels share: records, pieces, and the machine's state, as dtypes and constants."""

import numpy as np

# One record. Positions are machine millimetres: G90/G91, G20/G21, G92, G54–G59, tool and gcode offsets are resolved.
RECORD = np.dtype(
    [
        ("begin", "i8"),  # statement's first byte in the chunk, after any N word
        ("end", "i8"),  # its end, comment included, line end excluded
        # start of what follows; buf[end:next] is the line end, empty within a line or at the file's end
        ("next", "i8"),
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
        ("feed", "f8"),  # modal F after this statement [mm/min], 0 before the first F and where unknown
        ("accel", "f8"),  # of printing moves, the last one set [mm/s²], 0 where unknown
        ("ox", "f8"),  # machine = logical × unit + offset [mm]
        ("oy", "f8"),
        ("oz", "f8"),
        ("words", "u4"),  # words with a value: bit 0 is A … bit 25 is Z
        ("flags", "u4"),  # FLAG_*
        ("layer", "i4"),  # layer comments seen so far
        ("doubted", "i4"),  # the line that made a place or a mode uncertain, from 1; 0 for none
        ("turns", "i4"),  # further full circles of an arc (P word)
        ("kind", "u1"),  # KIND_*
        ("event", "u1"),  # EVENT_*, 0 unless kind is KIND_EVENT, KIND_HOME or KIND_RETRACT
        ("plane", "u1"),  # 0 XY, 1 ZX, 2 YZ
        # axes homed or set: bit 0 X, 1 Y, 2 Z, 3 E, 4 forgotten (G92.1); of a saved or restored state its slot
        ("axes", "u1"),
    ]
)

KIND_LINEAR, KIND_CW, KIND_CCW, KIND_HOME, KIND_SET, KIND_RETRACT, KIND_EVENT = 1, 2, 3, 4, 5, 6, 7

# Why the place or the engaged side of the belts is uncertain after an event.
EVENT_MACRO = 1  # a command that the firmware expands: it may have moved anywhere
EVENT_PAUSE = 2  # M0, M25, M600, PAUSE, @pause: the head parks and comes back
EVENT_TOOL = 3  # T, M6, ACTIVATE_EXTRUDER
EVENT_EXCLUDE = 4  # EXCLUDE_OBJECT, M486, @Object: what follows may be skipped while printing
EVENT_PROBE = 5  # G29, G30, G80: probing moves
EVENT_UNKNOWN = 6  # a motion command that is not followed: G12, G27, canned cycles
EVENT_PLACEHOLDER = 7  # {…} or […] that someone else fills in
EVENT_MOTORS_OFF = 8  # M84
EVENT_RESTORE = 9  # RESTORE_GCODE_STATE MOVE=1, SET_GCODE_OFFSET MOVE=1: the carriage goes there by itself
EVENT_OFFSET = 10  # offsets changed; the carriage has not moved
EVENT_SAVE = 11  # SAVE_GCODE_STATE: nothing is uncertain, but a restore comes back to here
EVENT_GEOMETRY = 12  # M92, M425, G68, SET_SKEW and the like: from here on the firmware changes commanded positions
EVENT_ZERO = 14  # G10 L20: the head's place gets new coordinates; the carriage has not moved
EVENT_SPLINE = 13  # a G5 or G5.1 that is not cut into chords: followed to its end, on a way that is not

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
FLAG_OPAQUE = 1 << 18  # not every word is a plain number, or its code is too long: do not write it again
FLAG_SPACED = 1 << 19  # words are separated by blanks
FLAG_ARC_ABSOLUTE = 1 << 20  # G90.1: I J K are coordinates
FLAG_PLAIN = 1 << 21  # written `G1 X… Y…`: upper case, one blank before each word, no word twice, millimetres
FLAG_TWICE = 1 << 22  # a word comes twice: the last one counts
FLAG_CURVE = 1 << 23  # a chord of a G5; all but its last one have no text of their own
FLAG_E_IS_A = 1 << 24  # the extruder's word is A, and stands among the words as E

# The role of a line, from this bit of its flags on: outer and inner walls, closed surfaces, infill, and lines that are
# not part of the object.
ROLE_SHIFT, ROLE_MASK = 25, 7
ROLE_UNKNOWN, ROLE_OUTER, ROLE_INNER, ROLE_SOLID, ROLE_INFILL, ROLE_ASIDE = 0, 1, 2, 3, 4, 5

# How an acceleration is set, from this bit of the flags on: by M204's P, or by its S, which holds for travels, too.
TELL_SHIFT, TELL_MASK = 28, 3
TELL_NOTHING, TELL_P, TELL_S = 0, 1, 2

# The kinds of firmware that differ in reading G-code.
FLAVOUR_UNKNOWN, FLAVOUR_MARLIN2, FLAVOUR_MARLIN1, FLAVOUR_KLIPPER, FLAVOUR_RRF, FLAVOUR_PRUSA = 0, 1, 2, 3, 4, 5
E_EITHER, E_FOLLOWS, E_APART = 0, 1, 2  # how G90/G91 act on E: relative if G91 or M83; sets E too; not at all

TOOLS, WORK_OFFSETS = 16, 9  # tools whose offsets are kept, and G54 to G59.3
SAVED_SLOTS = 8  # states that SAVE_GCODE_STATE can keep
NO_SLOT = 255  # stands in a record for none of them
_MODAL_NUMBERS = [
    ("pos", "f8", 3),  # machine place [mm]
    ("g92", "f8", 3),  # shift by G92 [mm]
    ("gcode_offset", "f8", 3),  # Klipper's SET_GCODE_OFFSET [mm], NaN where unknown, as all shifts but G92's
    ("e", "f8"),  # logical E [mm, or mm³ after M200]
    ("feed", "f8"),  # modal F [mm/min], 0 where unknown
    ("flow", "f8"),  # of M221, 1 for 100 %
]
# The numbers and whole numbers of a machine's state.
NUMBERS = np.dtype(
    [
        *_MODAL_NUMBERS,
        ("home", "f8", 3),  # where homing goes [mm]
        ("m206", "f8", 3),  # home offset of M206 [mm]
        ("offset", "f8", 3),  # machine − logical [mm], the sum of all shifts
        ("area", "f8"),  # of the filament after M200 [mm²], 0 while E is mm
        ("accel", "f8"),  # of printing moves [mm/s²], 0 where unknown
        ("work", "f8", (WORK_OFFSETS, 3)),  # work offsets of G54 to G59.3 [mm]
        ("tools", "f8", (TOOLS, 3)),  # tool offsets [mm]
        ("saved", np.dtype(_MODAL_NUMBERS, align=True), SAVED_SLOTS),
    ],
    align=True,
)
_MODAL_COUNTS = [
    ("relative", "i8"),  # 1 after G91
    ("m83", "i8"),  # 1 after M83
    ("known", "i8"),  # bits: the place of X, Y, Z is certain
    ("zero_known", "i8"),  # bits: the shift of X, Y, Z by G92 is certain
    ("unsure", "i8"),  # UNSURE_*
]
COUNTS = np.dtype(
    [
        *_MODAL_COUNTS,
        ("offset_known", "i8"),  # bits: the sum of all shifts of X, Y, Z is certain
        ("line", "i8"),  # of the file, from 0
        ("doubted", "i8"),  # the line that first made a place or a mode uncertain, from 1; 0 once all are certain
        ("inch", "i8"),  # 1 after G20
        ("plane", "i8"),  # 0 XY, 1 ZX, 2 YZ
        ("modal", "i8"),  # the motion in force: G0 to G3, −1 for none
        ("tool", "i8"),  # −1 before the first T
        # what may be skipped: inside RepRapFirmware's `if` and `while` the outer one's column, from 1; of placeholders
        # and lines behind a slash minus the number that are open; else 0
        ("block", "i8"),
        ("changed", "i8"),  # UNSURE_*: modes that are others than before, if the lines of the block in hand are obeyed
        ("pushed", "i8"),  # how often M120 stands without its M121
        ("wcs", "i8"),  # row of ``work``
        ("layer", "i8"),  # layer comments seen
        ("role", "i8"),  # ROLE_* by the last comment that says it
        ("rule", "i8"),  # E_*
        ("arc_absolute", "i8"),  # 1 after G90.1
        ("flavour", "i8"),  # FLAVOUR_*
        ("e_is_a", "i8"),  # 1 where A drives the extruder: A and E then stand for each other
        ("tell", "i8"),  # TELL_*: how the file tells the acceleration
        ("noted", "i8"),  # notes that the last call of the interpreter made
        ("numbered", "i8"),  # lines with an N word
        ("checksums", "i8"),  # lines that end in *checksum
        ("saved", np.dtype([("key", "i8"), *_MODAL_COUNTS], align=True), SAVED_SLOTS),  # 0 for a free slot
    ],
    align=True,
)
# What is unknown beside places and shifts: the file does not say it, or only where it may not be obeyed.
UNSURE_AXES, UNSURE_E_MODE, UNSURE_UNIT = 1, 2, 4  # G90 or G91, M82 or M83, G20 or G21
UNSURE_PLANE, UNSURE_CENTRE, UNSURE_MOTION = 8, 16, 32  # G17 to G19, G90.1 or G91.1, the motion in force
UNSURE_FEED, UNSURE_E = 64, 128  # the modal F, and the number that E stands at
UNSURE_WORK, UNSURE_TOOL = 256, 512  # G54 to G59.3, and the tool
UNSURE_OF_TWO = UNSURE_AXES | UNSURE_E_MODE | UNSURE_UNIT | UNSURE_CENTRE  # modes that are one thing or the other
UNSURE_PLAIN = UNSURE_AXES | UNSURE_E_MODE | UNSURE_UNIT | UNSURE_MOTION | UNSURE_FEED | UNSURE_E  # of `G1 X… E…`
UNSURE_AHEAD = UNSURE_AXES | UNSURE_E_MODE | UNSURE_UNIT | UNSURE_PLANE | UNSURE_CENTRE | UNSURE_MOTION | UNSURE_FEED
UNSURE_PUSHED = UNSURE_AXES | UNSURE_E_MODE | UNSURE_FEED  # of what M120 keeps
UNSURE_SAVED = UNSURE_PUSHED | UNSURE_E  # of what SAVE_GCODE_STATE keeps
# What is said beside the motion: no record, for nothing stands between two moves because of it.
NOTE_VALUES = 5
NOTE = np.dtype(
    [
        ("record", "i8"),  # the record of the same call before which it stands
        ("begin", "i8"),  # its first byte in the chunk
        ("end", "i8"),  # and its end, the line end excluded
        ("what", "i8"),  # NOTE_*
        ("values", "f8", NOTE_VALUES),  # NaN where not given
    ],
    align=True,
)
NO_NOTES = np.empty(0, NOTE)
NOTES_A_LINE = 8  # the least room for the notes of one line; further ones may be dropped
NOTE_TIME = 1  # M73, or a comment that tells a printing time
NOTE_DWELL = 2  # G4: seconds, of P and of S
NOTE_PERCENT = 3  # M220: the share of all speeds [%]
NOTE_SPEEDS = 4  # M203: the largest of X Y Z E, in the firmware's unit
NOTE_ACCELS = 5  # M201: of X Y Z E [mm/s²]
NOTE_CORNERS = 6  # M205, M566: the jump of speed of X Y Z E, in the firmware's unit; J, the junction deviation [mm]
NOTE_ACCEL = 7  # M204: P T R S [mm/s²]
NOTE_LIMITS = 8  # SET_VELOCITY_LIMIT: velocity, acceleration, square corner velocity, cruise ratio, accel to decel

MAX_CODE_BYTES = 512  # of a statement without its comment

# Where a word's value stands among the 26 that a statement may have, and its bit among a record's words: its letter's
# place in the alphabet.
VALUE_A, VALUE_B, VALUE_C, VALUE_U, VALUE_V, VALUE_W = 0, 1, 2, 20, 21, 22
VALUE_D, VALUE_E, VALUE_F, VALUE_G, VALUE_H, VALUE_I, VALUE_J, VALUE_K, VALUE_L = 3, 4, 5, 6, 7, 8, 9, 10, 11
VALUE_M, VALUE_N, VALUE_O, VALUE_P, VALUE_Q, VALUE_R, VALUE_S, VALUE_T = 12, 13, 14, 15, 16, 17, 18, 19
VALUE_X, VALUE_Y, VALUE_Z = 23, 24, 25
WORD_D, WORD_E, WORD_F, WORD_G, WORD_H = 1 << VALUE_D, 1 << VALUE_E, 1 << VALUE_F, 1 << VALUE_G, 1 << VALUE_H
WORD_I, WORD_J, WORD_K, WORD_L = 1 << VALUE_I, 1 << VALUE_J, 1 << VALUE_K, 1 << VALUE_L
WORD_M, WORD_N = 1 << VALUE_M, 1 << VALUE_N
WORD_O, WORD_P, WORD_Q, WORD_R, WORD_S = 1 << VALUE_O, 1 << VALUE_P, 1 << VALUE_Q, 1 << VALUE_R, 1 << VALUE_S
WORD_T, WORD_X, WORD_Y, WORD_Z = 1 << VALUE_T, 1 << VALUE_X, 1 << VALUE_Y, 1 << VALUE_Z
WORDS_XYZ, WORDS_IJK = WORD_X | WORD_Y | WORD_Z, WORD_I | WORD_J | WORD_K
# of further axes
WORDS_FURTHER = 1 << VALUE_A | 1 << VALUE_B | 1 << VALUE_C | 1 << VALUE_U | 1 << VALUE_V | 1 << VALUE_W
WORDS_MOVING = WORDS_XYZ | WORD_E | WORD_F
WORDS_ALL = (1 << 26) - 1
WORD_ITSELF = 1 << 26  # stands among unclear words for the command: whether it is obeyed is unknown

# One piece of what replaces a statement's motion, in order of motion; a statement without pieces stays as it is.
PIECE = np.dtype(
    [
        ("x", "f8"),  # end [machine mm]; an axis that keeps its original end must hold exactly that number
        ("y", "f8"),
        ("z", "f8"),
        ("share", "f8"),  # part of the statement's E; over all its pieces the shares sum to 1
        ("feed", "f8"),  # [mm/min]; 0 keeps the statement's own
        ("accel", "f8"),  # [mm/s²]; 0 keeps the machine's own
        ("c0", "f8"),  # arc centre [machine mm], for PIECE_ARC
        ("c1", "f8"),
        ("kind", "u1"),  # PIECE_*
    ]
)
PIECE_LINE, PIECE_ARC, PIECE_TRAVEL = 0, 1, 2  # travel: no E, before or after the statement's own motion

# The state of the machine that reads the output.
_SHIFTED_PLACE = np.dtype([("place", "f8", 3), ("shift", "f8", 3)])
WRITER = np.dtype(
    [
        ("place", "f8", 3),  # where it is after what was written [machine mm]; NaN where that is not certain
        ("shift", "f8", 3),  # how far G92 on a mended place shifted its coordinates [mm]
        ("feed", "f8"),  # modal F [mm/min]
        ("accel", "f8"),  # of a crossing [mm/s²], 0 while the file's own holds
        ("modal", "i8"),  # the motion in force, as in COUNTS
        ("crlf", "i8"),  # 1 where the last line ended in CR and LF
        ("numbered", "i8"),  # 1 where lines have numbers
        ("e_debt", "f8"),  # relative E lost to rounding so far, in steps of E
        ("saved", _SHIFTED_PLACE, SAVED_SLOTS),  # for each slot the place and the shift when it was saved
    ],
    align=True,
)
