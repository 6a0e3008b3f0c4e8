"""Compiled search for the longest arc whose printed path stays close enough to the arc that the file wants.

A bent machine draws an arc nearly right if it is told another one: through three places of the command that would be
exactly right, its two ends and its middle. What is left is of the third order, where a chord's is of the second.
"""

import numpy as np

from printmend.jit import inner
from printmend.plan.kernels.chord import along_curve
from printmend.plan.kernels.curve import aside_and_along, norm
from printmend.plan.kernels.layout import ALONG_PER_ASIDE, LEAST_ARC_RAD, LONGEST_ARC_RAD
from printmend.plan.kernels.lookup import from_motors, printed, to_motors
from printmend.plan.kernels.state import command, followed, middle, motor_along

_TRIALS = 5  # of a length, each half of the one before
_LOOKS_A_RAD = 16.0
_SWEEP_SHARE = 0.2  # by which the sweep may differ from the wanted one; beyond it the circle goes the other way round


@inner(error_model="numpy", _nrt=False)
def on_arc(x0, y0, x1, y1, center, sweep, s):
    """Return the place at the share s of an arc from (x0, y0) to (x1, y1), whose radius may change a little."""
    dx, dy = x0 - center[0], y0 - center[1]
    r0 = norm(dx, dy)
    scale = 1.0 + s * (norm(x1 - center[0], y1 - center[1]) - r0) / r0 if r0 > 0.0 else 1.0
    cosine, sine = scale * np.cos(s * sweep), scale * np.sin(s * sweep)
    return center[0] + cosine * dx - sine * dy, center[1] + sine * dx + cosine * dy


@inner(error_model="numpy", _nrt=False)
def _find_center(state, x0, y0, x1, y1, x2, y2):
    """Put the centre and the sweep of the circle through three places into ``state``; return whether there is one."""
    ax, ay, bx, by = x1 - x0, y1 - y0, x2 - x0, y2 - y0
    double = 2.0 * (ax * by - ay * bx)
    if not abs(double) > 1e-9:
        return False
    a2, b2 = ax * ax + ay * ay, bx * bx + by * by
    cx, cy = (by * a2 - ay * b2) / double, (ax * b2 - bx * a2) / double
    state.arc_center[0], state.arc_center[1] = x0 + cx, y0 + cy
    angle = np.arctan2(y2 - y0 - cy, x2 - x0 - cx) - np.arctan2(-cy, -cx)
    way = 1.0 if double > 0.0 else -1.0
    state.arc_sweep = way * (way * angle % (2.0 * np.pi))
    return True


# From here on the many parameters are the curve, where the motors are on it, and the record in hand.
@inner(error_model="numpy", _nrt=False)
def arc(model, curve, state, mode0, mode1, t, stop, u0, u1, record, quantum):
    """Return (end, m0, m1): where the longest admissible arc from t ends, and the motors there; t where there is none.

    Its centre and sweep are in ``state``. At ``stop`` the belts are wanted at (u0, u1).
    """
    from_x, from_y = from_motors(model, state.mended.m[0], state.mended.m[1])
    now0, now1 = middle(state, 0), middle(state, 1)
    x, y = printed(model, now0, now1)
    aside, along = aside_and_along(curve, x, y, t)
    step = min(stop - t, LONGEST_ARC_RAD / abs(curve.sweep))
    if stop - t > step:
        step = (stop - t) / np.ceil((stop - t) / step)
    for _ in range(_TRIALS):
        if step * abs(curve.sweep) < LEAST_ARC_RAD or step * curve.length < curve.least:
            break
        end = t + step
        m0, m1 = along_curve(model, curve, state, mode0, mode1, end)
        if stop - end < 1e-12:
            end = stop
            m0, m1 = motor_along(model, state, 0, mode0, u0, stop), motor_along(model, state, 1, mode1, u1, stop)
        h0, h1 = along_curve(model, curve, state, mode0, mode1, t + step / 2.0)
        h_x, h_y = from_motors(model, h0, h1)
        x, y, m0, m1, clamp = command(model, m0, m1, record, quantum)
        if clamp <= quantum and _find_center(state, from_x, from_y, h_x, h_y, x, y):
            swept = step * curve.sweep
            same = abs(state.arc_sweep - swept) <= _SWEEP_SHARE * abs(swept)
            if same and _score(model, curve, state, mode0, mode1, t, step, from_x, from_y, x, y, aside + along) <= 1.0:
                return end, m0, m1
        step /= 2.0
    return t, state.mended.m[0], state.mended.m[1]


@inner(error_model="numpy", _nrt=False)
def _score(model, curve, state, mode0, mode1, t, step, from_x, from_y, to_x, to_y, start_error):
    """Return the largest error of the arc in hand, from t on, in units of what is allowed."""
    looks = np.int64(
        4.0 + _LOOKS_A_RAD * step * abs(curve.sweep) + min(step * curve.length, 4096.0) / model.head.sample
    )
    now0, now1 = middle(state, 0), middle(state, 1)
    worst = 0.0
    for i in range(1, looks):
        s = i / looks
        x, y = on_arc(from_x, from_y, to_x, to_y, state.arc_center, state.arc_sweep, s)
        m0, m1 = to_motors(model, x, y)
        x, y = printed(model, followed(model, 0, mode0, now0, m0), followed(model, 1, mode1, now1, m1))
        aside, along = aside_and_along(curve, x, y, t + s * step)
        spare = (1.0 - s) * start_error
        worst = max(worst, aside / (model.head.chord + spare), along / (ALONG_PER_ASIDE * model.head.chord + spare))
        if worst > 1.0:
            break
    return worst
