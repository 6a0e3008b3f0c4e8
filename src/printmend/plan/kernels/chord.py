"""Compiled search for the longest straight command whose printed path stays close enough to the wanted one."""

import numpy as np

from printmend.jit import inner
from printmend.plan.kernels.curve import (
    aside_and_along,
    is_flat_arc,
    norm,
    place,
)
from printmend.plan.kernels.layout import (
    ALONG_PER_ASIDE,
    FILAMENT_AREA_MM2,
    LEAST_ARC_RAD,
    LONGEST_ARC_RAD,
    MAX_AREA_MM2,
    TINY_ADVANCE_MM,
)
from printmend.plan.kernels.lookup import (
    LOWER,
    PULSES,
    UPPER,
    backward,
    from_motors,
    is_framed,
    printed,
    sharpest,
    to_motors,
    wanted,
)
from printmend.plan.kernels.state import command, followed, middle, motor_along

SHORT_MM = 0.4  # chords below this may bulge twice as far; on a radius of 4 mm all are shorter
LOOK_AHEAD_MM = 8.0  # how far along a line its curvature is looked up at once
LOOKS_A_CHORD, CLOSEST_LOOK_MM = 8.0, 0.01  # places of a chord that are checked, and the least distance between two
UNEVEN = 0.03  # share by which a wall's width may vary along a chord: some 1 % RMS
SHORTEST_EVEN_MM = 0.1  # chords that are to keep a wall's width: a quarter of a line's
SHORT_EVEN_MM = 0.3  # a wave whose speed changes by all of it within this is narrower than a line: no wall shows it
ALONG_AN_AXIS = 0.26  # the tangent of a wall's angle to it, at most
GENTLY = 0.1  # mm of slack a mm of path: a motor that crosses faster turns the command aside
LEAST_KEPT = 0.1  # share of a wave that a shaper must keep before the command makes up for the rest
MOST_SCORE = 1.1  # of a chord found by the exact command, whose distances are nearly those on the bed
REST_SHARE = 0.5  # of a chord: before a shorter rest it is cut in the middle
_FAR_MM = 12.0  # for how much of a motor's way the curvature of its tables is looked up


@inner
def _bulge(model, length):
    """Return how far a chord of that length may bulge; short ones may twice as far, or the firmware would go slowly."""
    return model.head.chord * (2.0 if length < SHORT_MM else 1.0)


@inner
def along_curve(model, curve, state, mode0, mode1, t):
    """Return the motor positions at t of the curve, on its way from where the motors are."""
    x, y, _ = place(curve, t)
    u0, u1 = wanted(model, x, y)
    return motor_along(model, state, 0, mode0, u0, t), motor_along(model, state, 1, mode1, u1, t)


@inner
def _exactly(model, curve, k, mode, t):
    """Return where motor k puts its belt where it is wanted at t, pushing in the sense of ``mode``."""
    x, y, _ = place(curve, t)
    u0, u1 = wanted(model, x, y)
    return backward(model, k, LOWER if mode > 0 else UPPER, u0 if k == 0 else u1)


@inner
def _made_up(model, curve, k, mode, t):
    """Return how far motor k must lead its exact position at t, because an input shaper takes a share of its ripple.

    The shaper keeps the share Σ a cos ω t of a wave. The command is the shaper's inverse, bounded where little is kept
    (Wiener); a wave that is not kept at all is not commanded. Nor is more than the acceleration lets the motor do: the
    firmware would slow the line.
    """
    h = model.head
    if mode == 0 or not h.ripple[k] > 0.0:
        return 0.0
    way = abs(_exactly(model, curve, k, mode, 1.0) - _exactly(model, curve, k, mode, 0.0))
    half = h.ripple[k] / (2.0 * max(way, h.ripple[k]))
    if t < half or t > 1.0 - half:
        return 0.0
    around = _exactly(model, curve, k, mode, t - half) + _exactly(model, curve, k, mode, t + half)
    wave = _exactly(model, curve, k, mode, t) / 2.0 - around / 4.0
    rate = 2.0 * np.pi * h.speed * way / (curve.length * h.ripple[k])
    kept = 0.0
    for i in range(PULSES):
        kept += h.pulse[k, i] * np.cos(rate * h.pulse_s[k, i])
    kept, least = max(kept, 0.0), LEAST_KEPT * LEAST_KEPT
    told = kept * (1.0 + least) / (kept * kept + least) * wave
    if h.accel > 0.0 and rate > 0.0:
        most = h.accel / (rate * rate)
        told = min(max(told, -most), most)
    return told - wave


