"""How fast a corner between two moves is taken: a rule for each kind of firmware."""

import numpy as np

from printmend.clock.kernels.layout import (
    DEVIATION,
    EXTRUDER_CORNER_MM_S,
    JERK,
    KLIPPER,
    LEAST_SPEED_MM_S,
)
from printmend.jit import inner

_SHORT_MM = 1.0  # Marlin: a shorter move may be a chord of an arc, whose radius then counts …
_ARC_COS = np.sqrt(0.5)  # … where it turns by less than 45°
_SAFE_SHARE = 0.99  # Marlin: of a corner's speed, from which stopping is no slower


@inner(error_model="numpy", _nrt=False)
def _axes_cos(last, move, axes):
    """Return the cosine of the angle by which the path turns, over so many axes."""
    total = 0.0
    for axis in range(axes):
        total += last.unit[axis] * move.unit[axis]
    return min(max(total, -1.0), 1.0)


@inner(error_model="numpy", _nrt=False)
def _rounded2(deviation_mm, accel, cos):
    """Return the squared speed on a circle that strays from the corner by a deviation (Jeon 2011): v² = a δ s/(1 − s),
    s = sin θ/2 = √((1 + cos)/2) for a path that turns by an angle with that cosine."""
    sine = np.sqrt(max(0.5 * (1.0 + cos), 0.0))
    return np.inf if sine >= 1.0 else deviation_mm * accel * sine / (1.0 - sine)


@inner(error_model="numpy", _nrt=False)
def _is_still(move):
    """Say whether the head stands during a move."""
    return move.unit[0] == 0.0 and move.unit[1] == 0.0 and move.unit[2] == 0.0


@inner(error_model="numpy", _nrt=False)
def _klipper2(last, move):
    """Klipper: a circle at the corner, which touches no move beyond its middle; the extruder's own jump."""
    if _is_still(last) or _is_still(move):
        return 0.0
    most2 = np.inf
    jump = abs(move.unit[3] - last.unit[3])
    if jump > 0.0:
        most2 = (EXTRUDER_CORNER_MM_S / jump) ** 2
    cos = _axes_cos(last, move, 3)
    if cos >= 1.0 - 1e-15:
        return most2
    sine, cosine = np.sqrt(0.5 * (1.0 + cos)), np.sqrt(max(0.5 * (1.0 - cos), 0.0))
    # tan θ/2 = sine / cosine: the circle of the tangent length ℓ has r = ℓ tan θ/2, and v² = a r
    tangent = 0.5 * sine / cosine
    for one in (last, move):
        most2 = min(most2, _rounded2(one.deviation, one.accel, cos), one.accel * one.length * tangent)
    return most2


@inner(error_model="numpy", _nrt=False)
def safe_speed(limits, move):
    """Return the speed to which each axis may jump from rest."""
    speed = move.speed
    for axis in range(4):
        if abs(move.unit[axis]) * speed > limits.jump[axis]:
            speed = limits.jump[axis] / abs(move.unit[axis])
    return speed


@inner(error_model="numpy", _nrt=False)
def _jerk_speed(limits, last, move):
    """Marlin: no axis jumps by more than its jerk; one that turns back counts with the larger of both speeds."""
    speed = min(last.speed, move.speed)
    most = speed
    for axis in range(4):
        before, after = last.unit[axis], move.unit[axis]
        jump = abs(after - before) if before * after >= 0.0 else max(abs(before), abs(after))
        if jump * most > limits.jump[axis]:
            most = limits.jump[axis] / jump
    return move.safe if min(last.safe, move.safe) > _SAFE_SHARE * most else most


@inner(error_model="numpy", _nrt=False)
def _deviation2(limits, last, move):
    """Marlin: a circle at the corner; on short moves that hardly turn the circle of which they are chords."""
    cos = _axes_cos(last, move, 4)
    most2 = _rounded2(limits.deviation, move.accel, cos)
    if move.length < _SHORT_MM and cos > _ARC_COS:
        turn = np.arccos(cos)
        if turn > 0.0:
            most2 = min(most2, move.accel * move.length / turn)
    return most2


@inner(error_model="numpy", _nrt=False)
def _rrf_speed(limits, last, move):
    """RepRapFirmware: no drive jumps by more than its limit, between two moves that both print or both do not."""
    if (last.unit[3] > 0.0) != (move.unit[3] > 0.0) or _is_still(last) != _is_still(move):
        return 0.0
    speed = min(last.speed, move.speed)
    for axis in range(4):
        jump = abs(move.unit[axis] - last.unit[axis])
        if jump * speed > limits.jump[axis]:
            speed = limits.jump[axis] / jump
    return speed


@inner(error_model="numpy", _nrt=False)
def corner2(limits, last, move, is_first):
    """Return the largest squared speed at which ``move`` may begin after ``last``, or from rest as the first."""
    least2 = LEAST_SPEED_MM_S * LEAST_SPEED_MM_S
    if limits.corner == KLIPPER:
        return 0.0 if is_first else min(_klipper2(last, move), min(last.speed, move.speed) ** 2)
    if limits.corner == JERK:
        move.safe = safe_speed(limits, move)
        speed = move.safe if is_first else _jerk_speed(limits, last, move)
        return max(speed * speed, least2)
    if is_first:
        return least2
    most2 = min(last.speed, move.speed) ** 2
    if limits.corner == DEVIATION:
        return max(min(most2, _deviation2(limits, last, move)), least2)
    return max(_rrf_speed(limits, last, move) ** 2, least2)
