"""What the kernels of the clock share: the machine's limits, the queue of moves, and where the clock is."""

import numpy as np

KLIPPER, JERK, DEVIATION, RRF = 0, 1, 2, 3
"""How a firmware takes corners: Klipper; Marlin by jerk or by junction deviation; RepRapFirmware."""

# Axes are X, Y, Z, E. Speeds are mm/s, accelerations mm/s².
LIMITS = np.dtype(
    [
        ("corner", "i8"),  # KLIPPER, JERK, DEVIATION or RRF
        ("blocks", "i8"),  # moves that the firmware's own queue holds; Klipper's holds all that matter
        ("speed", "f8", 4),
        ("accel", "f8", 4),
        ("print_accel", "f8"),
        ("travel_accel", "f8"),
        ("retract_accel", "f8"),
        ("jump", "f8", 4),  # of speed, which an axis does at once
        ("deviation", "f8"),  # at a junction [mm]
        ("velocity", "f8"),  # Klipper: of the head
        ("corner_speed", "f8"),  # Klipper: at a right angle
        ("cruise_ratio", "f8"),  # Klipper: the least share of cruising in a move that speeds up and slows down
        ("percent", "f8"),  # M220
        ("arc_mm", "f8"),  # the length of an arc's chords
    ],
    align=True,
)
# A move that waits for its neighbours. Squares of speeds are mm²/s².
MOVE = np.dtype(
    [
        ("length", "f8"),  # [mm]
        ("unit", "f8", 4),  # mm of each axis per mm
        ("speed", "f8"),
        ("accel", "f8"),
        ("deviation", "f8"),  # Klipper: at a junction [mm], by the limits of its time
        ("safe", "f8"),  # Marlin: the speed to which each axis may jump from rest
        ("corner2", "f8"),  # the largest squared speed at which it may begin, by the corner before it
        ("gain2", "f8"),  # by how much the squared speed changes over it at full acceleration
        ("soft2", "f8"),  # the same with Klipper's smaller acceleration for moves that speed up and slow down
        ("start2", "f8"),  # Klipper: the largest squared speed at its start, by what came before
        ("soft_start2", "f8"),
        ("before", "i8"),  # the notes of time that stand before it
        # found when the moves after it are known
        ("begin2", "f8"),
        ("soft_begin2", "f8"),
        ("peak2", "f8"),
    ],
    align=True,
)
QUEUE = 4096  # moves: beyond the last thousand of them nothing has to brake yet
AHEAD = 1024
TIMES = 100_000  # notes of time whose seconds are kept
CLOCK = np.dtype(
    [
        ("seconds", "f8"),  # of all moves that are done
        ("queued", "i8"),
        ("notes", "i8"),  # of time, seen
        ("noted", "i8"),  # and done
        ("at", "f8", 3),  # the commanded place [mm], NaN where unknown
        ("begin2", "f8"),  # the squared speed at which the queue's first move begins
        ("peak2", "f8"),  # Klipper: the largest squared speed of moves that only slow down, from the moves before
    ],
    align=True,
)
FIRST_FEED_MM_MIN = 1500.0  # of a file that moves before it names F
LEAST_SPEED_MM_S = 0.05  # Marlin's and RRF's, at a stop
EXTRUDER_CORNER_MM_S = 1.0  # Klipper's instantaneous_corner_velocity, as it is unless set
NO_MOVE_MM = 1e-9
