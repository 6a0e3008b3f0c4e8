"""Compiled state of the belts: what moving the motors does, and how to bring a belt to where it is wanted."""

import numpy as np

from printmend.invert.kernels.layout import HOLD_MM, HOME_MM, S_CROSS, S_CROSSING, S_HI, S_LO, S_M, S_SIDE
from printmend.invert.kernels.lookup import (
    LOWER,
    M_BED,
    M_COREXY,
    M_HOME,
    M_HOME_SIDE,
    UPPER,
    backward,
    forward,
    from_motors,
    is_taut,
    to_motors,
    wanted,
)
from printmend.jit import inner

LAG = 4.0  # times the tolerance of a turn: how far off a belt may be behind it, pushed the way it is going


@inner(error_model="numpy", _nrt=False)
def open_interval(model, state, m, lo, hi):
    """The belts may be anywhere in their play: the interval from ``lo`` to ``hi`` becomes all of it."""
    for k in range(2):
        if m == S_M:
            state[S_SIDE + k] = 0.0
        state[lo + k] = forward(model, k, LOWER, state[m + k])
        state[hi + k] = forward(model, k, UPPER, state[m + k])


@inner(error_model="numpy", _nrt=False)
def settle_home(model, state, m, lo, hi, axes, x, y):
    """Put the motors that homed ``axes`` (bits) to (x, y), and their belts on the side that homing pressed them to.

    The switch stops the carriage on its way towards it, so the branch of that direction is engaged. That holds where
    this branch passes through the home position, as it does in `Mechanism.homed`. A model whose
    origin lies elsewhere (a printer that backs off from its switch; a trace that began with the belt loose) says
    otherwise: then the belt may be anywhere in its play.
    """
    at_x, at_y = from_motors(model, state[m], state[m + 1])
    corexy = model[M_COREXY] != 0.0
    to = to_motors(model, x if axes & 1 else at_x, y if axes & 2 else at_y)
    motors = to_motors(model, model[M_HOME], model[M_HOME + 1])
    belts = wanted(model, model[M_HOME], model[M_HOME + 1])
    for k in range(2):
        if not corexy and not axes & (1 << k):
            continue
        side = model[M_HOME_SIDE + k]
        if corexy:  # the axis that homes last moves both motors: +y turns A forwards and B backwards
            side = model[M_HOME_SIDE + 1] * (1.0 - 2.0 * k)
        at_home = abs(forward(model, k, LOWER if side > 0 else UPPER, motors[k]) - belts[k]) <= HOME_MM
        if corexy and axes & 3 == 1:
            side = model[M_HOME_SIDE]
        state[m + k] = to[k]
        engaged = forward(model, k, LOWER if side > 0 else UPPER, to[k])
        state[lo + k] = engaged if at_home else forward(model, k, LOWER, to[k])
        state[hi + k] = engaged if at_home else forward(model, k, UPPER, to[k])
        if m == S_M:
            state[S_SIDE + k] = side if at_home else 0.0


@inner(error_model="numpy", _nrt=False)
def middle(state, k):
    return (state[S_LO + k] + state[S_HI + k]) / 2


@inner(error_model="numpy", _nrt=False)
def is_sure(state, k):
    return state[S_HI + k] - state[S_LO + k] <= HOLD_MM


@inner(error_model="numpy", _nrt=False)
def pull(model, state, m, lo, hi, k, to):
    """Move motor k to ``to`` and its belt with it; ``m``, ``lo`` and ``hi`` name the state's fields.

    Returns 1 or −1 where the motor now pushes the belt forwards or backwards, 0 where it does not touch it.
    u ← min(max(u, lower), upper) (physics.md eq. 7): going forwards only the lower branch can touch, because
    both rise; going backwards only the upper one.
    """
    side = 0.0
    if to > state[m + k]:
        push = forward(model, k, LOWER, to)
        state[lo + k] = max(state[lo + k], push)
        state[hi + k] = max(state[hi + k], push)
        side = 1.0 if state[hi + k] == push else 0.0
    elif to < state[m + k]:
        push = forward(model, k, UPPER, to)
        state[lo + k] = min(state[lo + k], push)
        state[hi + k] = min(state[hi + k], push)
        side = -1.0 if state[lo + k] == push else 0.0
    state[m + k] = to
    return side


@inner(error_model="numpy", _nrt=False)
def arrive(model, state, m0, m1):
    """Move both motors, and what they pull."""
    if m0 != state[S_M]:
        state[S_SIDE] = pull(model, state, S_M, S_LO, S_HI, 0, m0)
    if m1 != state[S_M + 1]:
        state[S_SIDE + 1] = pull(model, state, S_M, S_LO, S_HI, 1, m1)


