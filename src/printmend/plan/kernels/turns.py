"""Compiled survey of an extruded path: where each motor turns back, and on which stretch its slack is crossed.

Near a reversal a motor's belt hardly moves. While it may stand still within the tolerance, its motor crosses the slack
and the nozzle prints on. Around a turn of radius R that is 2 √(2 R ε) of path for an error ε. A sharp corner has ε /
sin α on either side, α being the side's angle to the other axis. There the firmware is slow anyway: the slack is
crossed around the corner, whose tip is cut off, or in one move that begins or ends there.

The firmware brakes for the angle between two commands. So the crossing bends towards the path behind the corner, and
the other motor leaves some of its own slack for it. If there is no room, slack is taken up while the nozzle stands
still.
"""

import numpy as np

from printmend.gcode.kernels.layout import (
    FLAG_EXTRUDING,
    FLAG_KNOWN_X1,
    FLAG_KNOWN_Y1,
    FLAG_OPAQUE,
    KIND_CCW,
    KIND_CW,
    KIND_LINEAR,
    ROLE_MASK,
    ROLE_SHIFT,
    WORD_E,
    WORD_X,
    WORD_Y,
    WORD_Z,
)
from printmend.jit import inner
from printmend.plan.kernels.curve import is_flat_arc, norm, place, stays_near, trace
from printmend.plan.kernels.layout import HOLD_MM, MIN_PIECE_MM, NEAR_MM, NODES, TURNS
from printmend.plan.kernels.lookup import (
    LOWER,
    UPPER,
    backward,
    is_framed,
    wanted,
)
from printmend.plan.kernels.state import is_sure, middle

# The limits of speed and of shape are choices of ours.
FLAT_MM = 2e-4  # a belt that moves less stands still
# How fast a motor may cross its slack, as a multiple of the nozzle's speed:
GENTLE_CROSSING = 0.2  # on a stretch where the belt stays within half the tolerance: Klipper passes its ends at 45 mm/s
UNCUT_CROSSING = 0.75  # on a stretch that begins or ends with a move, so that no move is cut
FASTEST_ON_CURVE = 8.0  # around a turn that is no corner
FASTEST_AT_CORNER = 16.0  # at a corner: any faster, and the nozzle all but stands, so that it may as well stand
SHORTEST_STRETCH_MM = 0.02  # shortest path on which slack is crossed; on less the nozzle stands
SIDEWAYS_MM = 0.01  # the least that the other motor moves before a corner that is gone around
CORNER_SLOPE = 0.5  # at a corner the belt falls by at least this many mm a mm of path on both sides …
UPRIGHT_SLOPE = 0.8  # … or by this many on one side: there a motor that crosses its slack goes back on the path
TOGETHER_MM = 0.03  # of path behind a corner on which both motors cross their slack: the nozzle does not quite stand
STRAIGHT_BACK_COSINE = 0.96  # of the angle between crossing and path: above it the firmware all but stops
WAIT_SHARE = 0.3  # of a stretch: on its first bit one motor moves alone, so that the command turns back by two bends
LEAST_FALL_PER_TOLERANCE = 4.0  # a belt that moves less towards a tip does not stop before it
BEND_SHARE = 0.6  # share of the angle between motor and path behind a corner by which the command has turned half-way
AHEAD_SHARE = 0.8  # share of a belt's lag behind a corner by which it stops ahead of the path before the corner
ASLANT_PER_TOLERANCE = 1.5  # how far a belt may be off where that is aslant to the path
NODE_SAGITTA_MM = 0.002  # how far the straight lines between the nodes of a curve lie inside it
MOST_NODES_A_CURVE = 256  # that one curve may add to a path


