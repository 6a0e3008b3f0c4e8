"""Compiled look-ups of a mechanism: forwards and backwards through its play, its frame and its motors.

A model here is one array of float64, because a single flat array is the cheapest thing to hand from kernel to kernel:
the fields M_* first, then what belongs to each motor (at `_motor`) and branch (at `_branch`), then the tables.
`printmend.invert.inverse.lookup` makes it from a `Mechanism`. Imports numpy and numba only.
"""

import numpy as np

from printmend.jit import inner
from printmend.machine.kernels import bed
from printmend.machine.kernels.table import branch_at

LOWER, UPPER = 0, 1

# x and y limits [4] · how densely a chord must be looked at [mm] · 1 or 0: constant play and nothing else, curved
# branches · the frame's largest curvature [1/mm] · how the belts reach the bed, as `machine.kernels.bed` takes it
# · the home position [mm] and the signs of x's and y's last move while homing · how densely the prediction looks [mm]
# · 1 or 0: a Z screw that is not perfect, and then: how far it may rise in one straight command [mm], its limits, its
# home position and the sign of its last move while homing, where the tables of its push in x and in y begin
M_BED, M_SAMPLE, M_SHIFTS_ONLY, M_BENT, M_FRAME_BEND, M_MAP = 0, 4, 5, 6, 7, 8
M_COREXY, M_FRAMED = M_MAP + bed.BED_COREXY, M_MAP + bed.BED_FRAMED
M_HOME, M_HOME_SIDE, M_LOOK = 34, 36, 38
M_SCREW, M_RISE, M_Z_LIMITS, M_Z_HOME, M_Z_HOME_SIDE, M_PUSH = 39, 40, 41, 43, 44, 45
# For each motor (0 and 1, and Z the third where there is a screw): first motor position, 1/pitch, last index, where its
# curvatures begin, their last index, 1 where both branches are the same
M_MOTOR, MOTOR_FIELDS = 47, 8
FIRST, RATE, LAST, BEND, BEND_LAST, TAUT = range(6)
# For each motor and branch: where its table begins; the lowest belt position; where its guide begins: entry k is the
# index of the first entry of the table that is ≥ floor + k·pitch
M_BRANCH, BRANCH_FIELDS = 71, 4
TABLE, FLOOR, GUIDE = range(3)
# how far a chord may lie from the wanted path [mm], how much time a move must take at the least [min]
M_CHORD, M_PERIOD = 95, 96
M_TABLES = 97
BEND_BLOCK = 64  # one curvature stands for that many entries of the tables


@inner(error_model="numpy", _nrt=False)
def forward(model, motor, branch, m):
    """Return the belt position [mm] of a branch at motor position m [mm]; beyond the table the slope is 1."""
    at = M_MOTOR + MOTOR_FIELDS * motor
    table = np.int64(model[M_BRANCH + BRANCH_FIELDS * (2 * motor + branch) + TABLE])
    return branch_at(model, table, model[at + FIRST], model[at + RATE], model[at + LAST], m)


@inner(error_model="numpy", _nrt=False)
def backward(model, motor, branch, u):
    """Return the motor position [mm] at which a branch is at u [mm]: the inverse of `forward`."""
    at = M_MOTOR + MOTOR_FIELDS * motor
    side = M_BRANCH + BRANCH_FIELDS * (2 * motor + branch)
    table, last = np.int64(model[side + TABLE]), np.int64(model[at + LAST])
    first, rate = model[at + FIRST], model[at + RATE]
    if not u > model[table]:
        return first + (u - model[table])
    if u >= model[table + last]:
        return first + last / rate + (u - model[table + last])
    i = np.int64(model[np.int64(model[side + GUIDE]) + np.int64((u - model[side + FLOOR]) * rate)])
    while model[table + i] < u:
        i += 1
    if i == 0:
        return first
    below = model[table + i - 1]
    return first + (i - 1 + (u - below) / (model[table + i] - below)) / rate


@inner(error_model="numpy", _nrt=False)
def is_taut(model, motor):
    """Say whether both branches of a motor are the same."""
    return model[M_MOTOR + MOTOR_FIELDS * motor + TAUT] != 0.0


@inner(error_model="numpy", _nrt=False)
def is_near(model, x, y):
    """Say whether a place is on the bed or within a bed's length of it: further out nothing is known."""
    wide, deep = model[M_BED + 1] - model[M_BED], model[M_BED + 3] - model[M_BED + 2]
    across = model[M_BED] - wide <= x <= model[M_BED + 1] + wide
    return across and model[M_BED + 2] - deep <= y <= model[M_BED + 3] + deep


@inner(error_model="numpy", _nrt=False)
def to_motors(model, x, y):
    """Map a place by the belts to motor coordinates."""
    return bed.to_motors(model, M_MAP, x, y)


@inner(error_model="numpy", _nrt=False)
def from_motors(model, a, b):
    """Invert `to_motors`."""
    return bed.from_motors(model, M_MAP, a, b)


@inner(error_model="numpy", _nrt=False)
def printed(model, u0, u1):
    """Return the place on the bed for belt positions u0, u1 of the two motors."""
    return bed.printed(model, M_MAP, u0, u1)


@inner(error_model="numpy", _nrt=False)
def wanted(model, x, y):
    """Return the belt positions of the two motors that put the nozzle at (x, y) on the bed."""
    return bed.wanted(model, M_MAP, x, y)


@inner(error_model="numpy", _nrt=False)
def sharpest(model, motor, m0, m1):
    """Return the largest curvature [1/mm] of a motor's branches between two motor positions."""
    at = M_MOTOR + MOTOR_FIELDS * motor
    rate = model[at + RATE]
    bend, last = np.int64(model[at + BEND]), np.int64(model[at + BEND_LAST])
    i = np.int64((min(m0, m1) - model[at + FIRST]) * rate) // BEND_BLOCK
    j = np.int64((max(m0, m1) - model[at + FIRST]) * rate) // BEND_BLOCK
    most = 0.0
    k, stop = min(max(i, 0), last), min(max(j, 0), last)
    while k <= stop:
        most = max(most, model[bend + k])
        k += 1
    return most
