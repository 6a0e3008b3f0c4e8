"""Compiled planning of travels of one leg or several: nothing is drawn, so that only the arrival must be right.

At a corner of a travel a loose motor need not cross its slack: its belt may lag. Each motor goes as the path does,
whatever its belt is doing, and crosses the slack at most once. It crosses on the longest leg after which the belt still
ends where it is wanted, to the side on which the line behind the travel will push it.

A bad Z screw pushes the nozzle differently at each height. Only the end of a travel that rises and comes down must be
right, so all of it is planned with the push at the height of the next line.
"""

import numpy as np

from printmend.gcode.kernels.layout import (
    FLAG_EXTRUDING,
    FLAG_KNOWN_X1,
    FLAG_KNOWN_Y1,
    FLAG_KNOWN_Z1,
    FLAG_OPAQUE,
    KIND_LINEAR,
)
from printmend.jit import inner
from printmend.plan.kernels.curve import norm
from printmend.plan.kernels.height import ZED, push
from printmend.plan.kernels.layout import (
    ARRIVED_MM,
    LEGS,
)
from printmend.plan.kernels.lookup import (
    LOWER,
    UPPER,
    backward,
    forward,
    is_near,
    is_taut,
    wanted,
)
from printmend.plan.kernels.state import is_sure, middle

LEGS_TRIED = 3  # for a crossing, the longest first
RECORDS_AHEAD = 256  # among which the end of a travel is looked for


@inner
def arrival(model, records, count, i):
    """Return (seen, moves, z, way) of the end of the travel of record i.

    ``seen`` says whether that end is among the records, ``moves`` whether it goes on in x or y from there. ``z`` is the
    height of the next line, ``way`` the sign of the way in Z to it, 0 for none.
    """
    moves, way = False, 0.0
    for j in range(i, min(count, i + RECORDS_AHEAD)):
        r = records[j]
        if not _is_move(r) or not r.flags & FLAG_KNOWN_Z1:
            break
        if r.advance > 0.0:
            return True, moves, r.z0, way
        if not _is_still(r):
            if not is_near(model, r.x1, r.y1):
                break
            moves = True
        if r.z1 != r.z0:
            way = np.sign(r.z1 - r.z0)
    return False, False, 0.0, 0.0


@inner
def arriving_push(model, state, z, way):
    """Return the screw's push at height z, reached on a ``way`` up or down; for way 0 the present push."""
    if way == 0.0:
        return push(model, state.mended.m[ZED])
    return push(model, backward(model, ZED, LOWER if way > 0.0 else UPPER, z))


@inner
def plan_travel(model, state, records, count, i, run, across, along):
    """Fill ``run`` with the legs of the travel that record i begins, and where the motors go at the end of each.

    The belts go to the path less the screw's push (``across``, ``along``), as in `turns.survey`. A motor's place is NaN
    if it goes as far as its belt needs.
    """
    n, j = 0, i
    while j < count and n < LEGS:
        r = records[j]
        if not _is_move(r):
            break
        if _is_still(r):
            if r.advance > 0.0:
                break
        elif r.flags & FLAG_EXTRUDING or not is_near(model, r.x1, r.y1):
            break
        else:
            leg = run.legs[n]
            leg.belt[0], leg.belt[1] = wanted(model, r.x1 - across, r.y1 - along)
            leg.length, leg.motor[0], leg.motor[1] = norm(r.x1 - r.x0, r.y1 - r.y0), np.nan, np.nan
            n += 1
        j += 1
    run.travel_end, run.leg = max(j, i + 1), 0
    if n == 0:
        return
    while j < count and _is_move(records[j]) and _is_still(records[j]):
        j += 1
    next0 = next1 = 0.0
    if j < count and _is_move(records[j]) and records[j].flags & FLAG_EXTRUDING:
        next0, next1 = wanted(model, records[j].x1 - across, records[j].y1 - along)
        next0, next1 = next0 - run.legs[n - 1].belt[0], next1 - run.legs[n - 1].belt[1]
    for k in range(2):
        if is_sure(state, k) and not is_taut(model, k):
            _choose_leg(model, state, run, k, n, next0 if k == 0 else next1)


@inner
def _is_move(r):
    """Say whether a record is a straight move that can be planned."""
    known = r.flags & FLAG_KNOWN_X1 != 0 and r.flags & FLAG_KNOWN_Y1 != 0
    return r.kind == KIND_LINEAR and known and r.flags & FLAG_OPAQUE == 0


@inner
def _is_still(r):
    """Say whether a record stands still in x and y."""
    return r.x0 == r.x1 and r.y0 == r.y1


@inner
def _choose_leg(model, state, run, k, n, ahead):
    """Choose the leg on which motor k crosses its slack, to the side on which it drives its belt along the next line.

    ``ahead`` is how far [mm] the belt goes along that line. If no leg serves, the other side is tried.
    """
    m, now = state.mended.m[k], middle(state, k)
    pushed, pulled = backward(model, k, LOWER, now), backward(model, k, UPPER, now)
    lag = min(max((2.0 * m - pushed - pulled) / max(pushed - pulled, 1e-9), -1.0), 1.0)
    side = 1.0 if lag > 0.0 else -1.0
    if abs(ahead) > 2.0 * model.head.chord:
        side = 1.0 if ahead > 0.0 else -1.0
    end = run.legs[n - 1].belt[k]
    for _ in range(2):
        longest = np.inf
        for _ in range(min(LEGS_TRIED, n)):
            crossed, length = n - 1, -1.0
            for leg in range(n):
                if length < run.legs[leg].length < longest:
                    crossed, length = leg, run.legs[leg].length
            longest = length
            if abs(_cross_on_leg(model, run, k, n, m, now, lag, side, crossed) - end) <= ARRIVED_MM:
                return
        side = -side
    _cross_on_leg(model, run, k, n, m, now, lag, side, n - 1)
    run.legs[n - 1].motor[k] = np.nan


@inner
def _cross_on_leg(model, run, k, n, m, belt, lag, side, crossed):
    """Write where motor k goes if it crosses to ``side`` on a leg; return where its belt, now at ``belt``, will end.

    ``lag`` is where in its slack the motor is until then, from −1 (it pulls) to 1 (it pushes).
    """
    end = run.legs[n - 1].belt[k]
    slack = abs(backward(model, k, LOWER, end) - backward(model, k, UPPER, end))
    for leg in range(n):
        u = run.legs[leg].belt[k]
        if leg < crossed:
            pushed, pulled = backward(model, k, LOWER, u), backward(model, k, UPPER, u)
            to = (pushed + pulled + lag * (pushed - pulled)) / 2.0
        else:
            if 0.0 < side * (u - end) <= slack:
                u = end  # beyond it the belt would have to come back
            to = backward(model, k, LOWER if side > 0.0 else UPPER, u)
        belt = max(belt, forward(model, k, LOWER, to)) if to > m else min(belt, forward(model, k, UPPER, to))
        run.legs[leg].motor[k] = m = to
    return belt