# Its many parameters are the arrays of one file's way through `mend`, and how the Z screw pushes the path aside.
@inner
def survey(model, state, counts, records, count, i, curve, run, across, along, rising):
    """Fill ``run`` with the turns of the path that record i begins: extruding moves, each from where the last ended.

    The belts go to the path less (``across``, ``along``), by which the Z screw pushes the nozzle. Unless ``rising``,
    the path ends before a record that rises. It also ends where lines have another tolerance. ``curve`` is scratch.
    """
    run.begin = 0.0
    n = 1
    j = i
    while j < count and n + MOST_NODES_A_CURVE < NODES:
        r = records[j]
        if r.kind == KIND_LINEAR and not r.words & (WORD_X | WORD_Y | WORD_Z | WORD_E):
            j += 1  # a feed alone: the path goes on behind it
            continue
        if j > i:
            before = records[j - 1]
            if (r.kind != KIND_LINEAR and r.kind != KIND_CW and r.kind != KIND_CCW) or r.flags & FLAG_OPAQUE:
                break
            if not r.flags & FLAG_EXTRUDING or not r.flags & FLAG_KNOWN_X1 or not r.flags & FLAG_KNOWN_Y1:
                break
            if model.head.chords[(r.flags >> ROLE_SHIFT) & ROLE_MASK] != model.head.chord:
                break
            if r.x0 != before.x1 or r.y0 != before.y1 or r.z0 != before.z1:
                break
            if r.kind == KIND_LINEAR and r.x0 == r.x1 and r.y0 == r.y1:
                break
        trace(curve, r)
        if j > i and not stays_near(model, curve):
            break
        if r.z0 != r.z1 and not rising:
            if j == i:
                n = 1
                j += 1
            break
        n = _add_nodes(model, curve, run, n, across, along)
        j += 1
    run.end = j
    for k in range(2):
        _turns(model, state, counts, run, k, n)
    _cross_together(run, n)
    for k in range(2):
        _cross_along_path(run, k, n)
    for k in range(2):
        _turn_aside(run, k, n)


@inner
def _cross_together(run, n):
    """Let both motors cross their slack together on the first bit of path behind a corner, where the path goes back.

    They do so, too, where else both would cross at once on another stretch, and the nozzle would stand meanwhile. One
    that turns back slowly waits for the other, where it has the room.
    """
    turns0, turns1 = run.turns[0], run.turns[1]
    b = 0
    for a in range(TURNS):
        turn0 = turns0[a]
        if turn0.begin == np.inf:
            break
        at = turn0.node
        while turns1[b].begin < np.inf and turns1[b].node < at:
            b += 1
        turn1 = turns1[b]
        if at == 0 or turn1.begin == np.inf or turn1.node != at:
            continue
        corner = run.nodes[at].s
        back = turn0.corner == corner and turn1.corner == corner and _is_sharp(run, 0, at) and _is_sharp(run, 1, at)
        if not back and min(turn0.end, turn1.end) - max(turn0.begin, turn1.begin) <= NEAR_MM:
            continue
        if not back and (_yield_to(run, 0, n, turn0, turn1) or _yield_to(run, 1, n, turn1, turn0)):
            continue
        most, long, later0, later1 = max(turn0.slack, turn1.slack), 0.0, 0.0, 0.0
        room = min(run.nodes[at + 1].s, turns0[a + 1].begin, turns1[b + 1].begin) - corner
        if room >= SHORTEST_STRETCH_MM and MIN_PIECE_MM <= most <= FASTEST_AT_CORNER * min(room, TOGETHER_MM):
            long = min(room, TOGETHER_MM)
            later0, later1 = _waited_shares(run, at, long, turn0.slack, turn1.slack)
        elif not back:
            continue
        for k in range(2):
            turn, later = (turn0, later0) if k == 0 else (turn1, later1)
            rise = _belt_at(run, k, at, n, corner + long) - run.nodes[at].belt[k]
            _put_turn(turn, corner + later * long, corner + long, turn.trend, rise, 0.0, corner)


@inner
def _yield_to(run, k, n, turn, other):
    """Let motor k, which turns slowly, begin where the other has crossed at a corner; say whether there is room."""
    slowly = turn.corner == np.inf and other.corner < np.inf
    if not slowly or turn.slack > UNCUT_CROSSING * (turn.end - other.end):
        return False
    turn.begin = other.end
    turn.rise = _belt_at(run, k, turn.node, n, turn.end) - _belt_at(run, k, turn.node, n, turn.begin)
    return True


@inner
def _waited_shares(run, at, long, slack0, slack1):
    """Return for which share of the ``long`` bit of path behind node ``at`` each motor waits: the other crosses alone.

    Both together might go straight back on the path, for which the firmware has to stop. Then the one begins whose belt
    moved less on the path before.
    """
    before, here, after = run.nodes[at - 1].belt, run.nodes[at].belt, run.nodes[at + 1].belt
    in0, in1 = abs(here[0] - before[0]), abs(here[1] - before[1])
    part = long / (run.nodes[at + 1].s - run.nodes[at].s)
    way0, way1 = slack0 + part * abs(after[0] - here[0]), slack1 + part * abs(after[1] - here[1])
    if in0 * way0 + in1 * way1 < STRAIGHT_BACK_COSINE * norm(in0, in1) * norm(way0, way1):
        return 0.0, 0.0
    return (0.0, WAIT_SHARE) if in0 < in1 else (WAIT_SHARE, 0.0)


