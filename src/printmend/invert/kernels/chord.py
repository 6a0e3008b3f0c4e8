"""Compiled search for the longest straight command whose printed path stays close enough to the wanted one."""

import numpy as np

from printmend.invert.kernels.curve import (
    aside_and_along,
    is_flat_arc,
    norm,
    place,
)
from printmend.invert.kernels.layout import (
    ALONG_PER_ASIDE,
    FILAMENT_AREA_MM2,
    MAX_AREA_MM2,
    TINY_ADVANCE_MM,
)
from printmend.invert.kernels.lookup import (
    from_motors,
    is_framed,
    printed,
    sharpest,
    wanted,
)
from printmend.invert.kernels.state import followed, middle, motor_along
from printmend.jit import inner

SHORT_MM = 0.4  # chords below this may bulge twice as far; on a radius of 4 mm all are shorter
_FAR_MM = 12.0  # for how much of a motor's way the curvature of its tables is looked up


@inner(error_model="numpy", _nrt=False)
def _bulge(model, length):
    """Return how far a chord of that length may bulge; short ones may twice as far, or the firmware would go slowly."""
    return model.head.chord * (2.0 if length < SHORT_MM else 1.0)


@inner(error_model="numpy", _nrt=False)
def along_curve(model, curve, state, mode0, mode1, t):
    """Return the motor positions at t of the curve, on its way from where the motors are."""
    x, y, _ = place(curve, t)
    u0, u1 = wanted(model, x, y)
    return motor_along(model, state, 0, mode0, u0, t), motor_along(model, state, 1, mode1, u1, t)


@inner(error_model="numpy", _nrt=False)
def _score(model, curve, state, mode0, mode1, t, end, m0, m1, start_error):
    """Return the largest error of the chord from t to ``end``, where the motors are at (m0, m1), by what is allowed."""
    samples = max(3, np.int64(np.ceil(min((end - t) * curve.length, 4096.0) / model.head.sample)))
    from0, from1 = state.mended.m[0], state.mended.m[1]
    now0, now1 = middle(state, 0), middle(state, 1)
    held = (1 if mode0 == 0 else 0) + (1 if mode1 == 0 else 0)
    aside_most = _bulge(model, (end - t) * curve.length) + held * model.head.chord  # one that stands is off by as much
    worst = 0.0
    for i in range(1, samples + 1):
        s = i / (samples + 1)
        a = followed(model, 0, mode0, now0, from0 + s * (m0 - from0))
        b = followed(model, 1, mode1, now1, from1 + s * (m1 - from1))
        x, y = printed(model, a, b)
        aside, along = aside_and_along(curve, x, y, t + s * (end - t))
        spare = (1.0 - s) * start_error
        worst = max(worst, aside / (aside_most + spare), along / (ALONG_PER_ASIDE * model.head.chord + spare))
    return worst


@inner(error_model="numpy", _nrt=False)
def _longest(model, curve, state, mode0, mode1, t, whole, bound, shortest):
    """Return the length, in t, of the longest admissible chord, by growing and shrinking a guess from the curvature."""
    x, y = printed(model, middle(state, 0), middle(state, 1))
    aside, along = aside_and_along(curve, x, y, t)
    step = whole
    if bound > 0.0:
        step = min(whole, max(shortest, 2.0 * whole * np.sqrt(8.0 * model.head.chord / bound)))
    good = 0.0
    for _ in range(24):
        m0, m1 = along_curve(model, curve, state, mode0, mode1, t + step)
        score = _score(model, curve, state, mode0, mode1, t, t + step, m0, m1, aside + along)
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


@inner(error_model="numpy", _nrt=False)
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
    bound = norm(bend0 * d0 * d0, bend1 * d1 * d1)  # 8 times the sagitta, at the most
    if is_flat_arc(curve):
        bound += whole * whole * abs(curve.sweep) * length
    elif is_framed(model):
        bound += model.head.frame_bend * whole * whole * length * length
    step = whole
    if bound > 8.0 * _bulge(model, whole * length) or ((d0 > _FAR_MM or d1 > _FAR_MM) and model.head.bent != 0.0):
        step = _longest(model, curve, state, mode0, mode1, t, whole, bound, shortest)
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
