"""The grey box's loops. Arrays and scalars in, arrays out; checks happen in greybox.py.

Every periodic quantity is a table over one turn of the motor with its first entry repeated at the end, so that
linear interpolation needs no wrap.
"""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def follow_play(
    motor_mm, origin_mm, period_mm, tables, mean_powers, play_powers, warp, warp_span, start_mm, at, side, belt_mm
):
    """Follow motor positions [N] through generalised play; say at every row which contact gave the belt its place.

    ``tables`` [3, B + 1] are the periodic parts of mean, play and elastic; the powers are of x = (motor − origin)/100;
    ``warp`` [W] is the part of the mean that repeats nothing, at even places of ``warp_span`` [2] (none where W < 2).
    The belt starts at ``start_mm``. Fills, for each row, ``at`` (the row of the last contact, −1 where the belt still
    is where it started), ``side`` (−1: the lower branch, +1: the upper one, 0: none yet) and ``belt_mm``.
    """
    size = tables.shape[1] - 1
    per_mm = size / period_mm
    knots = warp.shape[0] - 1
    value = start_mm
    row, branch = -1, 0
    for t in range(motor_mm.shape[0]):
        x = (motor_mm[t] - origin_mm) / 100.0
        place = motor_mm[t] * per_mm
        place -= np.floor(place / size) * size
        cell = min(int(place), size - 1)
        share = place - cell
        mean = 0.0
        for p in range(mean_powers.shape[0] - 1, -1, -1):
            mean = mean * x + mean_powers[p]
        play = 0.0
        for p in range(play_powers.shape[0] - 1, -1, -1):
            play = play * x + play_powers[p]
        mean += tables[0, cell] + share * (tables[0, cell + 1] - tables[0, cell])
        play += tables[1, cell] + share * (tables[1, cell + 1] - tables[1, cell])
        mean += x * (tables[2, cell] + share * (tables[2, cell + 1] - tables[2, cell]))
        if knots > 0:
            place = (motor_mm[t] - warp_span[0]) * (knots / (warp_span[1] - warp_span[0]))
            place = min(max(place, 0.0), float(knots))
            cell = min(int(place), knots - 1)
            mean += warp[cell] + (place - cell) * (warp[cell + 1] - warp[cell])
        play = max(play, 0.0)
        lower = motor_mm[t] + mean - play / 2
        upper = motor_mm[t] + mean + play / 2
        if value < lower:
            value, row, branch = lower, t, -1
        if value > upper:
            value, row, branch = upper, t, 1
        at[t] = row
        side[t] = branch
        belt_mm[t] = value


@njit(cache=True, nogil=True)
def bin_moments(phase, x, side, weight, extras, bins, cross, gram):
    """Add rows [M] to the weighted moments from which every product of columns follows.

    ``phase`` [M] in table cells, ``x`` [M], ``side`` [M] ±1, ``extras`` [M, E] (the residual last). A row is shared
    linearly between the two nearest cells. ``bins`` [2, 3, B]: Σ w xᵖ, by side and power; ``cross`` [2, 2, E, B]: Σ w
    xᵖ extra; ``gram`` [E, E]: Σ w extra extraᵀ (lower triangle).
    """
    size = bins.shape[2]
    count = extras.shape[1]
    for t in range(phase.shape[0]):
        cell = int(phase[t])
        share = phase[t] - cell
        cell = cell % size
        after = (cell + 1) % size
        w, xt = weight[t], x[t]
        s = 1 if side[t] > 0 else 0
        left, right = w * (1 - share), w * share
        bins[s, 0, cell] += left
        bins[s, 0, after] += right
        bins[s, 1, cell] += left * xt
        bins[s, 1, after] += right * xt
        bins[s, 2, cell] += left * xt * xt
        bins[s, 2, after] += right * xt * xt
        for e in range(count):
            value = extras[t, e]
            cross[s, 0, e, cell] += left * value
            cross[s, 0, e, after] += right * value
            cross[s, 1, e, cell] += left * value * xt
            cross[s, 1, e, after] += right * value * xt
            for f in range(e + 1):
                gram[e, f] += w * value * extras[t, f]


@njit(cache=True, nogil=True)
def turning_rows(motor_mm, wanted, keep):
    """Mark in ``keep`` the wanted rows, the first and last, and every row at which the motor turns back."""
    last = motor_mm.shape[0] - 1
    direction = 0.0
    before = 0
    for t in range(last + 1):
        keep[t] = wanted[t] or t == 0 or t == last
        if t > 0 and motor_mm[t] != motor_mm[t - 1]:
            now = 1.0 if motor_mm[t] > motor_mm[t - 1] else -1.0
            if now != direction:
                keep[before] = True
            direction = now
            before = t
