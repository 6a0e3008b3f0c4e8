"""Compiled look-ups of a mechanism: forwards and backwards through its play, its frame and its motors.

`printmend.plan.inverse.lookup` makes a `Model` from a `Mechanism`. Imports numpy and numba only.
"""

from typing import NamedTuple

import numpy as np

from printmend.jit import inner
from printmend.machine.kernels import bed
from printmend.machine.kernels.table import branch_at

LOWER, UPPER = 0, 1
ROLES, TRAVEL = 8, 7  # of lines, as the records' flags have them; and of travels
PULSES = 5  # of an input shaper, at most
BEND_BLOCK = 64  # one curvature stands for that many entries of the tables
# How much more of a tolerance lines of each role may have where time or moves are short, by what is seen: choices of
# ours for lines without a type, outer and inner walls, solid and sparse infill, what stands aside, and travels.
SPARE = (1.0, 0.25, 2.0, 4.0, 16.0, 16.0, 0.0, 0.0)
COARSEST_MM = 0.2  # the largest tolerance: half a line's width
SHARP = 1.5  # 1/mm: a machine that bends more draws more coarsely even what has nothing to spare; a choice of ours

# A machine in numbers. What is [3] belongs to a motor, Z the third where there is a screw, what is [3, 2] to a motor
# and one of its branches. `table`, `guide`, `bend` and `push` say where something begins in `Model.tables`.
HEAD = np.dtype(
    [
        ("bed", "f8", 4),  # limits of x and of y [mm]
        ("bed_map", bed.BED),  # how the belts reach the bed, as `machine.kernels.bed` takes it
        ("shifts_only", "f8"),  # 1 or 0: constant play and nothing else
        ("bent", "f8"),  # how sharply a motor's branches bend on average, the worse motor's [1/mm]
        ("frame_bend", "f8"),  # the frame's largest curvature [1/mm]
        ("home", "f8", 2),  # the home position [mm]
        ("home_side", "f8", 2),  # signs of the last move of x and of y while homing
        ("first", "f8", 3),  # first motor position of the tables [mm]
        ("rate", "f8", 3),  # 1/pitch of the tables [1/mm]
        ("last", "i8", 3),  # last index of the tables
        ("taut", "f8", 3),  # 1 where both branches are the same
        ("bend", "i8", 3),  # the curvatures, one a block
        ("bend_last", "i8", 3),  # their last index
        ("table", "i8", (3, 2)),  # belt positions [mm]
        ("floor", "f8", (3, 2)),  # the lowest of them [mm]
        ("guide", "i8", (3, 2)),  # entry k is the index of the first entry of the table that is ≥ floor + k·pitch
        ("chord", "f8"),  # how far a chord may lie from the wanted path [mm], of the line in hand
        ("chords", "f8", ROLES),  # the same of lines of each role, of travels the last
        ("even", "f8"),  # 1 or 0: the line in hand is a wall that keeps its width, because it shows
        ("speed", "f8"),  # of the line in hand [mm/s]
        ("accel", "f8"),  # of the line in hand [mm/s²], 0 where it is unknown
        # of the wave of each motor of which an input shaper takes a share: its length [mm], 0 for none, and the
        # shaper's pulses: when they come [s], from their middle, and their shares
        ("ripple", "f8", 2),
        ("pulse_s", "f8", (2, PULSES)),
        ("pulse", "f8", (2, PULSES)),
        ("sample", "f8"),  # how densely a chord must be looked at [mm]
        ("look", "f8"),  # how densely the prediction looks [mm]
        ("crossing", "f8"),  # the largest acceleration of a motor that crosses its slack [mm/s²], 0 for the file's
        ("period", "f8"),  # how much time a move must take at least [min]
        ("screw", "f8"),  # 1 or 0: a Z screw that is not perfect; then also:
        ("rise", "f8"),  # how far it may rise in one straight command [mm]
        ("z_limits", "f8", 2),  # [mm]
        ("z_home", "f8"),  # [mm]
        ("z_home_side", "f8"),  # sign of its last move while homing
        ("push", "i8", 2),  # its push in x and in y [mm]
    ],
    align=True,
)