@inner
def _cross_along_path(run, k, n):
    """Where motor k crosses its slack behind a corner, let the other motor, whose belt stood until there, cross as
    well.

    The other motor leaves enough of its own slack for that stretch that the command goes in the path's direction. Then
    the firmware has no second bend to brake for.
    """
    other = 1 - k
    mine, others = run.turns[k], run.turns[other]
    b = 0
    for a in range(TURNS):
        turn = mine[a]
        corner, end, at = turn.corner, turn.end, turn.node
        if turn.begin == np.inf:
            break
        if turn.begin != corner or end == corner:
            continue
        while others[b].end < corner - NEAR_MM:
            b += 1
        before = others[b]
        begin, trend = before.begin, before.trend
        if before.corner < np.inf or begin > corner - NEAR_MM or before.end > end:
            continue
        fall = abs(_belt_at(run, k, at, n, end) - run.nodes[at].belt[k])
        across = trend * (_belt_at(run, other, at, n, end) - run.nodes[at].belt[other])
        if others[b + 1].begin < end or across <= 0.0 or fall <= 0.0:
            continue
        rise = _belt_at(run, other, at, n, end) - _belt_at(run, other, before.node, n, begin)
        whole = before.slack + max(trend * rise, 0.0)
        left = min((turn.slack + abs(turn.rise)) * across / fall, whole)
        before.end, before.corner, before.rise = end, corner, rise
        before.share = 1.0 - left / whole


@inner
def _turn_aside(run, k, n):
    """Where motor k alone crosses its slack behind a corner, straight back on the path before it, let the other begin.

    The firmware takes two bends faster than it turns back. The turn's corner is then where its motor begins.
    """
    mine, others = run.turns[k], run.turns[1 - k]
    b = 0
    for a in range(TURNS):
        turn = mine[a]
        begin, end, at = turn.begin, turn.end, turn.node
        if begin == np.inf:
            break
        if begin != turn.corner or at == 0:
            continue
        while others[b].end <= begin + NEAR_MM:
            b += 1
        wait = max(WAIT_SHARE * (end - begin), 2.0 * NEAR_MM)
        if others[b].begin < end or others[b].node == at or (b > 0 and others[b - 1].node == at):
            continue
        before, here = run.nodes[at - 1].belt, run.nodes[at].belt
        in0, in1 = here[k] - before[k], here[1 - k] - before[1 - k]
        way0, way1 = turn.trend * turn.slack, _belt_at(run, 1 - k, at, n, end) - here[1 - k]
        back = -in0 * way0 - in1 * way1 >= STRAIGHT_BACK_COSINE * norm(in0, in1) * norm(way0, way1)
        if back and abs(way1) >= SIDEWAYS_MM and wait <= 0.5 * (end - begin):
            turn.corner, turn.share = begin + wait, 0.0


@inner
def _add_nodes(model, curve, run, n, across, along):
    """Add the nodes of a curve to the run; return how many there are."""
    steps = 1
    if is_flat_arc(curve):
        steps = 4 + np.int64(abs(curve.sweep) * np.sqrt(curve.r0 / (8.0 * NODE_SAGITTA_MM)))
    elif curve.arc != 0.0:
        steps = 64
    elif is_framed(model) and curve.length > 4.0:
        steps = 1 + np.int64(curve.length * np.sqrt(model.head.frame_bend / (8.0 * NODE_SAGITTA_MM)))
    steps = min(steps, MOST_NODES_A_CURVE - 1)
    if n == 1:
        x, y, _ = place(curve, 0.0)
        _put_node(model, run.nodes[0], 0.0, x - across, y - along, 1)
    from_s = run.nodes[n - 1].s
    for step in range(1, steps + 1):
        x, y, _ = place(curve, step / steps)
        s = from_s + curve.length * (step / steps)
        _put_node(model, run.nodes[n], s, x - across, y - along, 1 if step == steps else 0)
        n += 1
    return n


@inner
def _put_node(model, node, s, x, y, ends_move):
    """Fill a node with the place (x, y) at length s of the path."""
    node.s, node.ends_move = s, ends_move
    node.belt[0], node.belt[1] = wanted(model, x, y)


