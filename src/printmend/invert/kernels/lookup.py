"""Compiled look-ups of a mechanism: forwards and backwards through its play, its frame and its motors.

A model here is one array of float64, because a single flat array is the cheapest thing to hand from kernel to kernel:
the fields M_* first, then what belongs to each motor (at `_motor`) and branch (at `_branch`), then the tables.
`printmend.invert.inverse.lookup` makes it from a `Mechanism`. Imports numpy and numba only.
"""

import numpy as np

from printmend.jit import inner

LOWER, UPPER = 0, 1

# x and y limits [4] · how densely a chord must be looked at [mm] · 1 or 0: CoreXY, a frame that is not the identity,
# constant play and nothing else, curved branches · the frame's largest curvature [1/mm], scale and coefficients [2, 10]
# · the home position [mm] and the signs of x's and y's last move while homing · how densely the prediction looks [mm]
# · 1 or 0: a Z screw that is not perfect, and then: how far it may rise in one straight command [mm], its limits, its
# home position and the sign of its last move while homing, where the tables of its push in x and in y begin
M_BED, M_SAMPLE, M_COREXY, M_FRAMED, M_SHIFTS_ONLY, M_BENT, M_FRAME_BEND, M_FRAME_SCALE, M_FRAME = (
    0,
    4,
    5,
    6,
    7,
    8,
    9,
    10,
    11,
)
M_HOME, M_HOME_SIDE, M_LOOK = 31, 33, 35
M_SCREW, M_RISE, M_Z_LIMITS, M_Z_HOME, M_Z_HOME_SIDE, M_PUSH = 36, 37, 38, 40, 41, 42
# For each motor (0 and 1, and Z the third where there is a screw): first motor position, 1/pitch, last index, where its
# curvatures begin, their last index, 1 where both branches are the same
M_MOTOR, MOTOR_FIELDS = 44, 8
FIRST, RATE, LAST, BEND, BEND_LAST, TAUT = range(6)
# For each motor and branch: where its table begins; the lowest belt position; where its guide begins: entry k is the
# index of the first entry of the table that is ≥ floor + k·pitch
M_BRANCH, BRANCH_FIELDS = 68, 4
TABLE, FLOOR, GUIDE = range(3)
M_TABLES = 92
BEND_BLOCK = 64  # one curvature stands for that many entries of the tables


@inner(error_model="numpy", _nrt=False)
def forward(model, motor, branch, m):
    """Return the belt position [mm] of a branch at motor position m [mm]; beyond the table the slope is 1."""
    at = M_MOTOR + MOTOR_FIELDS * motor
    table = np.int64(model[M_BRANCH + BRANCH_FIELDS * (2 * motor + branch) + TABLE])
    place = (m - model[at + FIRST]) * model[at + RATE]
    last = model[at + LAST]
    if not place > 0.0:
        return model[table] + (m - model[at + FIRST])
    if place >= last:
        return model[table + np.int64(last)] + (place - last) / model[at + RATE]
    i = np.int64(place)
    below = model[table + i]
    return below + (place - i) * (model[table + i + 1] - below)


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
def _polynomial(model, a, p, q):
    """Return Σ a_ij p^i q^j in the order of `printmend.machine.mechanism.Frame.exponents`."""
    linear = model[a] + model[a + 1] * p + model[a + 2] * q
    square = model[a + 3] * p * p + model[a + 4] * p * q + model[a + 5] * q * q
    return (
        linear + square + (model[a + 6] * p + model[a + 7] * q) * p * p + (model[a + 8] * p + model[a + 9] * q) * q * q
    )


@inner(error_model="numpy", _nrt=False)
def _slopes(model, a, p, q):
    """Return the derivatives of `_polynomial` by p and q."""
    by_p = model[a + 1] + 2 * model[a + 3] * p + model[a + 4] * q
    by_q = model[a + 2] + model[a + 4] * p + 2 * model[a + 5] * q
    by_p += 3 * model[a + 6] * p * p + 2 * model[a + 7] * p * q + model[a + 8] * q * q
    by_q += model[a + 7] * p * p + 2 * model[a + 8] * p * q + 3 * model[a + 9] * q * q
    return by_p, by_q


@inner(error_model="numpy", _nrt=False)
def onto_bed(model, x, y):
    """Map a place given by the belts to the bed."""
    if model[M_FRAMED] == 0.0:
        return x, y
    p, q = x / model[M_FRAME_SCALE], y / model[M_FRAME_SCALE]
    return x + _polynomial(model, M_FRAME, p, q), y + _polynomial(model, M_FRAME + 10, p, q)


@inner(error_model="numpy", _nrt=False)
def off_bed(model, x, y):
    """Return the place by the belts whose image on the bed is (x, y): Newton's method on `onto_bed`."""
    if model[M_FRAMED] == 0.0:
        return x, y
    u, v = x, y
    scale = model[M_FRAME_SCALE]
    for _ in range(20):
        at_x, at_y = onto_bed(model, u, v)
        ex, ey = x - at_x, y - at_y
        if abs(ex) + abs(ey) < 1e-10:
            break
        xp, xq = _slopes(model, M_FRAME, u / scale, v / scale)
        yp, yq = _slopes(model, M_FRAME + 10, u / scale, v / scale)
        xx, xy, yx, yy = 1.0 + xp / scale, xq / scale, yp / scale, 1.0 + yq / scale
        area = xx * yy - xy * yx
        u += (yy * ex - xy * ey) / area
        v += (xx * ey - yx * ex) / area
    return u, v


@inner(error_model="numpy", _nrt=False)
def is_near(model, x, y):
    """Say whether a place is on the bed or within a bed's length of it: further out nothing is known."""
    wide, deep = model[M_BED + 1] - model[M_BED], model[M_BED + 3] - model[M_BED + 2]
    across = model[M_BED] - wide <= x <= model[M_BED + 1] + wide
    return across and model[M_BED + 2] - deep <= y <= model[M_BED + 3] + deep


@inner(error_model="numpy", _nrt=False)
def to_motors(model, x, y):
    """Map a place by the belts to motor coordinates: CoreXY a = x + y, b = x − y (physics.md eq. 13)."""
    if model[M_COREXY] != 0.0:
        return x + y, x - y
    return x, y


@inner(error_model="numpy", _nrt=False)
def from_motors(model, a, b):
    """Invert `to_motors`."""
    if model[M_COREXY] != 0.0:
        return (a + b) / 2, (a - b) / 2
    return a, b


@inner(error_model="numpy", _nrt=False)
def printed(model, u0, u1):
    """Return the place on the bed for belt positions u0, u1 of the two motors."""
    x, y = from_motors(model, u0, u1)
    return onto_bed(model, x, y)


@inner(error_model="numpy", _nrt=False)
def wanted(model, x, y):
    """Return the belt positions of the two motors that put the nozzle at (x, y) on the bed."""
    u, v = off_bed(model, x, y)
    return to_motors(model, u, v)


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
