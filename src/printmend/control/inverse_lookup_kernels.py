"""Compiled look-ups of a mechanism: forwards and backwards through its play, its frame and its motors.

`Lookup` holds a `printmend.mechanism.Mechanism` as arrays. Imports numpy and numba only.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

LOWER, UPPER = 0, 1


class Lookup(NamedTuple):
    """A mechanism as arrays, for both motors and both branches of play.

    ``branch`` [2, 2, N] the tables; ``guide`` [2, 2, G] the first entry that is ≥ ``floor + k·pitch``;
    ``floor`` [2, 2]; ``grid`` [2, 3] first motor position, 1/pitch, last index; ``bend`` [2, B] the largest curvature
    [1/mm] of both branches in each run of `BEND_BLOCK` entries; ``frame`` [2, 10] and ``frame_scale``;
    ``bed`` [4] x and y limits; ``sample_mm`` how densely a chord must be looked at.
    """

    branch: np.ndarray
    guide: np.ndarray
    floor: np.ndarray
    grid: np.ndarray
    bend: np.ndarray
    frame: np.ndarray
    frame_scale: float
    bed: np.ndarray
    sample_mm: float
    corexy: bool
    framed: bool
    shifts_only: bool  # constant play and nothing else: arcs stay arcs


BEND_BLOCK = 64


@njit
def forward(model, motor, branch, m):
    """Return the belt position [mm] of a branch at motor position m [mm]; beyond the table the slope is 1."""
    place = (m - model.grid[motor, 0]) * model.grid[motor, 1]
    last = model.grid[motor, 2]
    table = model.branch[motor, branch]
    if place <= 0.0:
        return table[0] + (m - model.grid[motor, 0])
    if place >= last:
        return table[np.int64(last)] + (place - last) / model.grid[motor, 1]
    i = np.int64(place)
    part = place - i
    return table[i] + part * (table[i + 1] - table[i])


@njit
def backward(model, motor, branch, u):
    """Return the motor position [mm] at which a branch is at u [mm]: the inverse of `forward`."""
    table = model.branch[motor, branch]
    last = np.int64(model.grid[motor, 2])
    first = model.grid[motor, 0]
    rate = model.grid[motor, 1]
    if u <= table[0]:
        return first + (u - table[0])
    if u >= table[last]:
        return first + last / rate + (u - table[last])
    k = np.int64((u - model.floor[motor, branch]) * rate)
    i = np.int64(model.guide[motor, branch, max(k, 0)])
    while table[i] < u:
        i += 1
    if i == 0:
        return first
    below = table[i - 1]
    return first + (i - 1 + (u - below) / (table[i] - below)) / rate


@njit
def clipped(model, motor, m, u):
    """Move a motor to m: the belt position that follows from u (physics.md eq. 7)."""
    return min(max(u, forward(model, motor, LOWER, m)), forward(model, motor, UPPER, m))


@njit
def onto_bed(model, x, y):
    """Map a place given by the belts to the bed: the frame's polynomial."""
    if not model.framed:
        return x, y
    p, q = x / model.frame_scale, y / model.frame_scale
    a, b = model.frame[0], model.frame[1]
    pp, pq, qq = p * p, p * q, q * q
    dx = a[0] + a[1] * p + a[2] * q + a[3] * pp + a[4] * pq + a[5] * qq + (a[6] * p + a[7] * q) * pp + (a[8] * p + a[9] * q) * qq
    dy = b[0] + b[1] * p + b[2] * q + b[3] * pp + b[4] * pq + b[5] * qq + (b[6] * p + b[7] * q) * pp + (b[8] * p + b[9] * q) * qq
    return x + dx, y + dy


@njit
def _slopes(row, p, q, scale):
    along_p = row[1] + 2 * row[3] * p + row[4] * q + 3 * row[6] * p * p + 2 * row[7] * p * q + row[8] * q * q
    along_q = row[2] + row[4] * p + 2 * row[5] * q + row[7] * p * p + 2 * row[8] * p * q + 3 * row[9] * q * q
    return along_p / scale, along_q / scale


@njit
def off_bed(model, x, y):
    """Return the place by the belts whose image on the bed is (x, y): Newton's method on `onto_bed`."""
    if not model.framed:
        return x, y
    u, v = x, y
    for _ in range(20):
        at_x, at_y = onto_bed(model, u, v)
        ex, ey = x - at_x, y - at_y
        p, q = u / model.frame_scale, v / model.frame_scale
        xx, xy = _slopes(model.frame[0], p, q, model.frame_scale)
        yx, yy = _slopes(model.frame[1], p, q, model.frame_scale)
        xx += 1.0
        yy += 1.0
        area = xx * yy - xy * yx
        u += (yy * ex - xy * ey) / area
        v += (xx * ey - yx * ex) / area
        if abs(ex) + abs(ey) < 1e-10:
            break
    return u, v


@njit
def to_motors(model, x, y):
    """Map a place by the belts to motor coordinates: CoreXY a = x + y, b = x − y (physics.md eq. 13)."""
    if model.corexy:
        return x + y, x - y
    return x, y


@njit
def from_motors(model, a, b):
    """Invert `to_motors`."""
    if model.corexy:
        return (a + b) / 2, (a - b) / 2
    return a, b


@njit
def printed(model, u0, u1):
    """Return the place on the bed for belt positions u0, u1 of the two motors."""
    x, y = from_motors(model, u0, u1)
    return onto_bed(model, x, y)


@njit
def wanted(model, x, y):
    """Return the belt positions of the two motors that put the nozzle at (x, y) on the bed."""
    u, v = off_bed(model, x, y)
    return to_motors(model, u, v)


@njit
def sharpest(model, motor, m0, m1):
    """Return the largest curvature [1/mm] of a motor's branches between two motor positions."""
    rate, last = model.grid[motor, 1], model.bend.shape[1] - 1
    i = np.int64((min(m0, m1) - model.grid[motor, 0]) * rate) // BEND_BLOCK
    j = np.int64((max(m0, m1) - model.grid[motor, 0]) * rate) // BEND_BLOCK
    i, j = min(max(i, 0), last), min(max(j, 0), last)
    most = 0.0
    for k in range(i, j + 1):
        most = max(most, model.bend[motor, k])
    return most
