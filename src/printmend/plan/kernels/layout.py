"""What the kernels of the continuous planner share: tolerances, and the records that they read and write."""

import numpy as np

# Lengths without a source beside them are choices of ours; commands are written to 0.001 mm.
TOLERANCE_MM = 0.01  # how far the path may be off: half of it where a chord bulges, all where slack is crossed
ALONG_PER_ASIDE = 10.0  # how many times further ahead or behind than aside a chord may be: the extrusion stays dense
HOLD_MM = 0.005  # a belt is where it should be, or its place is known, within this
HOME_MM = 0.05  # a learned origin this near to the end stop's is the same
MIN_PIECE_MM = 0.08  # firmwares drop or merge shorter moves: Marlin those of fewer than six micro-steps, 0.075 mm
NEAR_MM = 0.005  # two places of the path that are this near are one
ARRIVED_MM = 0.001  # a belt that ends this near to where it is wanted is there
CLAMP_MM = 0.02  # a command held back at the edge of the bed by less is not counted
# Only the edge of the bed keeps an extruding command that far from its line, whatever the tolerance allows.
ASTRAY_MM, ASTRAY_PER_CHORD = 0.05, 10.0
FASTER_CROSSING = 1.25  # as a multiple of the file's acceleration: a smaller gain is not written
SAME_FEED = 0.005  # speeds that differ by a smaller share are written as one
CHORDS_A_RECORD = 8192  # into which one move is cut, at most, were it straight
LONGEST_ARC_RAD = 1.6  # of a commanded arc: a quarter of a circle, and what rounding adds
LEAST_ARC_RAD = 0.1  # of one: below it a chord does as well
PIECES_A_RECORD = 32768  # that one move may become: also a rest and two dead moves at each turn and each part of a rise
FILAMENT_AREA_MM2 = 2.405  # of filament of 1.75 mm
MAX_AREA_MM2 = 0.63  # of a line's cross-section: Klipper's max_extrude_cross_section is 0.64 for a nozzle of 0.4 mm
TINY_ADVANCE_MM = 0.1  # of filament: Klipper lets a shorter extrusion pass, whatever its cross-section
SAMPLE_MM = 2.0  # the prediction looks at the path at least this often, and at the middle of every command
FINEST_SAMPLE_MM = 0.1  # it looks more often where the machine's map bends, but no more often than this
LOOK_CLOSER_MM = 0.001  # it looks at three places of a command where the one before was further off than this
NEAREST_REACH_MM = 4.0  # it looks for the nearest place of the path so far before and behind the present move
ERROR_BINS, ERROR_BIN_MM = 8192, 0.001  # of the histogram of contour errors

