"""What the kernels of the continuous planner share: tolerances, and the fields of their state."""

import numpy as np

TOLERANCE_MM = 0.01  # how far the path may be off: half of it where a chord bulges, all where slack is crossed

ALONG = 10.0  # times that: how far it may be ahead or behind, so that the extrusion keeps its density
HOLD_MM = 0.005  # a belt is where it should be, or is known to be, within this
HOME_MM = 0.05  # a learned origin this near to the end stop's is the same
MIN_PIECE_MM = 0.08  # firmwares drop or merge shorter moves: Marlin those of fewer than six micro-steps, 0.075 mm
NEAR_MM = 0.005  # a stretch that begins or ends this near is here
SURE_MM = 0.001  # a belt that will end this near to where it is wanted will be there
CLAMP_MM = 0.02  # held back at the edge of the bed by less is not worth a word
ASTRAY_MM = 0.05  # only the edge of the bed keeps an extruding command that far from its line
SAME_FEED = 0.005  # a change of speed below half a percent is not worth a word
CHORDS_A_RECORD = 8192  # that one move is cut into, at the most, were it straight
PIECES_A_RECORD = 32768  # that it may become: a rest and two dead moves at each turn and each part of a rise, too
FILAMENT_AREA_MM2 = 2.405  # of 1.75 mm
MAX_AREA_MM2 = 0.63  # Klipper's max_extrude_cross_section for a 0.4 mm nozzle is 0.64
TINY_ADVANCE_MM = 0.1  # Klipper lets any shorter extrusion pass
SAMPLE_MM = 2.0  # the prediction looks at the path at least this often, and at the middle of every command,
FINEST_SAMPLE_MM = 0.1  # more often where the machine's map bends, but never more often than this,
SEEN_MM = 0.001  # and at three places of a command where the last one was further off than this
WALK_MM = 4.0  # and for the nearest place of the path this far around
ERROR_BINS, ERROR_BIN_MM = 8192, 0.001

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
        ("held", "f8", 2),  # the length held back at the edge [mm]: before any layer comment, and after it
        # of each motor that crosses its slack while the nozzle prints on: where it is at t = 0 of the curve, and how
        # far it goes until t = 1 [mm]
        ("cross", "f8", 2),
        ("crossing", "f8", 2),
    ],
    align=True,
)
UNKNOWN_LINES = 3  # of the lines that `unknown` counts the first so many are kept
COUNTS = np.dtype(
    [
        ("known", "i8"),  # 1 or 0: where x and y are, is known
        ("height", "i8"),  # 1 or 0: where Z is, is known
        ("anywhere", "i8"),  # 1 or 0: the firmware may have skipped what came before
        ("mark", "i8"),  # the layer comments seen
        ("layer", "i8"),  # the row of `layers`
        # sums for the prediction
        *((name, "i8") for name in ("moves", "pieces", "takeups", "anchors", "clamped", "clamped_extruding")),
        *((name, "i8") for name in ("unknown", "copied", "extruding", "splines", "geometry", "stops", "coarse")),
        ("unknown_at", "i8", UNKNOWN_LINES),  # lines of the file, from 1
    ],
    align=True,
)
# layers [?, LAYER] float64: sums over a layer, before (0) and after (1); L_RISE are those of the error in height
L_Z, L_LENGTH, L_SQUARE, L_MOST, L_RISE, L_RISE_MOST = 0, 1, 2, 4, 6, 8
LAYER = 10
# samples [1 + SAMPLES, SAMPLE] float64: places along the extruded path, at even distances. Row 0 is the head: how many
# there are, the distance, the length since the last. P_X, P_Y the wanted place, P_TX and P_TY the unit tangent, P_OFF
# by how much the file as it is lies to the left of the path there, P_SIDE the sides that the motors push,
# P_LAYER the row of `layers`, P_WEIGHT the length of path that it stands for.
P_X, P_Y, P_TX, P_TY, P_OFF, P_SIDE, P_LAYER, P_WEIGHT = 0, 1, 2, 3, 4, 5, 7, 8
SAMPLE, SAMPLES = 9, 2048
P_COUNT, P_GAP, P_SINCE = 0, 1, 2
# run [RUN_ROWS, RUN] float64: a connected extruded path, and the turns of both motors on it (see `turns`). Row 0 is the
# head: RUN_BEGIN how far along the path its present record begins [mm], RUN_END the first record after it, and for each
# motor RUN_AT the row of its next turn, RUN_TREND 1 or −1 where its belt rises or falls until then, 0 where it stands.
# From TURN on for each motor TURNS rows in the order of the path, behind the last one at infinity: the stretch on which
# the slack is crossed (none where it begins and ends at the same place), the trend after it, by how much the belt is
# wanted higher at its end than at its beginning; once the nozzle is there, the motor's place at both ends; and by how
# much the belt rises further beforehand than it is to, below 0 at a corner whose tip it does not reach; and where the
# corner is, at infinity for a turn that is none; the share of the slack that is crossed before it, the slack [mm] and
# the path's node there. From NODE on the path itself, straight from one to the next: s [mm], the belts [mm], 1 at the
# end of a move.
# Between such paths its nodes are the legs of a travel (see `travel`), RUN_TRAVEL the first record after it, RUN_LEG
# the row of the next leg: where the motors go and where their belts are wanted at its end [mm], and its length [mm].
RUN_BEGIN, RUN_END, RUN_AT, RUN_TREND, RUN_TRAVEL, RUN_LEG = 0, 1, 2, 4, 6, 7
LEG_TO, LEG_BELT, LEG_LENGTH, LEGS = 0, 2, 4, 64
TURN_BEGIN, TURN_END, TURN_TREND, TURN_RISE, TURN_FROM, TURN_TO, TURN_TIP, TURN_CORNER = range(8)
TURN_SHARE, TURN_SLACK, TURN_NODE = 8, 9, 10
RUN, TURNS, NODES = 11, 2048, 9216
TURN, NODE = 1, 1 + 2 * TURNS
RUN_ROWS = NODE + NODES