@inner
def _turns(model, state, counts, run, k, n):
    """Find the reversals of motor k that exceed twice the tolerance; its belt does not follow smaller ones."""
    turns, turn = run.turns[k], 0
    run.turn[k], run.trend[k] = 0, 0.0
    _close(turns[0])
    if n < 2:
        return
    hold = 2.0 * model.head.chord
    start = run.nodes[0].belt[k]
    j = 1
    while j < n and abs(run.nodes[j].belt[k] - start) <= hold:
        j += 1
    if j == n:
        return
    trend = 1.0 if run.nodes[j].belt[k] > start else -1.0
    run.trend[k] = trend
    floor = 0.0
    slack = _slack_at_start(model, state, counts, k, start, trend)
    if slack > HOLD_MM:
        turns[0].slack, turns[0].node = slack, 0
        turn = _cross(model, run, turns[0], k, 0, j, -trend, slack, floor)
        floor = turns[0].end if turn > 0 else 0.0
    peak, at = run.nodes[j].belt[k], j
    for q in range(j + 1, n):
        u = run.nodes[q].belt[k]
        if trend * u >= trend * peak:
            peak, at = u, q
        elif trend * (peak - u) > hold and turn < TURNS - 1:
            slack = abs(backward(model, k, UPPER, peak) - backward(model, k, LOWER, peak))
            if slack <= FLAT_MM or _cross(model, run, turns[turn], k, at, q, trend, slack, floor) == 0:
                s = run.nodes[at].s
                _put_turn(turns[turn], s, s, -trend, 0.0, 0.0, s)
            turns[turn].slack, turns[turn].node = slack, at
            floor = turns[turn].end
            turn += 1
            trend, peak, at = -trend, u, q
    _close(turns[turn])


@inner
def _close(turn):
    """Put a turn at infinity, which is never reached, behind the last turn of a motor."""
    turn.begin = turn.end = turn.corner = np.inf


@inner
def _slack_at_start(model, state, counts, k, start, trend):
    """Return how far motor k is from where it will push its belt; 0 if the belt is not where it should be."""
    if counts.anywhere != 0 or not is_sure(state, k) or state.mended.side[k] == trend:
        return 0.0
    now = middle(state, k)
    if abs(now - start) > 1.5 * HOLD_MM:
        return 0.0
    return abs(backward(model, k, LOWER if trend > 0 else UPPER, now) - state.mended.m[k])


@inner
def _put_turn(turn, begin, end, trend, rise, tip, corner):
    """Fill a turn; its belt rises by ``rise`` on the stretch, ``tip`` of which it has risen before."""
    turn.begin, turn.end, turn.trend, turn.rise = begin, end, trend, rise - tip
    turn.motor_begin, turn.tip, turn.corner = np.nan, tip, corner


@inner
def _cross(model, run, turn, k, at, q, trend, slack, floor):
    """Fill the turn at node ``at`` if its slack can be crossed while printing on; return 1 then, otherwise 0.

    ``trend`` is that before the turn. At node ``q`` the belt has fallen by more than twice the tolerance. No stretch
    begins before ``floor``, where the last one ended.
    """
    n = q + 1
    begin, end = _stretch(run, k, at, n, trend, model.head.chord, floor)
    if slack > GENTLE_CROSSING * (end - begin):
        begin, end = _stretch(run, k, at, n, trend, 2.0 * model.head.chord, floor)
    long = end - begin
    if slack > UNCUT_CROSSING * long and (_is_corner(run, k, at, n) or slack > FASTEST_ON_CURVE * long):
        if at == 0:
            return 0  # before the path begins the nozzle may stand
        begin, end, share, tip = _stretch_around_corner(model, run, k, at, n, slack, floor)
        if share > 0.0:
            rise = _belt_at(run, k, at, n, end) - _belt_at(run, k, at, n, begin)
            _put_turn(turn, begin, end, -trend, rise, trend * tip, run.nodes[at].s)
            turn.share = share
            return 1
        begin, end, tip = _stretch_beside_corner(model, run, k, at, n, trend, floor)
        if slack > FASTEST_AT_CORNER * (end - begin) or end - begin + slack < MIN_PIECE_MM:
            return 0
        rise = _belt_at(run, k, at, n, end) - _belt_at(run, k, at, n, begin)
        _put_turn(turn, begin, end, -trend, rise, tip, run.nodes[at].s)
        return 1
    if long < SHORTEST_STRETCH_MM or long + slack < MIN_PIECE_MM:
        return 0
    # Where it may begin or end at the end of a move, no move has to be cut.
    first, last = _ends_within(run, at, n, begin, end)
    if last > first and slack <= UNCUT_CROSSING * (last - first):
        begin, end = first, last
    elif first - begin < end - last and slack <= UNCUT_CROSSING * (end - first):
        begin = first
    elif slack <= UNCUT_CROSSING * (last - begin):
        end = last
    elif slack <= UNCUT_CROSSING * (end - first):
        begin = first
    rise = _belt_at(run, k, at, n, end) - _belt_at(run, k, at, n, begin)
    _put_turn(turn, begin, end, -trend, rise, 0.0, np.inf)
    return 1