# These kernels take many parameters: the curve, the motors and their modes, and what may be spared.
@inner
def _score(model, curve, state, mode0, mode1, t, end, m0, m1, spare_aside, spare_along, tip):
    """Return the largest error of the chord from t to ``end`` in units of what is allowed; the motors end at (m0, m1).

    At t the error may be larger by ``spare_aside`` and ``spare_along``; both shrink to nothing at ``end``. Towards
    ``end`` it may grow by ``tip``, by which a belt is commanded ahead of the path.
    """
    samples = max(3, np.int64(np.ceil(min((end - t) * curve.length, 4096.0) / model.head.sample)))
    from0, from1 = state.mended.m[0], state.mended.m[1]
    now0, now1 = middle(state, 0), middle(state, 1)
    held = (1 if mode0 == 0 else 0) + (1 if mode1 == 0 else 0)
    # a motor that stands is off by a further chord's tolerance
    aside_most = _bulge(model, (end - t) * curve.length) + held * model.head.chord
    worst = 0.0
    for i in range(1, samples + 1):
        s = i / (samples + 1)
        a = followed(model, 0, mode0, now0, from0 + s * (m0 - from0))
        b = followed(model, 1, mode1, now1, from1 + s * (m1 - from1))
        x, y = printed(model, a, b)
        aside, along = aside_and_along(curve, x, y, t + s * (end - t))
        off_aside = aside / max(aside_most + (1.0 - s) * spare_aside, model.head.chord + s * tip)
        off_along = along / (ALONG_PER_ASIDE * model.head.chord + (1.0 - s) * spare_along + s * tip)
        worst = max(worst, off_aside, off_along)
    return worst


@inner
def _longest(model, curve, state, mode0, mode1, t, whole, to0, to1, tip, bound, shortest):
    """Return the length, in t, of the longest admissible chord, by growing and shrinking a guess from the curvature.

    After the ``whole`` length the motors are at (to0, to1), by ``tip`` ahead of the path.
    """
    x, y = printed(model, middle(state, 0), middle(state, 1))
    aside, along = aside_and_along(curve, x, y, t)
    step = whole
    if bound > 0.0:
        step = min(whole, max(shortest, 2.0 * whole * np.sqrt(8.0 * model.head.chord / bound)))
    good = 0.0
    for _ in range(24):
        m0, m1, ahead = to0, to1, tip
        if step < whole:
            m0, m1 = along_curve(model, curve, state, mode0, mode1, t + step)
            ahead = 0.0
        score = _score(model, curve, state, mode0, mode1, t, t + step, m0, m1, aside + along, aside + along, ahead)
        if score <= 1.0:
            good = step
            if step >= whole or score > 0.7:
                break
            step = min(whole, step * min(3.0, 0.97 / np.sqrt(max(score, 1e-3))))
        else:
            if good > 0.0 or step <= shortest:
                break
            step = max(shortest, step * max(0.15, 0.93 / np.sqrt(score)))
    step = good if good > 0.0 else step
    rest = whole - step
    if rest <= 0.0 or (rest < shortest and whole < 2.0 * shortest):
        return whole
    return whole / 2 if rest < step else step  # two equal chords instead of one and a rest