# Where the motors of one machine are, Z the third, and between which places each belt (or the nozzle, on its screw) is.
BELTS = np.dtype(
    [
        ("m", "f8", 3),  # the motor [mm]
        ("low", "f8", 3),  # its belt is between this [mm]
        ("high", "f8", 3),  # and this
        ("side", "f8", 3),  # 1 or −1 where the motor pushes its belt forwards or backwards, 0 where it may hang loose
    ],
    align=True,
)
SLOTS = 8  # of SAVE_GCODE_STATE
STATE = np.dtype(
    [
        ("mended", BELTS),  # the machine that reads what is written
        ("raw", BELTS),  # the machine that reads the file as it is
        ("travel_feed", "f8"),  # the last F of a travel [mm/min]
        ("feed", "f8"),  # the last F written [mm/min]
        ("layer_z", "f8"),  # the height at which the layer began [mm]
        ("low", "f8", 2),  # the corners of where extruding moves end [mm]
        ("high", "f8", 2),
        ("print_low", "f8", 2),  # the corners of all that is printed, moves from where they begin, and dots [mm]
        ("print_high", "f8", 2),
        ("saved", "f8", (SLOTS, 3)),  # where the three motors were then [mm], NaN for an unknown place
        ("error", "f8"),  # the largest error seen of the last command [mm]
        ("beyond", "f8"),  # how far the furthest extruding command would have left the bed [mm]
        ("drawn", "f8"),  # how much extruded path does not stay as it is [mm]
        ("held", "f8", 2),  # how much path was held back at the edge [mm]: before any layer comment, and after it
        # of each motor that crosses its slack while the nozzle prints on: where it is at t = 0 of the curve, and how
        # far it goes until t = 1 [mm]
        ("cross", "f8", 2),
        ("crossing", "f8", 2),
        ("arc_center", "f8", 2),  # of the arc in hand [mm]
        ("arc_sweep", "f8"),  # [rad]
    ],
    align=True,
)
UNKNOWN_LINES = 3  # how many of the lines that `unknown` counts are kept, the first ones
COUNTS = np.dtype(
    [
        ("known", "i8"),  # 1 or 0: where x and y are, is known
        ("height", "i8"),  # 1 or 0: where Z is, is known
        ("anywhere", "i8"),  # 1 or 0: the firmware may have skipped what came before
        ("mark", "i8"),  # the layer comments seen
        ("layer", "i8"),  # its number among the layers
        # sums for the prediction
        *((name, "i8") for name in ("moves", "pieces", "takeups", "anchors", "clamped", "clamped_extruding")),
        *((name, "i8") for name in ("unknown", "copied", "extruding", "splines", "geometry", "stops", "coarse")),
        ("held_line", "i8"),  # the last line that `clamped` counts, from 1
        ("doubted", "i8"),  # the line that made the first of those uncertain, from 1; 0 for none
        ("unread", "i8"),  # of those that `unknown` counts, the ones whose words do not say all
        ("hurried", "i8"),  # pieces that have an acceleration of their own
        ("roles", "i8"),  # bits: roles of which there are lines
        ("unknown_at", "i8", UNKNOWN_LINES),  # lines of the file, from 1
    ],
    align=True,
)
# What is added up over one layer; [2] are before (0) and after (1) mending.
LAYER = np.dtype(
    [
        ("z", "f8"),  # its height [mm]
        ("length", "f8"),  # of what is extruded [mm]
        ("square", "f8", 2),  # the squared contour error times the length that it stands for [mm³]
        ("most", "f8", 2),  # the largest contour error [mm]
        ("rise_square", "f8", 2),  # the same of the error in height
        ("rise_most", "f8", 2),
    ],
    align=True,
)
STROKES = 4  # as many as `effects.effect` knows of a motor
# A place along the extruded path, which stands for a length of it.
SAMPLE = np.dtype(
    [
        ("place", "f8", 2),  # where it is wanted [mm]
        ("tangent", "f8", 2),  # of the path there, a unit vector
        ("off", "f8"),  # how far to the left of the path the file as it is prints [mm]
        ("side", "f8", 2),  # as in BELTS
        ("ways", "f8", 2),  # those of SAMPLES before its move
        ("strokes", "f8", (2, STROKES)),  # those of SAMPLES there
        ("layer", "i8"),  # its number among the layers
        ("weight", "f8"),  # the length [mm]
    ],
    align=True,
)
KEPT_SAMPLES = 2048  # an even number: where they are full every other one goes
SAMPLES = np.dtype(
    [
        ("count", "i8"),  # how many there are
        ("gap", "f8"),  # the distance between two of them [mm]
        ("since", "f8"),  # the length of path since the last one [mm]
        ("ways", "f8", 2),  # in which each axis of the bed went last, 1 or −1; 0 for none
        ("trend", "f8", 2),  # which way each motor went last, 1 or −1; 0 for none
        # how far each has gone since it last turned round, since the time before, … [mm]
        ("strokes", "f8", (2, STROKES)),
        ("kept", SAMPLE, KEPT_SAMPLES),
    ],
    align=True,
)
# A place where a motor turns back, and the stretch of path on which its slack is crossed; empty if both ends are equal.
TURN = np.dtype(
    [
        (
            "begin",
            "f8",
        ),  # where the stretch begins and ends, as a length of the path [mm]; behind the last turn infinity
        ("end", "f8"),
        ("trend", "f8"),  # as in RUN, after the turn
        ("rise", "f8"),  # how much higher the belt is wanted at the end of the stretch than at its beginning [mm]
        ("motor_begin", "f8"),  # where the motor is at both ends [mm]; NaN until the nozzle is there
        ("motor_end", "f8"),
        # how far the belt overshoots before the stretch, below 0 at a corner whose tip it does not reach
        ("tip", "f8"),
        ("corner", "f8"),  # where the corner is, as a length of the path [mm]; infinity for a turn without one
        ("share", "f8"),  # of the slack that is crossed before the corner
        ("slack", "f8"),  # [mm]
        ("node", "i8"),  # the number of the path's node there
    ],
    align=True,
)
# A node of the path, which is straight from one to the next.
NODE = np.dtype(
    [
        ("s", "f8"),  # the length of path to there [mm]
        ("belt", "f8", 2),  # where the belts are wanted [mm]
        ("ends_move", "i8"),  # 1 or 0: it is the end of a move of the file
    ],
    align=True,
)
# A leg of a travel (see `travel`).
LEG = np.dtype(
    [
        ("motor", "f8", 2),  # where the motors go [mm]; NaN: as far as their belts have to
        ("belt", "f8", 2),  # where the belts are wanted at its end [mm]
        ("length", "f8"),  # [mm]
    ],
    align=True,
)
TURNS, NODES, LEGS = 2048, 9216, 64  # of one path and one motor, of one path, of one travel: a longer one is cut there
# What has been seen ahead: a connected extruded path with the turns of both motors on it, or the legs of a travel.
RUN = np.dtype(
    [
        ("begin", "f8"),  # where the present record begins, as a length of the path [mm]
        ("end", "i8"),  # the first record after the path
        ("turn", "i8", 2),  # of each motor the number of its next turn
        ("trend", "f8", 2),  # 1 or −1 where its belt rises or falls until then, 0 where it stands
        ("travel_end", "i8"),  # the first record after the travel
        ("leg", "i8"),  # the number of its next leg
        ("turns", TURN, (2, TURNS)),  # of each motor, in the order of the path
        ("nodes", NODE, NODES),
        ("legs", LEG, LEGS),
    ],
    align=True,
)
