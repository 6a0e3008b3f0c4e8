"""Compiled survey of an extruded path: where each motor turns back, and on which stretch its slack is crossed.

Near a reversal a motor's belt hardly moves: for as long as it may stand still within the tolerance, its motor crosses
the slack while the nozzle prints on. Where a curve of radius R turns, that is 2 √(2 R ε) of path for an error ε. A
sharp corner has ε / sin α on either side of it, α being the side's angle to the other axis: there the firmware is slow
anyway, and the slack is crossed around the corner, whose tip is cut off, or in one move that begins or ends there. The
firmware brakes for the angle between two commands: so the crossing bends towards the path behind the corner, and the
other motor leaves some slack of its own for it. Where there is no room, it is taken up while the nozzle stands still.
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
)
from printmend.invert.kernels.curve import ARC, LENGTH, R0, SWEEP, is_flat_arc, norm, place, stays_near, trace
from printmend.invert.kernels.layout import (
    HOLD_MM,
    MIN_PIECE_MM,
    NEAR_MM,
    NODE,
    NODES,
    RUN_AT,
    RUN_BEGIN,
    RUN_END,
    RUN_TREND,
    TURN,
    TURN_BEGIN,
    TURN_CORNER,
    TURN_END,
    TURN_FROM,
    TURN_NODE,
    TURN_RISE,
    TURN_SHARE,
    TURN_SLACK,
    TURN_TIP,
    TURN_TREND,
    TURNS,
)
from printmend.invert.kernels.lookup import (
    LOWER,
    UPPER,
    backward,
    is_framed,
    wanted,
)
from printmend.invert.kernels.state import is_sure, middle
from printmend.jit import inner

FLAT_MM = 2e-4  # a belt that moves less stands still
GENTLE_CROSSING = 0.5  # how fast a motor may cross its slack, in the nozzle's speed, to be no nearer the limit
UNCUT_CROSSING = 0.75  # … to spare a move from being cut
FLAT_CROSSING = 0.5  # … at which the stretch where the belt stands still anyway is long enough
FASTEST_ON_CURVE = 8.0  # … at most around a turn that is no corner
FASTEST_AT_CORNER = 16.0  # … at most at a corner: beyond that the nozzle all but stands, then it may as well
SHORTEST_MM = 0.02  # of path: beyond that the nozzle stands
SIDEWAYS_MM = 0.01  # the least that the other motor moves meanwhile before a corner that is gone around
CORNER_SLOPE = 0.5  # a corner: on both sides the belt falls by this much a mm of path, or more,
UPRIGHT = 0.8  # or on one of them by this much: there a motor that crosses its slack goes back on the path
AGREED_MM = 0.02  # of path drawn while both motors cross their slack at one corner: the nozzle does not quite stand
BACK = 0.98  # a crossing goes straight back on the path: this much of it, or more
LEAST_SHARE = 0.3  # of that bit of path on which one motor crosses alone
LEAST_FALL = 4.0  # times the tolerance: the least that a belt moves towards a tip for it to stop before that
BEND_SHARE = 0.6  # of the angle between motor and path behind a corner: how far the command has turned half-way
ASLANT = 1.5  # times the tolerance: how far a belt may be off where that is aslant to the path
BOW_MM = 0.002  # how far the nodes of a curved path lie inside it
MOST_BOWS = 256  # nodes that one curve adds to a path


# Its many parameters are the arrays of one file's way through `mend`, and how the Z screw pushes the path aside.
@inner(error_model="numpy", _nrt=False)
def survey(model, state, counts, records, count, i, curve, run, across, along, rising):
    """Fill ``run`` with the turns of the path that record i begins: extruding moves, each from where the last ended.

    The belts have to go to the path less (``across``, ``along``), which the Z screw pushes the nozzle by; where not
    ``rising``, the path ends before a record that rises. ``curve`` is scratch.
    """
    run[0, RUN_BEGIN] = 0.0
    n = 1
    j = i
    while j < count and n + MOST_BOWS < NODES:
        r = records[j]
        if j > i:
            before = records[j - 1]
            if (r.kind != KIND_LINEAR and r.kind != KIND_CW and r.kind != KIND_CCW) or r.flags & FLAG_OPAQUE:
                break
            if not r.flags & FLAG_EXTRUDING or not r.flags & FLAG_KNOWN_X1 or not r.flags & FLAG_KNOWN_Y1:
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
        n = _walk(model, curve, run, n, across, along)
        j += 1
    run[0, RUN_END] = j
    for k in range(2):
        _turns(model, state, counts, run, k, n)
    _agree(run, n)
    for k in range(2):
        _join(run, k, n)


@inner(error_model="numpy", _nrt=False)
def _agree(run, n):
    """Where the path goes back on itself both motors take up their slack in one move, with the first bit behind."""
    b = TURN + TURNS
    for a in range(TURN, TURN + TURNS):
        corner = run[a, TURN_CORNER]
        if run[a, TURN_BEGIN] == np.inf:
            break
        while run[b, TURN_END] < min(corner, run[a, TURN_END]):
            b += 1
        at = np.int64(run[a, TURN_NODE])
        if corner < np.inf and run[b, TURN_CORNER] == corner and _is_sharp(run, 0, at) and _is_sharp(run, 1, at):
            most = max(run[a, TURN_SLACK], run[b, TURN_SLACK])
            end, later0, later1 = corner + AGREED_MM, 0.0, 0.0
            room = min(run[NODE + at + 1, 0], run[a + 1, TURN_BEGIN], run[b + 1, TURN_BEGIN])
            if end > room or most > FASTEST_AT_CORNER * AGREED_MM or most < MIN_PIECE_MM:
                end = corner
            else:
                later0, later1 = _later(run, at, run[a, TURN_SLACK], run[b, TURN_SLACK])
            for k in range(2):
                turn, later = (a, later0) if k == 0 else (b, later1)
                rise = _belt(run, k, at, n, end) - run[NODE + at, 1 + k]
                _turn(run, turn, corner + later * AGREED_MM, end, run[turn, TURN_TREND], rise, 0.0, corner)


@inner(error_model="numpy", _nrt=False)
def _later(run, at, slack0, slack1):
    """Return on which share of the way behind corner ``at`` each motor waits for the other to cross alone.

    Where both together would go straight back on the path, which the firmware has to stop for, the one that has more to
    cross begins, until what is left goes as the path behind the corner.
    """
    in0, in1 = abs(run[NODE + at, 1] - run[NODE + at - 1, 1]), abs(run[NODE + at, 2] - run[NODE + at - 1, 2])
    out0, out1 = abs(run[NODE + at, 1] - run[NODE + at + 1, 1]), abs(run[NODE + at, 2] - run[NODE + at + 1, 2])
    if in0 * slack0 + in1 * slack1 < BACK * norm(in0, in1) * norm(slack0, slack1):
        return 0.0, 0.0
    alone0, alone1 = 1.0 - slack1 * out0 / (out1 * slack0), 1.0 - slack0 * out1 / (out0 * slack1)
    if alone0 > alone1:
        return 0.0, min(max(alone0, LEAST_SHARE), 1.0 - LEAST_SHARE)
    return min(max(alone1, LEAST_SHARE), 1.0 - LEAST_SHARE), 0.0


@inner(error_model="numpy", _nrt=False)
def _join(run, k, n):
    """Where motor k takes up its slack behind a corner, leave the other so much of its own that both go as the path.

    The other one's belt stood until there. Crossing as the path goes on, they leave the firmware no second bend.
    """
    b, other = TURN + (1 - k) * TURNS, 1 - k
    for a in range(TURN + k * TURNS, TURN + (k + 1) * TURNS):
        corner, end = run[a, TURN_CORNER], run[a, TURN_END]
        if run[a, TURN_BEGIN] == np.inf:
            break
        if run[a, TURN_BEGIN] != corner or end == corner:
            continue
        while run[b, TURN_END] < corner - NEAR_MM:
            b += 1
        begin, trend, at = run[b, TURN_BEGIN], run[b, TURN_TREND], np.int64(run[a, TURN_NODE])
        if run[b, TURN_CORNER] < np.inf or begin > corner - NEAR_MM or run[b, TURN_END] > end:
            continue
        fall = abs(_belt(run, k, at, n, end) - run[NODE + at, 1 + k])
        across = trend * (_belt(run, other, at, n, end) - run[NODE + at, 1 + other])
        if run[b + 1, TURN_BEGIN] < end or across <= 0.0 or fall <= 0.0:
            continue
        rise = _belt(run, other, at, n, end) - _belt(run, other, np.int64(run[b, TURN_NODE]), n, begin)
        whole = run[b, TURN_SLACK] + max(trend * rise, 0.0)
        left = min((run[a, TURN_SLACK] + abs(run[a, TURN_RISE])) * across / fall, whole)
        run[b, TURN_END], run[b, TURN_CORNER], run[b, TURN_RISE] = end, corner, rise
        run[b, TURN_SHARE] = 1.0 - left / whole


@inner(error_model="numpy", _nrt=False)
def _walk(model, curve, run, n, across, along):
    """Add the nodes of a curve to the run; return how many there are. A node: s [mm], both belts [mm], 1 at an end."""
    steps = 1
    if is_flat_arc(curve):
        steps = 4 + np.int64(abs(curve[SWEEP]) * np.sqrt(curve[R0] / (8.0 * BOW_MM)))
    elif curve[ARC] != 0.0:
        steps = 64
    elif is_framed(model) and curve[LENGTH] > 4.0:
        steps = 1 + np.int64(curve[LENGTH] * np.sqrt(model.head.frame_bend / (8.0 * BOW_MM)))
    steps = min(steps, MOST_BOWS - 1)
    if n == 1:
        x, y, _ = place(curve, 0.0)
        _put(model, run, 0, 0.0, x - across, y - along, 1.0)
    from_s = run[NODE + n - 1, 0]
    for step in range(1, steps + 1):
        x, y, _ = place(curve, step / steps)
        s = from_s + curve[LENGTH] * (step / steps)
        _put(model, run, n, s, x - across, y - along, 1.0 if step == steps else 0.0)
        n += 1
    return n


@inner(error_model="numpy", _nrt=False)
def _put(model, run, n, s, x, y, end):
    u0, u1 = wanted(model, x, y)
    node = NODE + n
    run[node, 0], run[node, 1], run[node, 2], run[node, 3] = s, u0, u1, end


@inner(error_model="numpy", _nrt=False)
def _turns(model, state, counts, run, k, n):
    """Find the turns of motor k: reversals of more than twice the tolerance; smaller ones its belt does not follow."""
    turn = TURN + k * TURNS
    run[0, RUN_AT + k], run[0, RUN_TREND + k] = turn, 0.0
    last = turn + TURNS - 1
    run[turn, TURN_BEGIN] = run[turn, TURN_END] = run[turn, TURN_CORNER] = np.inf
    if n < 2:
        return
    hold = 2.0 * model.head.chord
    start = run[NODE, 1 + k]
    j = 1
    while j < n and abs(run[NODE + j, 1 + k] - start) <= hold:
        j += 1
    if j == n:
        return
    trend = 1.0 if run[NODE + j, 1 + k] > start else -1.0
    run[0, RUN_TREND + k] = trend
    floor = 0.0
    slack = _slack_at_start(model, state, counts, k, start, trend)
    if slack > HOLD_MM:
        run[turn, TURN_SLACK], run[turn, TURN_NODE] = slack, 0
        turn += _cross(model, run, turn, k, 0, j, -trend, slack, floor)
        floor = run[turn - 1, TURN_END] if turn > TURN + k * TURNS else 0.0
    peak, at = run[NODE + j, 1 + k], j
    for q in range(j + 1, n):
        u = run[NODE + q, 1 + k]
        if trend * u >= trend * peak:
            peak, at = u, q
        elif trend * (peak - u) > hold and turn < last:
            slack = abs(backward(model, k, UPPER, peak) - backward(model, k, LOWER, peak))
            if slack <= FLAT_MM or _cross(model, run, turn, k, at, q, trend, slack, floor) == 0:
                s = run[NODE + at, 0]
                _turn(run, turn, s, s, -trend, 0.0, 0.0, s)
            run[turn, TURN_SLACK], run[turn, TURN_NODE] = slack, at
            floor = run[turn, TURN_END]
            turn += 1
            trend, peak, at = -trend, u, q
    run[turn, TURN_BEGIN] = run[turn, TURN_END] = run[turn, TURN_CORNER] = np.inf


@inner(error_model="numpy", _nrt=False)
def _slack_at_start(model, state, counts, k, start, trend):
    """Return how far motor k is from where it will push its belt, which is where it should be; 0 where it is not."""
    if counts.anywhere != 0 or not is_sure(state, k) or state.mended.side[k] == trend:
        return 0.0
    now = middle(state, k)
    if abs(now - start) > 1.5 * HOLD_MM:
        return 0.0
    return abs(backward(model, k, LOWER if trend > 0 else UPPER, now) - state.mended.m[k])


@inner(error_model="numpy", _nrt=False)
def _turn(run, turn, begin, end, trend, rise, tip, corner):
    row = run[turn]
    row[TURN_BEGIN], row[TURN_END], row[TURN_TREND], row[TURN_RISE] = begin, end, trend, rise - tip
    row[TURN_FROM], row[TURN_TIP], row[TURN_CORNER] = np.nan, tip, corner


@inner(error_model="numpy", _nrt=False)
def _cross(model, run, turn, k, at, q, trend, slack, floor):
    """Write the turn at node ``at`` if its slack can be crossed while printing on; return how many were written.

    ``trend`` is that before the turn; at node ``q`` the belt has fallen by more than twice the tolerance. No stretch
    begins before ``floor``, where the last one ended.
    """
    n = q + 1
    begin, end = _stretch(run, k, at, n, trend, FLAT_MM, floor)
    if slack > FLAT_CROSSING * (end - begin):
        begin, end = _stretch(run, k, at, n, trend, model.head.chord, floor)
    if slack > GENTLE_CROSSING * (end - begin):
        begin, end = _stretch(run, k, at, n, trend, 2.0 * model.head.chord, floor)
    long = end - begin
    if slack > UNCUT_CROSSING * long and (_is_corner(run, k, at, n) or slack > FASTEST_ON_CURVE * long):
        if at == 0:
            return 0  # before the path begins the nozzle may stand
        begin, end, share = _around(model, run, k, at, n, slack, floor)
        if share > 0.0:
            rise = _belt(run, k, at, n, end) - _belt(run, k, at, n, begin)
            _turn(run, turn, begin, end, -trend, rise, 0.0, run[NODE + at, 0])
            run[turn, TURN_SHARE] = share
            return 1
        begin, end, tip = _side(model, run, k, at, n, trend, floor)
        if slack > FASTEST_AT_CORNER * (end - begin) or end - begin + slack < MIN_PIECE_MM:
            return 0
        rise = _belt(run, k, at, n, end) - _belt(run, k, at, n, begin)
        _turn(run, turn, begin, end, -trend, rise, tip, run[NODE + at, 0])
        return 1
    if long < SHORTEST_MM or long + slack < MIN_PIECE_MM:
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
    rise = _belt(run, k, at, n, end) - _belt(run, k, at, n, begin)
    _turn(run, turn, begin, end, -trend, rise, 0.0, np.inf)
    return 1


@inner(error_model="numpy", _nrt=False)
def _falls(run, k, a, most):
    """Say whether belt k goes by at least ``most`` a mm of path from node ``a`` to the next."""
    long = run[NODE + a + 1, 0] - run[NODE + a, 0]
    return abs(run[NODE + a + 1, 1 + k] - run[NODE + a, 1 + k]) >= most * long


@inner(error_model="numpy", _nrt=False)
def _is_sharp(run, k, at):
    return _falls(run, k, at - 1, CORNER_SLOPE) and _falls(run, k, at, CORNER_SLOPE)


@inner(error_model="numpy", _nrt=False)
def _is_corner(run, k, at, n):
    if at == 0 or at == n - 1:
        return False
    return _is_sharp(run, k, at) or _falls(run, k, at - 1, UPRIGHT) or _falls(run, k, at, UPRIGHT)


@inner(error_model="numpy", _nrt=False)
def _around(model, run, k, at, n, slack, floor):
    """Return the stretch from before node ``at`` to behind it on which belt k may stand, its tip cut off.

    The third is which share of the slack is crossed before the node, 0 where there is no such stretch: the other motor
    has to move on both sides. Behind the node the command then turns half-way to the path, so that the firmware takes
    both bends faster than one.
    """
    corner = run[NODE + at, 0]
    if at == 0 or at == n - 1 or run[NODE + at, 3] == 0.0:
        return corner, corner, 0.0
    hold = 2.0 * model.head.chord
    fall_in = abs(run[NODE + at, 1 + k] - run[NODE + at - 1, 1 + k])
    fall_out = abs(run[NODE + at, 1 + k] - run[NODE + at + 1, 1 + k])
    across_in = abs(run[NODE + at, 2 - k] - run[NODE + at - 1, 2 - k])
    across_out = abs(run[NODE + at, 2 - k] - run[NODE + at + 1, 2 - k])
    drop = hold * min(ASLANT, norm(fall_out, across_out) / max(across_out, 1e-9))
    tip = hold * min(ASLANT, norm(fall_in, across_in) / max(across_in, 1e-9), drop / hold)
    if fall_in < LEAST_FALL * tip or fall_out < LEAST_FALL * tip or tip * across_in < SIDEWAYS_MM * fall_in:
        return corner, corner, 0.0
    begin = corner - tip / fall_in * (corner - run[NODE + at - 1, 0])
    end = corner + (tip + drop) / fall_out * (run[NODE + at + 1, 0] - corner)
    if begin < floor or slack > FASTEST_AT_CORNER * (end - begin) or slack < MIN_PIECE_MM:
        return corner, corner, 0.0
    way = (tip + drop) * across_out / fall_out
    rest = way / np.tan(BEND_SHARE * np.arctan2(across_out, fall_out))
    return begin, end, 1.0 - min(rest / (slack + drop), 0.5)


@inner(error_model="numpy", _nrt=False)
def _side(model, run, k, at, n, trend, floor):
    """Return the stretch before or after node ``at`` on which the other motor goes furthest, an empty one at worst.

    The third is by how much the belt goes too far before the corner, below 0 where it does not reach the tip: then it
    may stand still for longer behind it.
    """
    corner = run[NODE + at, 0]
    best_begin, best_end, most, tip = corner, corner, -1.0, 0.0
    for way in (1, -1):
        b = at + way
        if b < 0 or b >= n or (way < 0 and corner <= floor):
            continue
        fall = abs(run[NODE + b, 1 + k] - run[NODE + at, 1 + k])
        across = abs(run[NODE + b, 2 - k] - run[NODE + at, 2 - k])
        hold = drop = 2.0 * model.head.chord
        aslant = hold * min(ASLANT, norm(fall, across) / max(across, 1e-9))
        if fall > aslant:  # else the path may bend within the stretch
            drop = aslant
        cut = hold if way > 0 and corner > floor and fall > drop + hold else 0.0
        if cut > 0.0 and abs(run[NODE + at - 1, 1 + k] - run[NODE + at, 1 + k]) <= LEAST_FALL * hold:
            cut = 0.0
        begin, end = _stretch(run, k, at, n, trend, drop + cut, floor)
        begin, end = (corner, end) if way > 0 else (begin, corner)
        sideways = abs(_belt(run, 1 - k, at, n, end) - _belt(run, 1 - k, at, n, begin))
        if sideways > most:
            best_begin, best_end, most, tip = begin, end, sideways, -trend * cut
    return best_begin, best_end, tip


@inner(error_model="numpy", _nrt=False)
def _stretch(run, k, at, n, trend, drop, floor):
    """Return the stretch [mm of path] around node ``at`` on which belt k lies no more than ``drop`` below its peak.

    It begins on no move that goes upright to the peak: there the motor would go back on the path.
    """
    peak = run[NODE + at, 1 + k]
    a = at
    while a > 0 and trend * (peak - run[NODE + a - 1, 1 + k]) <= drop and run[NODE + a, 0] > floor:
        if _falls(run, k, a - 1, UPRIGHT):
            break
        a -= 1
    begin = run[NODE + a, 0]
    if a > 0 and not _falls(run, k, a - 1, UPRIGHT):
        begin = _where(run, k, a, a - 1, trend, peak, drop)
    b = at
    while b < n - 1 and trend * (peak - run[NODE + b + 1, 1 + k]) <= drop:
        b += 1
    end = run[NODE + b, 0]
    if b < n - 1:
        end = _where(run, k, b, b + 1, trend, peak, drop)
    return min(max(begin, floor), end), end


@inner(error_model="numpy", _nrt=False)
def _where(run, k, inside, outside, trend, peak, drop):
    """Return where belt k has fallen by ``drop``, between a node inside the stretch and one outside."""
    low, high = trend * (peak - run[NODE + inside, 1 + k]), trend * (peak - run[NODE + outside, 1 + k])
    s = run[NODE + inside, 0]
    if high <= drop:
        return s
    return s + (drop - low) / (high - low) * (run[NODE + outside, 0] - s)


@inner(error_model="numpy", _nrt=False)
def _ends_within(run, at, n, begin, end):
    """Return the first and the last end of a move between ``begin`` and ``end``; (end, begin) where there is none."""
    first, last = end, begin
    a = at
    while a >= 0 and run[NODE + a, 0] >= begin:
        if run[NODE + a, 3] != 0.0 and run[NODE + a, 0] <= end:
            first, last = min(first, run[NODE + a, 0]), max(last, run[NODE + a, 0])
        a -= 1
    a = at + 1
    while a < n and run[NODE + a, 0] <= end:
        if run[NODE + a, 3] != 0.0 and run[NODE + a, 0] >= begin:
            first, last = min(first, run[NODE + a, 0]), max(last, run[NODE + a, 0])
        a += 1
    return first, last


@inner(error_model="numpy", _nrt=False)
def _belt(run, k, at, n, s):
    """Return where belt k is wanted at s, near node ``at``."""
    a = at
    while a > 0 and run[NODE + a, 0] > s:
        a -= 1
    while a < n - 2 and run[NODE + a + 1, 0] < s:
        a += 1
    if a >= n - 1:
        return run[NODE + a, 1 + k]
    long = run[NODE + a + 1, 0] - run[NODE + a, 0]
    part = (s - run[NODE + a, 0]) / long if long > 0.0 else 0.0
    return run[NODE + a, 1 + k] + min(max(part, 0.0), 1.0) * (run[NODE + a + 1, 1 + k] - run[NODE + a, 1 + k])