@inner
def _look_mm(model, way0, way1, m0, m1, most, even):
    """Return the distance [mm] between two checks of a line from motors (m0, m1); they go (way0, way1) a mm of path."""
    bend0 = sharpest(model, 0, m0, m0 + LOOK_AHEAD_MM * way0) * way0 * way0
    bend1 = sharpest(model, 1, m1, m1 + LOOK_AHEAD_MM * way1) * way1 * way1
    bend = norm(bend0, bend1)
    look = UNEVEN / (4.0 * bend) if even and bend > 0.0 else LOOK_AHEAD_MM
    if is_framed(model):
        bend += model.head.frame_bend
    look = min(look, np.sqrt(16.0 * most / max(bend, 1e-12)) / LOOKS_A_CHORD)
    return min(max(look, CLOSEST_LOOK_MM), LOOK_AHEAD_MM)


# Long because its checks along the line are one loop. Its many parameters are the line, where the motors are on it,
# and how far the command may stray.
@inner
def _reach(model, curve, state, mode0, mode1, t, stop, to0, to1, tip_x, tip_y, shortest, even):
    """Return (end, m0, m1): where the longest straight command from t ends that stays near a line's exact command.

    The command must pass the exact command at each place within half the tolerance, which leaves it an interval of
    directions. It goes on for as long as these intervals share a direction. So its ends lie on the outer side of a
    bend, its middle on the inner side, and it goes straight through smaller ripples. Along the line its ends are
    exact. If ``even``, the exact command is nowhere much faster or slower. The command ends exactly at ``stop``,
    where the motors are at (to0, to1), by (tip_x, tip_y) ahead of a path that turns back. If only a short rest
    would remain, it ends in the middle instead, unless both halves would be below ``shortest``.
    """
    length, aside_most = curve.length, model.head.chord
    from0, from1 = state.mended.m[0], state.mended.m[1]
    x, y = from_motors(model, to0 - from0, to1 - from1)
    long = norm(x, y)
    if not long > 0.0:
        return stop, to0, to1
    tx, ty = x / long, y / long
    way0, way1 = (to0 - from0) / ((stop - t) * length), (to1 - from1) / ((stop - t) * length)
    m0, m1 = along_curve(model, curve, state, mode0, mode1, t)
    x, y = from_motors(model, m0 - from0, m1 - from1)
    least_along = max(abs(x * tx + y * ty), abs(tip_x * tx + tip_y * ty))
    along_most = max(SHORTEST_EVEN_MM / 4.0 if even else ALONG_PER_ASIDE * aside_most, least_along)
    near = max(aside_most, abs(tx * y - ty * x), abs(tx * tip_y - ty * tip_x))
    low, high, slow, fast = -np.inf, np.inf, -np.inf, np.inf
    last = behind = x * tx + y * ty
    slowest, fastest = -np.inf, np.inf
    end, aside, along, least, most = t, 0.0, 0.0, 0.0, 0.0
    half = (t + stop) / 2.0
    half_end, half_along, half_least, half_most = t, 0.0, 0.0, 0.0
    at, seen, step = t, t, 0.0
    while at < stop:
        if at >= seen:
            step = _look_mm(model, way0, way1, m0, m1, aside_most, even) / length
            seen = at + LOOK_AHEAD_MM / length
        limit = half if at < half else stop
        before, at = at, limit if limit - at < 1.5 * step else at + step
        if at == stop:
            m0, m1 = to0, to1
        else:
            m0, m1 = along_curve(model, curve, state, mode0, mode1, at)
        x, y = from_motors(model, m0 - from0, m1 - from1)
        a, p, q = x * tx + y * ty, tx * y - ty * x, at - t
        room = 0.0 if at == stop else aside_most
        from_p, to_p = max(p - room, low * q), min(p + room, high * q)
        if even:  # one command has one speed, so the wanted speeds along it must be nearly equal
            pace = (a - last) / (at - before)
            slowest, fastest = max(slowest, pace - UNEVEN * length), min(fastest, pace + UNEVEN * length)
            last = a
            if q * length > SHORTEST_EVEN_MM:
                slow, fast = max(slow, slowest), min(fast, fastest)
        if from_p <= to_p and slow * q <= (a - behind if even else a) <= fast * q:
            end, aside, along, least, most = at, p, a, from_p, to_p
            if at == half:
                half_end, half_along, half_least, half_most = at, a, from_p, to_p
        low, high = max(low, (p - near) / q), min(high, (p + near) / q)
        slow, fast = max(slow, (a - along_most) / q), min(fast, (a + along_most) / q)
        if low > high or slow > fast:
            break
    if end in (t, stop):
        return end, to0, to1
    if stop - end < REST_SHARE * (end - t) and half_end - t >= shortest:  # as straight on to the end as may be
        x, y = from_motors(model, to0 - from0, to1 - from1)
        end, along, p = half, half_along, min(max((tx * y - ty * x) / 2.0, half_least), half_most)
    else:
        p = most if p / q > aside / (end - t) else least
    x, y = along * tx - p * ty, along * ty + p * tx
    d0, d1 = to_motors(model, x, y)
    if even:
        d0 += _made_up(model, curve, 0, mode0, end)
        d1 += _made_up(model, curve, 1, mode1, end)
    if mode0 == 0:  # it stands, or crosses its slack
        d0 = motor_along(model, state, 0, mode0, 0.0, end) - from0
    elif mode0 * d0 < 0.0 and mode0 != 2:
        d0 = 0.0
    if mode1 == 0:
        d1 = motor_along(model, state, 1, mode1, 0.0, end) - from1
    elif mode1 * d1 < 0.0 and mode1 != 2:
        d1 = 0.0
    return end, from0 + d0, from1 + d1