@inner
def _is_steep(run, k, a, most):
    """Say whether belt k goes by at least ``most`` a mm of path from node ``a`` to the next."""
    long = run.nodes[a + 1].s - run.nodes[a].s
    return abs(run.nodes[a + 1].belt[k] - run.nodes[a].belt[k]) >= most * long


@inner
def _is_sharp(run, k, at):
    """Say whether belt k moves fast on both sides of node ``at``."""
    return _is_steep(run, k, at - 1, CORNER_SLOPE) and _is_steep(run, k, at, CORNER_SLOPE)


@inner
def _is_corner(run, k, at, n):
    """Say whether belt k turns back at node ``at`` abruptly, not along a curve."""
    if at == 0 or at == n - 1:
        return False
    return _is_sharp(run, k, at) or _is_steep(run, k, at - 1, UPRIGHT_SLOPE) or _is_steep(run, k, at, UPRIGHT_SLOPE)


@inner
def _stretch_around_corner(model, run, k, at, n, slack, floor):
    """Return the stretch around node ``at`` on which belt k may stand, the corner's tip cut off.

    The third value is the share of the slack that is crossed before the node, 0 if there is no such stretch, because
    the other motor has to move on both sides. Behind the node the command turns half-way to the path, so that the
    firmware takes two small bends faster than one. The fourth is how far ahead of the path the belt stops.
    """
    corner = run.nodes[at].s
    if at == 0 or at == n - 1 or not run.nodes[at].ends_move:
        return corner, corner, 0.0, 0.0
    hold = 2.0 * model.head.chord
    fall_in = abs(run.nodes[at].belt[k] - run.nodes[at - 1].belt[k])
    fall_out = abs(run.nodes[at].belt[k] - run.nodes[at + 1].belt[k])
    across_in = abs(run.nodes[at].belt[1 - k] - run.nodes[at - 1].belt[1 - k])
    across_out = abs(run.nodes[at].belt[1 - k] - run.nodes[at + 1].belt[1 - k])
    drop = hold * min(ASLANT_PER_TOLERANCE, norm(fall_out, across_out) / max(across_out, 1e-9))
    tip = hold * min(ASLANT_PER_TOLERANCE, norm(fall_in, across_in) / max(across_in, 1e-9), drop / hold)
    if (
        fall_in < LEAST_FALL_PER_TOLERANCE * tip
        or fall_out < LEAST_FALL_PER_TOLERANCE * tip
        or tip * across_in < SIDEWAYS_MM * fall_in
    ):
        return corner, corner, 0.0, 0.0
    ahead = AHEAD_SHARE * tip
    begin = corner - (tip + ahead) / fall_in * (corner - run.nodes[at - 1].s)
    if begin < floor or not run.nodes[at - 1].ends_move:  # on a curve it may stray no further
        ahead, begin = 0.0, corner - tip / fall_in * (corner - run.nodes[at - 1].s)
    end = corner + (tip + drop) / fall_out * (run.nodes[at + 1].s - corner)
    if begin < floor or slack > FASTEST_AT_CORNER * (end - begin) or slack < MIN_PIECE_MM:
        return corner, corner, 0.0, 0.0
    way = (tip + drop) * across_out / fall_out
    rest = way / np.tan(BEND_SHARE * np.arctan2(across_out, fall_out))
    return begin, end, 1.0 - min(rest / (slack + drop), 0.5), ahead


