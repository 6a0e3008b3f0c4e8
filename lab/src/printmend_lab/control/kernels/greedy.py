"""Algorithm 1's loops: for each target the control whose imagined position is nearest, the first of equals.

Arrays and scalars in, arrays out; checks happen in greedy.py. Controls are taken in the order of the product
(−c_max…c_max) × (−c_max…c_max) and what is compared is dx² + dy², as published: a root would make ties of sums that
differ by a rounding. All kernels fill controls [T, 2] and imagined [T + 1, 2].
"""

import numpy as np

from printmend.jit import entry, inner
from printmend.machine.kernels.bed import mixed, onto_bed, printed, to_motors, unmixed
from printmend.machine.kernels.lattice import motors_reach
from printmend.machine.kernels.play import clip


@inner(error_model="python", _nrt=True, inline="always")
def first_nearest(ex, ey):
    """Return the first pair (i, j), i before j, with the least ex[i] + ey[j].

    Rounded sums never decrease when a term grows. So the least is min ex + min ey, and i can reach it with some j
    exactly when it does so with the least ey: two short searches instead of one over all pairs.
    """
    least_x, least_y = ex[0], ey[0]
    for i in range(1, ex.shape[0]):
        least_x = min(least_x, ex[i])
    for j in range(1, ey.shape[0]):
        least_y = min(least_y, ey[j])
    least = least_x + least_y
    i = 0
    while ex[i] + least_y != least:
        i += 1
    j = 0
    while ex[i] + ey[j] != least:
        j += 1
    return i, j


@entry
def plan_increments(targets, start, table_x, table_y, controls, imagined):
    """Plan with a table [bed + 1, 2·c_max + 1] of displacements an axis."""
    width = table_x.shape[1]
    c_max = width // 2
    last_x, last_y = table_x.shape[0] - 1, table_y.shape[0] - 1
    ex, ey = np.empty(width), np.empty(width)
    nx, ny = start[0], start[1]
    px, py = float(nx), float(ny)
    imagined[0, 0], imagined[0, 1] = px, py
    for t in range(targets.shape[0]):
        tx, ty = targets[t, 0], targets[t, 1]
        for k in range(width):
            dx = tx - (px + table_x[nx, k])
            ex[k] = dx * dx
        for k in range(width):
            dy = ty - (py + table_y[ny, k])
            ey[k] = dy * dy
        i, j = first_nearest(ex, ey)
        px += table_x[nx, i]
        py += table_y[ny, j]
        nx = min(max(nx + i - c_max, 0), last_x)
        ny = min(max(ny + j - c_max, 0), last_y)
        controls[t, 0], controls[t, 1] = i - c_max, j - c_max
        imagined[t + 1, 0], imagined[t + 1, 1] = px, py


@inner(error_model="python", _nrt=True, inline="always")
def reach(position, motor, c_max, lower, upper, out):
    """Fill out [2·c_max + 1] with the positions after each control; NaN where the motor would leave its tables."""
    for k in range(out.shape[0]):
        m = motor + k - c_max
        if 0 <= m < lower.shape[0]:
            out[k] = clip(position, lower[m], upper[m])
        else:
            out[k] = np.nan


@entry
def plan_play(targets, machine, c_max, controls, imagined):
    """Plan with a `Lattice` whose axes do not couple."""
    width = 2 * c_max + 1
    qx, qy, ex, ey = np.empty(width), np.empty(width), np.empty(width), np.empty(width)
    mx, my, px, py = machine.start_a, machine.start_b, machine.origin_a, machine.origin_b
    lower_x, upper_x, lower_y, upper_y = machine.lower_a, machine.upper_a, machine.lower_b, machine.upper_b
    imagined[0, 0], imagined[0, 1] = px, py
    for t in range(targets.shape[0]):
        reach(px, mx, c_max, lower_x, upper_x, qx)
        reach(py, my, c_max, lower_y, upper_y, qy)
        for k in range(width):
            dx, dy = targets[t, 0] - qx[k], targets[t, 1] - qy[k]
            ex[k] = np.inf if np.isnan(dx) else dx * dx
            ey[k] = np.inf if np.isnan(dy) else dy * dy
        i, j = first_nearest(ex, ey)
        px, py = qx[i], qy[j]
        mx += i - c_max
        my += j - c_max
        controls[t, 0], controls[t, 1] = i - c_max, j - c_max
        imagined[t + 1, 0], imagined[t + 1, 1] = px, py