@inner
def _is_even(model, curve):
    """Say whether a line's width shows and follows the speed of one axis, as on an outer wall along an axis."""
    x, y = abs(curve.x1 - curve.x0), abs(curve.y1 - curve.y0)
    return model.head.even != 0.0 and min(x, y) <= ALONG_AN_AXIS * max(x, y)


# As `_reach`.
@inner
def _longest_line(model, curve, state, mode0, mode1, t, stop, to0, to1, tip_x, tip_y, shortest):
    """Return (end, m0, m1): where the longest admissible chord of a line ends; t if that would be a short one.

    Belts that lag, or that are not yet driven, do not follow the exact command. Then the chord is refused.
    """
    most, even = model.head.chord, _is_even(model, curve)
    least = shortest if even else max(shortest, SHORT_MM / curve.length)
    end, m0, m1 = _reach(model, curve, state, mode0, mode1, t, stop, to0, to1, tip_x, tip_y, least, even)
    if end < stop and end - t < least:
        return t, m0, m1
    x, y = printed(model, middle(state, 0), middle(state, 1))
    aside, along = aside_and_along(curve, x, y, t)
    # along a wall a chord may lead by what a shaper will take from it
    aside, along = max(aside - most, 0.0), np.inf if even else max(along - ALONG_PER_ASIDE * most, 0.0)
    tip = norm(tip_x, tip_y) if end == stop else 0.0
    if _score(model, curve, state, mode0, mode1, t, end, m0, m1, aside, along, tip) > MOST_SCORE:
        return t, m0, m1
    return end, m0, m1