@inner
def _stretch_beside_corner(model, run, k, at, n, trend, floor):
    """Return the stretch before or after node ``at`` on which the other motor goes furthest, possibly an empty one.

    The third value is how far the belt is off where the stretch begins: ahead of the path before the corner, or short
    of its tip. Either way it may stand for twice as long.
    """
    corner = run.nodes[at].s
    best_begin, best_end, most, tip = corner, corner, -1.0, 0.0
    for way in (1, -1):
        b = at + way
        if b < 0 or b >= n or (way < 0 and corner <= floor):
            continue
        hold = drop = 2.0 * model.head.chord
        fall = abs(run.nodes[b].belt[k] - run.nodes[at].belt[k])
        while 0 <= b + way < n and fall <= ASLANT_PER_TOLERANCE * hold:  # too short to show the path's direction
            b += way
            fall = abs(run.nodes[b].belt[k] - run.nodes[at].belt[k])
        across = abs(run.nodes[b].belt[1 - k] - run.nodes[at].belt[1 - k])
        aslant = hold * min(ASLANT_PER_TOLERANCE, norm(fall, across) / max(across, 1e-9))
        if fall > aslant and b == at + way:  # otherwise the path may bend within the stretch
            drop = aslant
        cut = hold if corner > floor and fall > drop + hold else 0.0
        if cut > 0.0 and abs(run.nodes[at - 1].belt[k] - run.nodes[at].belt[k]) <= LEAST_FALL_PER_TOLERANCE * hold:
            cut = 0.0
        begin, end = _stretch(run, k, at, n, trend, drop + cut, floor)
        if way < 0 and cut > 0.0 and begin <= floor + NEAR_MM:
            cut = 0.0
            begin, end = _stretch(run, k, at, n, trend, drop, floor)
        begin, end = (corner, end) if way > 0 else (begin, corner)
        sideways = abs(_belt_at(run, 1 - k, at, n, end) - _belt_at(run, 1 - k, at, n, begin))
        if sideways > most:
            best_begin, best_end, most, tip = begin, end, sideways, -way * trend * cut
    return best_begin, best_end, tip


@inner
def _stretch(run, k, at, n, trend, drop, floor):
    """Return the stretch [mm of path] around node ``at`` on which belt k lies no more than ``drop`` below its peak.

    It begins on no move that goes steeply to the peak: there the motor would go back on the path.
    """
    peak = run.nodes[at].belt[k]
    a = at
    while a > 0 and trend * (peak - run.nodes[a - 1].belt[k]) <= drop and run.nodes[a].s > floor:
        if _is_steep(run, k, a - 1, UPRIGHT_SLOPE):
            break
        a -= 1
    begin = run.nodes[a].s
    if a > 0 and not _is_steep(run, k, a - 1, UPRIGHT_SLOPE):
        begin = _place_of_fall(run, k, a, a - 1, trend, peak, drop)
    b = at
    while b < n - 1 and trend * (peak - run.nodes[b + 1].belt[k]) <= drop:
        b += 1
    end = run.nodes[b].s
    if b < n - 1:
        end = _place_of_fall(run, k, b, b + 1, trend, peak, drop)
    return min(max(begin, floor), end), end


@inner
def _place_of_fall(run, k, inside, outside, trend, peak, drop):
    """Return where belt k has fallen by ``drop``, between a node inside the stretch and one outside."""
    low, high = trend * (peak - run.nodes[inside].belt[k]), trend * (peak - run.nodes[outside].belt[k])
    s = run.nodes[inside].s
    if high <= drop:
        return s
    return s + (drop - low) / (high - low) * (run.nodes[outside].s - s)


@inner
def _ends_within(run, at, n, begin, end):
    """Return the first and the last end of a move between ``begin`` and ``end``; (end, begin) where there is none."""
    first, last = end, begin
    a = at
    while a >= 0 and run.nodes[a].s >= begin:
        if run.nodes[a].ends_move and run.nodes[a].s <= end:
            first, last = min(first, run.nodes[a].s), max(last, run.nodes[a].s)
        a -= 1
    a = at + 1
    while a < n and run.nodes[a].s <= end:
        if run.nodes[a].ends_move and run.nodes[a].s >= begin:
            first, last = min(first, run.nodes[a].s), max(last, run.nodes[a].s)
        a += 1
    return first, last


@inner
def _belt_at(run, k, at, n, s):
    """Return where belt k is wanted at s, near node ``at``."""
    a = at
    while a > 0 and run.nodes[a].s > s:
        a -= 1
    while a < n - 2 and run.nodes[a + 1].s < s:
        a += 1
    if a >= n - 1:
        return run.nodes[a].belt[k]
    long = run.nodes[a + 1].s - run.nodes[a].s
    part = (s - run.nodes[a].s) / long if long > 0.0 else 0.0
    return run.nodes[a].belt[k] + min(max(part, 0.0), 1.0) * (run.nodes[a + 1].belt[k] - run.nodes[a].belt[k])