class Model(NamedTuple):
    """A machine as the planner reads it: its numbers, a record of `HEAD`, and its tables, one after the other."""

    head: np.record
    tables: np.ndarray


@inner
def set_chords(model, tolerance, ease):
    """Write how far lines of each role may be off: half of a tolerance [mm], and more where a move buys little.

    Where branches bend by κ, chords within ε take √(κ/16 ε) moves a mm. Moves and squared errors together cost least
    where ε⁵ ∝ κ s², s being how many times further a line may be off for the same harm. ``ease`` is how much more lines
    are off for a limit on time.
    """
    for role in range(ROLES):
        share = 1.0 + SPARE[role]
        price = max((model.head.bent / SHARP * share * share) ** 0.2, 1.0)
        coarser = min(tolerance * price * (1.0 + ease * SPARE[role]), max(tolerance, COARSEST_MM))
        model.head.chords[role] = coarser / 2.0 if role != TRAVEL else tolerance / 2.0


@inner
def forward(model, motor, branch, m):
    """Return the belt position [mm] of a branch at motor position m [mm]; beyond the table the slope is 1."""
    h = model.head
    return branch_at(model.tables, h.table[motor, branch], h.first[motor], h.rate[motor], h.last[motor], m)


@inner
def backward(model, motor, branch, u):
    """Return the motor position [mm] at which a branch is at u [mm]: the inverse of `forward`."""
    h, tables = model.head, model.tables
    table, last = h.table[motor, branch], h.last[motor]
    first, rate = h.first[motor], h.rate[motor]
    if not u > tables[table]:
        return first + (u - tables[table])
    if u >= tables[table + last]:
        return first + last / rate + (u - tables[table + last])
    i = np.int64(tables[h.guide[motor, branch] + np.int64((u - h.floor[motor, branch]) * rate)])
    while tables[table + i] < u:
        i += 1
    if i == 0:
        return first
    below = tables[table + i - 1]
    rise = tables[table + i] - below
    return first + (i - 1 + (u - below) / rise) / rate


@inner
def is_taut(model, motor):
    """Say whether both branches of a motor are the same."""
    return model.head.taut[motor] != 0.0


@inner
def is_corexy(model):
    return model.head.bed_map.corexy != 0.0


@inner
def is_framed(model):
    """Say whether the frame is crooked."""
    return model.head.bed_map.framed != 0.0


@inner
def is_near(model, x, y):
    """Say whether a place is on the bed or within a bed's length of it: further out nothing is known."""
    wide, deep = model.head.bed[1] - model.head.bed[0], model.head.bed[3] - model.head.bed[2]
    across = model.head.bed[0] - wide <= x <= model.head.bed[1] + wide
    return across and model.head.bed[2] - deep <= y <= model.head.bed[3] + deep


@inner
def to_motors(model, x, y):
    """Map a place by the belts to motor coordinates."""
    return bed.to_motors(model.head.bed_map, x, y)


@inner
def from_motors(model, a, b):
    """Invert `to_motors`."""
    return bed.from_motors(model.head.bed_map, a, b)


@inner
def printed(model, u0, u1):
    """Return the place on the bed for belt positions u0, u1 of the two motors."""
    return bed.printed(model.head.bed_map, u0, u1)


@inner
def wanted(model, x, y):
    """Return the belt positions of the two motors that put the nozzle at (x, y) on the bed."""
    return bed.wanted(model.head.bed_map, x, y)


@inner
def sharpest(model, motor, m0, m1):
    """Return the largest curvature [1/mm] of a motor's branches between two motor positions."""
    h = model.head
    bend, last, rate = h.bend[motor], h.bend_last[motor], h.rate[motor]
    i = np.int64((min(m0, m1) - h.first[motor]) * rate) // BEND_BLOCK
    j = np.int64((max(m0, m1) - h.first[motor]) * rate) // BEND_BLOCK
    most = 0.0
    k, stop = min(max(i, 0), last), min(max(j, 0), last)
    while k <= stop:
        most = max(most, model.tables[bend + k])
        k += 1
    return most
