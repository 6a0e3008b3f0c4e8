"""Compiled state of the belts: what moving the motors does, and how to bring a belt to where it is wanted."""

import numpy as np

from printmend.jit import inner
from printmend.plan.kernels.layout import HOLD_MM, HOME_MM
from printmend.plan.kernels.lookup import (
    LOWER,
    UPPER,
    backward,
    forward,
    from_motors,
    is_corexy,
    is_taut,
    to_motors,
    wanted,
)

LAG_PER_TOLERANCE = 4.0  # how far a belt may lag behind a turn while it is pushed in its direction, per tolerance


@inner
def open_interval(model, belts):
    """Note that both belts may be anywhere in their play: the intervals from ``low`` to ``high`` become all of it."""
    for k in range(2):
        belts.side[k] = 0.0
        belts.low[k] = forward(model, k, LOWER, belts.m[k])
        belts.high[k] = forward(model, k, UPPER, belts.m[k])


@inner
def settle_home(model, belts, axes, x, y):
    """Put the motors that homed ``axes`` (bits) to (x, y), and their belts on the side that homing pressed them to.

    The switch stops the carriage on its way towards it, so the branch of that direction is engaged. That holds where
    this branch passes through the home position, as it does in `Mechanism.homed`. A model whose
    origin lies elsewhere (a printer that backs off from its switch; a trace that began with the belt loose) says
    otherwise: then the belt may be anywhere in its play.
    """
    at_x, at_y = from_motors(model, belts.m[0], belts.m[1])
    corexy = is_corexy(model)
    to = to_motors(model, x if axes & 1 else at_x, y if axes & 2 else at_y)
    motors = to_motors(model, model.head.home[0], model.head.home[1])
    home_belts = wanted(model, model.head.home[0], model.head.home[1])
    for k in range(2):
        if not corexy and not axes & (1 << k):
            continue
        side = model.head.home_side[k]
        if corexy:  # the axis that homes last moves both motors: +y turns A forwards and B backwards
            side = model.head.home_side[1] * (1.0 - 2.0 * k)
        at_home = abs(forward(model, k, LOWER if side > 0 else UPPER, motors[k]) - home_belts[k]) <= HOME_MM
        if corexy and axes & 3 == 1:
            side = model.head.home_side[0]
        belts.m[k] = to[k]
        engaged = forward(model, k, LOWER if side > 0 else UPPER, to[k])
        belts.low[k] = engaged if at_home else forward(model, k, LOWER, to[k])
        belts.high[k] = engaged if at_home else forward(model, k, UPPER, to[k])
        belts.side[k] = side if at_home else 0.0


@inner
def middle(state, k):
    """Return the middle of where belt k of the mended machine may be."""
    return (state.mended.low[k] + state.mended.high[k]) / 2


@inner
def is_sure(state, k):
    """Say whether it is known where belt k of the mended machine is."""
    return state.mended.high[k] - state.mended.low[k] <= HOLD_MM


@inner
def pull(model, belts, k, to):
    """Move motor k to ``to`` and its belt with it.

    u ← min(max(u, lower), upper) (physics.md eq. 7): going forwards only the lower branch can touch, because
    both rise; going backwards only the upper one.
    """
    side = 0.0
    if to > belts.m[k]:
        push = forward(model, k, LOWER, to)
        belts.low[k] = max(belts.low[k], push)
        belts.high[k] = max(belts.high[k], push)
        side = 1.0 if belts.high[k] == push else 0.0
    elif to < belts.m[k]:
        push = forward(model, k, UPPER, to)
        belts.low[k] = min(belts.low[k], push)
        belts.high[k] = min(belts.high[k], push)
        side = -1.0 if belts.low[k] == push else 0.0
    belts.m[k], belts.side[k] = to, side


@inner
def arrive(model, state, m0, m1):
    """Move both motors of the mended machine, and the belts that they pull."""
    if m0 != state.mended.m[0]:
        pull(model, state.mended, 0, m0)
    if m1 != state.mended.m[1]:
        pull(model, state.mended, 1, m1)


@inner
def command(model, m0, m1, record, quantum):
    """Round and clamp the command for motors (m0, m1): return (x, y, m0, m1, how far it was clamped)."""
    x, y = from_motors(model, m0, m1)
    low_x, high_x = min(model.head.bed[0], record.x0, record.x1), max(model.head.bed[1], record.x0, record.x1)
    low_y, high_y = min(model.head.bed[2], record.y0, record.y1), max(model.head.bed[3], record.y0, record.y1)
    inside_x, inside_y = min(max(x, low_x), high_x), min(max(y, low_y), high_y)
    clamp = max(abs(inside_x - x), abs(inside_y - y))
    # An unchanged coordinate must stay the same number, so that the writer leaves it as it is.
    x = record.x1 if abs(inside_x - record.x1) <= quantum / 2 else np.rint(inside_x / quantum) * quantum
    y = record.y1 if abs(inside_y - record.y1) <= quantum / 2 else np.rint(inside_y / quantum) * quantum
    m0, m1 = to_motors(model, x, y)
    return x, y, m0, m1, clamp