@inner(error_model="python", _nrt=True)
def bed_errors(bed, c_max, qa, qb, target_x, target_y, x, y, errors):
    """Fill x, y and errors [(2·c_max + 1)²] with where each control puts the nozzle, and how far that is, squared.

    Controls are in the order of the product, belts qa and qb as `reach` fills them; NaN where a motor cannot go. One
    step after the other over all controls: so each is done on several at once.
    """
    width, span = 2 * c_max + 1, motors_reach(bed, c_max)
    corexy = bed.corexy != 0.0
    for i in range(width):
        for j in range(width):
            ca, cb = mixed(corexy, i - c_max, j - c_max)
            x[i * width + j], y[i * width + j] = unmixed(corexy, qa[ca + span], qb[cb + span])
    if bed.framed != 0.0:
        for n in range(x.shape[0]):
            x[n], y[n] = onto_bed(bed, x[n], y[n])
    for n in range(x.shape[0]):
        dx, dy = target_x - x[n], target_y - y[n]
        errors[n] = dx * dx + dy * dy


@entry
def plan_both(targets, machine, c_max, controls, imagined):
    """Plan with any `Lattice`: motors may couple, on a CoreXY or behind a crooked frame."""
    bed = machine.bed
    span = motors_reach(bed, c_max)
    qa, qb = np.empty(2 * span + 1), np.empty(2 * span + 1)
    width = 2 * c_max + 1
    x, y, errors = np.empty(width * width), np.empty(width * width), np.empty(width * width)
    ma, mb, pa, pb = machine.start_a, machine.start_b, machine.origin_a, machine.origin_b
    lower_a, upper_a, lower_b, upper_b = machine.lower_a, machine.upper_a, machine.lower_b, machine.upper_b
    imagined[0, 0], imagined[0, 1] = printed(bed, pa, pb)
    for t in range(targets.shape[0]):
        reach(pa, ma, span, lower_a, upper_a, qa)
        reach(pb, mb, span, lower_b, upper_b, qb)
        bed_errors(bed, c_max, qa, qb, targets[t, 0], targets[t, 1], x, y, errors)
        best, least = 0, np.inf
        for n in range(errors.shape[0]):
            if errors[n] < least:
                best, least = n, errors[n]
        cx, cy = best // width - c_max, best % width - c_max
        ca, cb = to_motors(bed, cx, cy)
        controls[t, 0], controls[t, 1] = cx, cy
        pa, pb = qa[ca + span], qb[cb + span]
        ma += ca
        mb += cb
        imagined[t + 1, 0], imagined[t + 1, 1] = printed(bed, pa, pb)


@inner(error_model="python", _nrt=True, inline="always")
def sign(c):
    """Return −1, 0 or 1."""
    return (c > 0) - (c < 0)


@inner(error_model="python", _nrt=True, inline="always")
def joint_displacement(nx, ny, cx, cy, cells_x, cells_y, unit, rolled):
    """Return the displacement of control (cx, cy) from nominal (nx, ny) by the one-tick table."""
    if not rolled:
        u = unit[cells_x[nx], cells_y[ny], sign(cx) + 1, sign(cy) + 1]
        return u[0] * abs(cx), u[1] * abs(cy)
    dx = dy = 0.0
    for tick in range(max(abs(cx), abs(cy))):
        sx = sign(cx) if tick < abs(cx) else 0
        sy = sign(cy) if tick < abs(cy) else 0
        u = unit[cells_x[nx], cells_y[ny], sx + 1, sy + 1]
        dx += u[0]
        dy += u[1]
        nx = min(max(nx + sx, 0), cells_x.shape[0] - 1)
        ny = min(max(ny + sy, 0), cells_y.shape[0] - 1)
    return dx, dy


@entry
def plan_joint(targets, start, cells_x, cells_y, unit, rolled, c_max, controls, imagined):
    """Plan with a table of one-tick displacements over both axes."""
    nx, ny = start[0], start[1]
    px, py = float(nx), float(ny)
    imagined[0, 0], imagined[0, 1] = px, py
    for t in range(targets.shape[0]):
        tx, ty = targets[t, 0], targets[t, 1]
        least = np.inf
        best_x, best_y, best_dx, best_dy = 0, 0, 0.0, 0.0
        for cx in range(-c_max, c_max + 1):
            for cy in range(-c_max, c_max + 1):
                dx, dy = joint_displacement(nx, ny, cx, cy, cells_x, cells_y, unit, rolled)
                rx, ry = tx - (px + dx), ty - (py + dy)
                value = rx * rx + ry * ry
                if value < least:
                    least, best_x, best_y, best_dx, best_dy = value, cx, cy, dx, dy
        px += best_dx
        py += best_dy
        nx = min(max(nx + best_x, 0), cells_x.shape[0] - 1)
        ny = min(max(ny + best_y, 0), cells_y.shape[0] - 1)
        controls[t, 0], controls[t, 1] = best_x, best_y
        imagined[t + 1, 0], imagined[t + 1, 1] = px, py