@inner
def chord(model, curve, state, mode0, mode1, t, stop, u0, u1, advance):
    """Return (end, m0, m1): where the longest admissible chord from t ends, and the motors there.

    It ends at ``stop``, where the belts are wanted at (u0, u1), or before.
    """
    length = curve.length
    shortest = curve.least / length
    m0, m1 = motor_along(model, state, 0, mode0, u0, stop), motor_along(model, state, 1, mode1, u1, stop)
    if curve.arc != 0.0 and not is_flat_arc(curve):  # what is looked at below is only seen from above
        step = np.sqrt(8.0 * model.head.chord / max(curve.r0, model.head.chord)) / abs(curve.sweep)
        stop = min(stop, t + max(step, shortest))
        m0, m1 = along_curve(model, curve, state, mode0, mode1, stop)
    whole = stop - t
    from0, from1 = state.mended.m[0], state.mended.m[1]
    # What crosses its slack moves no belt: nothing bends.
    d0 = 0.0 if mode0 == 0 else abs(m0 - from0)
    d1 = 0.0 if mode1 == 0 else abs(m1 - from1)
    far0, far1 = min(d0, _FAR_MM) * np.sign(m0 - from0), min(d1, _FAR_MM) * np.sign(m1 - from1)
    bend0, bend1 = sharpest(model, 0, from0, from0 + far0), sharpest(model, 1, from1, from1 + far1)
    bound = norm(bend0 * d0 * d0, bend1 * d1 * d1)  # 8 times the sagitta, at most
    if is_flat_arc(curve):
        bound += whole * whole * abs(curve.sweep) * length
    elif is_framed(model):
        bound += model.head.frame_bend * whole * whole * length * length
    step = whole
    if bound > 8.0 * _bulge(model, whole * length) or ((d0 > _FAR_MM or d1 > _FAR_MM) and model.head.bent != 0.0):
        end = t
        path0, path1 = along_curve(model, curve, state, mode0, mode1, stop)
        tip_x, tip_y = from_motors(model, m0 - path0, m1 - path1)
        bend = bound / (whole * whole * length * length)  # a mm, at most
        if _is_even(model, curve):
            bends = bend * SHORT_EVEN_MM > 1.0
        else:
            bends = bend * SHORT_MM * SHORT_MM > 64.0 * model.head.chord  # all chords are short
        crosses = max(abs(state.crossing[0]), abs(state.crossing[1])) > GENTLY * length
        if curve.arc == 0.0 and not crosses and not bends:
            end, n0, n1 = _longest_line(model, curve, state, mode0, mode1, t, stop, m0, m1, tip_x, tip_y, shortest)
        step = end - t
        if end > t:
            m0, m1 = n0, n1
        else:
            tip = norm(tip_x, tip_y)
            step = _longest(model, curve, state, mode0, mode1, t, whole, m0, m1, tip, bound, shortest)
            if step < whole:
                m0, m1 = along_curve(model, curve, state, mode0, mode1, t + step)
    part = step * advance
    if part > TINY_ADVANCE_MM and advance * FILAMENT_AREA_MM2 <= MAX_AREA_MM2 * length:
        # Klipper refuses more than MAX_AREA_MM2 of plastic a millimetre, except in the shortest of moves.
        x, y = from_motors(model, m0 - from0, m1 - from1)
        if part * FILAMENT_AREA_MM2 > MAX_AREA_MM2 * norm(x, y):
            step = min(max(TINY_ADVANCE_MM / advance, shortest), step)
            m0, m1 = along_curve(model, curve, state, mode0, mode1, t + step)
    if whole - step < 1e-12:
        return stop, m0, m1
    return t + step, m0, m1


# Compiled search for the longest arc whose printed path stays close enough to the arc that the file wants.
#
# A bent machine draws an arc nearly right if it is told another one: through three places of the command that would be
# exactly right, its two ends and its middle. What is left is of the third order, where a chord's is of the second.

_TRIALS = 5  # of a length, each half of the one before
_LOOKS_A_RAD = 16.0
_SWEEP_SHARE = 0.2  # by which the sweep may differ from the wanted one; beyond it the circle goes the other way round


@inner
def on_arc(x0, y0, x1, y1, center, sweep, s):
    """Return the place at the share s of an arc from (x0, y0) to (x1, y1), whose radius may change a little."""
    dx, dy = x0 - center[0], y0 - center[1]
    r0 = norm(dx, dy)
    scale = 1.0 + s * (norm(x1 - center[0], y1 - center[1]) - r0) / r0 if r0 > 0.0 else 1.0
    cosine, sine = scale * np.cos(s * sweep), scale * np.sin(s * sweep)
    return center[0] + cosine * dx - sine * dy, center[1] + sine * dx + cosine * dy


@inner
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
@inner
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
            if (
                same
                and _arc_score(model, curve, state, mode0, mode1, t, step, from_x, from_y, x, y, aside + along) <= 1.0
            ):
                return end, m0, m1
        step /= 2.0
    return t, state.mended.m[0], state.mended.m[1]


@inner
def _arc_score(model, curve, state, mode0, mode1, t, step, from_x, from_y, to_x, to_y, start_error):
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