@inner
def count_held(counts, record, extruding):
    """Count a line of the file that the edge of the bed holds back: once, however many pieces it becomes."""
    if counts.held_line != record.line + 1:
        counts.held_line = record.line + 1
        counts.clamped += 1
        counts.clamped_extruding += extruding


@inner
def prepare(model, state, k, start, end, anywhere, trend, hold):
    """Choose how motor k goes from belt position ``start`` to ``end``, on a path along which the belt has a ``trend``.

    Returns (mode, first, second). Mode 1 pushes (lower branch), −1 pulls (upper), 2 is a taut belt, 0 stands still.
    ``first`` and ``second`` are the motor positions of two dead moves that engage the belt; both are the motor's
    position if none is needed. No dead move is made for a way of at most ``hold`` [mm]. The trend is 0 where it is
    unknown.
    """
    m = state.mended.m[k]
    if is_taut(model, k) and is_sure(state, k) and abs(middle(state, k) - start) <= 1.5 * hold and not anywhere:
        return 2, m, m
    if not anywhere and is_sure(state, k):
        now = middle(state, k)
        off = abs(now - start)
        behind = (
            trend != 0.0 and 1.5 * hold < off <= LAG_PER_TOLERANCE * hold
        )  # a turn: there the belt waits for the path
        if behind and abs(backward(model, k, LOWER if trend > 0 else UPPER, now) - m) <= HOLD_MM:
            return (np.int64(trend) if trend * (end - now) > 0.0 else 0), m, m
        if off <= 1.5 * hold:
            way = end - now
            if abs(way) < 1e-9:
                return 0, m, m
            mode = 1 if way > 0 else -1
            if trend * way < 0.0 and abs(way) <= hold:
                mode = -mode
            if state.mended.side[k] == mode:
                return mode, m, m
            engaged = backward(model, k, LOWER if mode > 0 else UPPER, now)
            if abs(engaged - m) <= HOLD_MM:
                return mode, m, m
            if abs(way) <= hold and trend == 0.0:
                return 0, m, m
            return mode, m, engaged
    # Uncertain, or not where it should be: come from the far side, so that the belt is engaged and at ``start``.
    forwards = end > start
    if end == start:
        forwards = m <= (backward(model, k, LOWER, start) + backward(model, k, UPPER, start)) / 2
        if trend != 0.0:
            forwards = trend > 0.0
    first = m
    if forwards and (anywhere or state.mended.high[k] > start + HOLD_MM):
        first = min(m, backward(model, k, UPPER, start))
    elif not forwards and (anywhere or state.mended.low[k] < start - HOLD_MM):
        first = max(m, backward(model, k, LOWER, start))
    second = backward(model, k, LOWER if forwards else UPPER, start)
    if end == start:
        return 0, first, second
    return (1 if forwards else -1), first, second


@inner
def motor_at(model, state, k, mode, u):
    """Return the motor position that brings the belt of motor k to u if the motor moves only as ``mode`` says."""
    if mode == 2:
        return backward(model, k, LOWER, u)
    if mode > 0:
        return max(backward(model, k, LOWER, u), state.mended.m[k])
    if mode < 0:
        return min(backward(model, k, UPPER, u), state.mended.m[k])
    return state.mended.m[k]


@inner
def motor_along(model, state, k, mode, u, t):
    """Return the motor position at t of the curve: as `motor_at`, or on its way through the slack."""
    if mode == 0:
        return state.cross[k] + t * state.crossing[k]
    return motor_at(model, state, k, mode, u)


@inner
def followed(model, k, mode, now, m):
    """Return where the belt of motor k will be once the motor is at m, if the belt is at ``now``."""
    if mode == 2:
        return forward(model, k, LOWER, m)
    if mode > 0:
        return max(now, forward(model, k, LOWER, m))
    if mode < 0:
        return min(now, forward(model, k, UPPER, m))
    return now


@inner
def travel_motor(model, state, k, start, end):
    """Return the motor position that brings belt k to ``end`` on a move that draws nothing."""
    m, now = state.mended.m[k], middle(state, k)
    if is_sure(state, k):
        way = end - now
        if abs(way) < 1e-9:
            return m
        branch = LOWER if way > 0 else UPPER
        if abs(way) <= HOLD_MM and abs(backward(model, k, branch, now) - m) > HOLD_MM:
            return m
        return backward(model, k, branch, end)
    if abs(end - start) < 1e-9 and state.mended.low[k] - HOLD_MM <= end <= state.mended.high[k] + HOLD_MM:
        return m
    return backward(model, k, LOWER if end > now else UPPER, end)
