"""Algorithm 1's loops: for each target the control whose imagined position is nearest, the first of equals.

Arrays and scalars in, arrays out; checks happen in greedy.py. Controls are taken in the order of the product
(−c_max…c_max) × (−c_max…c_max) and what is compared is dx² + dy², as published: a root would make ties of sums that
differ by a rounding. All kernels fill controls [T, 2] and imagined [T + 1, 2].
"""

import numpy as np

from printmend.jit import entry, inner


@inner(inline="always")
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


@inner(inline="always")
def reach(position, motor, c_max, lower, upper, out):
    """Fill out [2·c_max + 1] with the positions after each control; NaN where the motor would leave its tables."""
    for k in range(out.shape[0]):
        m = motor + k - c_max
        if 0 <= m < lower.shape[0]:
            out[k] = min(max(position, lower[m]), upper[m])
        else:
            out[k] = np.nan


@entry
def plan_play(targets, start, mx, my, lower_x, upper_x, lower_y, upper_y, c_max, controls, imagined):
    """Plan with play tables of two axes that do not couple; (mx, my) are the motors' first indices."""
    width = 2 * c_max + 1
    qx, qy, ex, ey = np.empty(width), np.empty(width), np.empty(width), np.empty(width)
    px, py = float(start[0]), float(start[1])
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


@entry
def plan_corexy(targets, start, ma, mb, lower_a, upper_a, lower_b, upper_b, c_max, controls, imagined):
    """Plan with play tables of the motors a = x + y and b = x − y; the carriage is at ((a + b)/2, (a − b)/2)."""
    width = 4 * c_max + 1
    qa, qb = np.empty(width), np.empty(width)
    pa, pb = float(start[0] + start[1]), float(start[0] - start[1])
    imagined[0, 0], imagined[0, 1] = (pa + pb) / 2, (pa - pb) / 2
    for t in range(targets.shape[0]):
        reach(pa, ma, 2 * c_max, lower_a, upper_a, qa)
        reach(pb, mb, 2 * c_max, lower_b, upper_b, qb)
        tx, ty = targets[t, 0], targets[t, 1]
        least = np.inf
        best_x, best_y = 0, 0
        for cx in range(-c_max, c_max + 1):
            for cy in range(-c_max, c_max + 1):
                a, b = qa[cx + cy + 2 * c_max], qb[cx - cy + 2 * c_max]
                dx, dy = tx - (a + b) / 2, ty - (a - b) / 2
                value = dx * dx + dy * dy
                if value < least:
                    least, best_x, best_y = value, cx, cy
        pa, pb = qa[best_x + best_y + 2 * c_max], qb[best_x - best_y + 2 * c_max]
        ma += best_x + best_y
        mb += best_x - best_y
        controls[t, 0], controls[t, 1] = best_x, best_y
        imagined[t + 1, 0], imagined[t + 1, 1] = (pa + pb) / 2, (pa - pb) / 2


@inner(inline="always")
def sign(c):
    return (c > 0) - (c < 0)


@inner(inline="always")
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


@inner(inline="always")
def polynomial(u, v, coefficients, axis):
    """Return the cubic of one axis, its terms in the order of `Frame.exponents`."""
    by_u = coefficients[axis, 1] + u * (coefficients[axis, 3] + u * coefficients[axis, 6])
    by_uv = coefficients[axis, 4] + u * coefficients[axis, 7] + v * coefficients[axis, 8]
    by_v = coefficients[axis, 2] + v * (coefficients[axis, 5] + v * coefficients[axis, 9])
    return coefficients[axis, 0] + u * by_u + u * v * by_uv + v * by_v


@inner(inline="always")
def bend(x, y, coefficients, origin, scale):
    """Return the bed position of belts at (x, y) through a crooked frame (`LatticeFrame`)."""
    u, v = (x + origin[0]) / scale[0], (y + origin[1]) / scale[1]
    return x + polynomial(u, v, coefficients, 0), y + polynomial(u, v, coefficients, 1)


@inner(inline="always")
def bed_position(a, b, corexy, coefficients, origin, scale):
    """Return the bed position of motors' belts at (a, b); ``coefficients`` [2, 0] stands for a straight frame."""
    x, y = ((a + b) / 2, (a - b) / 2) if corexy else (a, b)
    if coefficients.shape[1] == 0:
        return x, y
    return bend(x, y, coefficients, origin, scale)


@entry
def plan_framed(
    targets, start, ma, mb, lower_a, upper_a, lower_b, upper_b, c_max, corexy, coefficients, origin, scale,
    controls, imagined,
):  # fmt: skip
    """Plan with play tables behind a crooked frame."""
    span = 2 * c_max if corexy else c_max
    qa, qb = np.empty(2 * span + 1), np.empty(2 * span + 1)
    pa, pb = float(start[0]), float(start[1])
    if corexy:
        pa, pb = pa + pb, pa - pb
    imagined[0, 0], imagined[0, 1] = start[0], start[1]
    for t in range(targets.shape[0]):
        reach(pa, ma, span, lower_a, upper_a, qa)
        reach(pb, mb, span, lower_b, upper_b, qb)
        tx, ty = targets[t, 0], targets[t, 1]
        least = np.inf
        best_a, best_b = 0, 0
        for cx in range(-c_max, c_max + 1):
            for cy in range(-c_max, c_max + 1):
                ca, cb = (cx + cy, cx - cy) if corexy else (cx, cy)
                x, y = bed_position(qa[ca + span], qb[cb + span], corexy, coefficients, origin, scale)
                dx, dy = tx - x, ty - y
                value = dx * dx + dy * dy
                if value < least:
                    least, best_a, best_b = value, ca, cb
                    controls[t, 0], controls[t, 1] = cx, cy
        pa, pb = qa[best_a + span], qb[best_b + span]
        ma += best_a
        mb += best_b
        imagined[t + 1, 0], imagined[t + 1, 1] = bed_position(pa, pb, corexy, coefficients, origin, scale)