@inner(error_model="numpy", _nrt=False)
def command(model, m0, m1, record, quantum):
    """Round and clamp the command for motors (m0, m1): return (x, y, m0, m1, how far it was clamped)."""
    x, y = from_motors(model, m0, m1)
    low_x, high_x = min(model[M_BED], record.x0, record.x1), max(model[M_BED + 1], record.x0, record.x1)
    low_y, high_y = min(model[M_BED + 2], record.y0, record.y1), max(model[M_BED + 3], record.y0, record.y1)
    inside_x, inside_y = min(max(x, low_x), high_x), min(max(y, low_y), high_y)
    clamp = max(abs(inside_x - x), abs(inside_y - y))
    # What is written unchanged must be the same number: the writer then leaves it as it is.
    x = record.x1 if abs(inside_x - record.x1) <= quantum / 2 else np.rint(inside_x / quantum) * quantum
    y = record.y1 if abs(inside_y - record.y1) <= quantum / 2 else np.rint(inside_y / quantum) * quantum
    m0, m1 = to_motors(model, x, y)
    return x, y, m0, m1, clamp


@inner(error_model="numpy", _nrt=False)
def prepare(model, state, k, start, end, anywhere, trend, hold):
    """Choose how motor k goes from belt position ``start`` to ``end``, on a path along which the belt has a ``trend``.

    Returns (mode, first, second): mode 1 pushes (lower), −1 pulls (upper), 2 does both, without play, 0 stands still;
    ``first`` and ``second`` are the motor positions of two dead moves that make the belt engaged, equal to where it is
    when none is needed. None is made for a way of at most ``hold`` [mm]. The trend is 0 where it is not known.
    """
    m = state[S_M + k]
    if is_taut(model, k) and is_sure(state, k) and abs(middle(state, k) - start) <= 1.5 * hold and not anywhere:
        return 2, m, m
    if not anywhere and is_sure(state, k):
        now = middle(state, k)
        off = abs(now - start)
        behind = trend != 0.0 and 1.5 * hold < off <= LAG * hold  # a turn: there the belt waits for the path
        if behind and abs(backward(model, k, LOWER if trend > 0 else UPPER, now) - m) <= HOLD_MM:
            return (np.int64(trend) if trend * (end - now) > 0.0 else 0), m, m
        if off <= 1.5 * hold:
            way = end - now
            if abs(way) < 1e-9:
                return 0, m, m
            mode = 1 if way > 0 else -1
            if trend * way < 0.0 and abs(way) <= hold:
                mode = -mode
            if state[S_SIDE + k] == mode:
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
    if forwards and (anywhere or state[S_HI + k] > start + HOLD_MM):
        first = min(m, backward(model, k, UPPER, start))
    elif not forwards and (anywhere or state[S_LO + k] < start - HOLD_MM):
        first = max(m, backward(model, k, LOWER, start))
    second = backward(model, k, LOWER if forwards else UPPER, start)
    if end == start:
        return 0, first, second
    return (1 if forwards else -1), first, second


@inner(error_model="numpy", _nrt=False)
def motor_at(model, state, k, mode, u):
    """Return the motor position that brings the belt of motor k to u, moving only in the sense of ``mode``."""
    if mode == 2:
        return backward(model, k, LOWER, u)
    if mode > 0:
        return max(backward(model, k, LOWER, u), state[S_M + k])
    if mode < 0:
        return min(backward(model, k, UPPER, u), state[S_M + k])
    return state[S_M + k]


@inner(error_model="numpy", _nrt=False)
def motor_along(model, state, k, mode, u, t):
    """Return the motor position at t of the curve: as `motor_at`, or on its way through its slack."""
    if mode == 0:
        return state[S_CROSS + k] + t * state[S_CROSSING + k]
    return motor_at(model, state, k, mode, u)


@inner(error_model="numpy", _nrt=False)
def followed(model, k, mode, now, m):
    """Return where the belt of motor k will be when the motor has gone to m from a place where it was at ``now``."""
    if mode == 2:
        return forward(model, k, LOWER, m)
    if mode > 0:
        return max(now, forward(model, k, LOWER, m))
    if mode < 0:
        return min(now, forward(model, k, UPPER, m))
    return now


@inner(error_model="numpy", _nrt=False)
def travel_motor(model, state, k, start, end):
    """Return the motor position that brings belt k to ``end`` on a move that draws nothing."""
    m, now = state[S_M + k], middle(state, k)
    if is_sure(state, k):
        way = end - now
        if abs(way) < 1e-9:
            return m
        branch = LOWER if way > 0 else UPPER
        if abs(way) <= HOLD_MM and abs(backward(model, k, branch, now) - m) > HOLD_MM:
            return m
        return backward(model, k, branch, end)
    if abs(end - start) < 1e-9 and state[S_LO + k] - HOLD_MM <= end <= state[S_HI + k] + HOLD_MM:
        return m
    return backward(model, k, LOWER if end > now else UPPER, end)
