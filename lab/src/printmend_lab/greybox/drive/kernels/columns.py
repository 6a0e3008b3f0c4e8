"""The grey box's loops. Arrays and scalars in, arrays out; checks happen in greybox.py.

They have many parameters because a kernel takes plain arrays: each part of a drive and each column of its rows is one.

Every periodic quantity is a table over one turn of the motor with its first entry repeated at the end, so that
linear interpolation needs no wrap.
"""

import numpy as np

from printmend.jit import entry
from printmend.machine.kernels.play import FREE, contact


# The entries have many parameters: the arrays of a `Rows`, a `Design` and its values, which Python classes hold.
@entry
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
        value, touched = contact(value, lower, upper)
        if touched != FREE:
            row, branch = t, touched
        at[t] = row
        side[t] = branch
        belt_mm[t] = value


@entry
def plain_columns(
    row, at, side, root, motor_mm, own_mm, other_mm, residual_mm,
    origin_mm, period_mm, mean_powers, play_powers, own_powers, other_powers, warp, warp_span, ripple, columns,
):  # fmt: skip
    """Fill ``columns`` [M, E] with what is no harmonic of the rows ``row`` [M], times the roots [N] of their weights.

    ``at``, ``side`` and the residuals [N] are as `follow_play` leaves them. Order: the start (0 once there was a
    contact), powers of mean and play, products of ``own_powers`` [C] and ``other_powers`` [C], ``warp`` cosines over
    ``warp_span`` [2], cosines and sines of the harmonics ``ripple`` [R], the residual.
    """
    length = warp_span[1] - warp_span[0]
    for t in range(row.shape[0]):
        i = row[t]
        motor = motor_mm[at[i]]
        x = (motor - origin_mm) / 100.0
        columns[t, 0] = 0.0
        e = 1
        value = root[i]
        for _ in range(mean_powers):
            columns[t, e] = value
            value *= x
            e += 1
        value = root[i] * side[i] / 2
        for _ in range(play_powers):
            columns[t, e] = value
            value *= x
            e += 1
        own, other = own_mm[i] / 100.0, other_mm[i] / 100.0
        for c in range(own_powers.shape[0]):
            value = root[i]
            for _ in range(own_powers[c]):
                value *= own
            for _ in range(other_powers[c]):
                value *= other
            columns[t, e] = value
            e += 1
        if warp > 0:
            # cos (k + 1)θ = 2 cos θ cos kθ − cos (k − 1)θ
            twice = 2 * np.cos(np.pi * min(max((motor - warp_span[0]) / length, 0.0), 1.0))
            before, value = root[i], root[i] * twice / 2
            for _ in range(warp):
                columns[t, e] = value
                before, value = value, twice * value - before
                e += 1
        phase = 2 * np.pi * (motor / period_mm - np.floor(motor / period_mm))
        cosine, sine = 1.0, 0.0
        for k in range(ripple.shape[0]):
            if k > 0 and ripple[k] == 2 * ripple[k - 1]:
                cosine, sine = cosine * cosine - sine * sine, 2 * sine * cosine
            else:
                cosine, sine = np.cos(ripple[k] * phase), np.sin(ripple[k] * phase)
            columns[t, e + k] = root[i] * cosine
            columns[t, e + ripple.shape[0] + k] = root[i] * sine
        columns[t, columns.shape[1] - 1] = root[i] * residual_mm[i]


@entry
def bin_moments(row, at, side, root, motor_mm, origin_mm, period_mm, extras, bins, cross):
    """Add the rows ``row`` [M] to the weighted moments from which every product with a harmonic follows.

    ``extras`` [M, E] are times the ``root`` [N] of the weights w. A row is shared linearly between the two nearest of
    the B cells of a turn. ``bins`` [2, P, B]: Σ w xᵖ, by side and power; ``cross`` [2, Q, B, E]: Σ w xᵖ extra.
    """
    size = bins.shape[2]
    for t in range(row.shape[0]):
        i = row[t]
        motor = motor_mm[at[i]]
        phase = motor / period_mm
        phase = (phase - np.floor(phase)) * size
        cell = int(phase)
        share = phase - cell
        cell = cell % size
        after = (cell + 1) % size
        s = 1 if side[i] > 0 else 0
        x = (motor - origin_mm) / 100.0
        value = root[i] ** 2
        for p in range(bins.shape[1]):
            bins[s, p, cell] += (1 - share) * value
            bins[s, p, after] += share * value
            value *= x
        value = root[i]
        for p in range(cross.shape[1]):
            for e in range(extras.shape[1]):
                cross[s, p, cell, e] += (1 - share) * value * extras[t, e]
                cross[s, p, after, e] += share * value * extras[t, e]
            value *= x


@entry
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


@entry
def put_products(both, mine, theirs, mine_cos, mine_sin, theirs_cos, theirs_sin, full):
    """Write the sums of products of two groups of harmonics, and their mirror images, into ``full`` [P, P].

    ``both`` are the moments T_j = Σ w e^{ijφ} of their columns: cos kφ cos lφ = (cos (k − l)φ + cos (k + l)φ)/2, and so
    on. ``mine`` and ``theirs`` are the harmonics; the cosines of the one group begin at ``mine_cos``, and so on.
    """
    for a in range(len(mine)):
        for b in range(len(theirs)):
            up, away = both[mine[a] + theirs[b]], mine[a] - theirs[b]
            down = both[away] if away >= 0 else np.conj(both[-away])
            one, other = mine_cos + a, theirs_cos + b
            full[one, other] = full[other, one] = (down.real + up.real) / 2
            one, other = mine_sin + a, theirs_sin + b
            full[one, other] = full[other, one] = (down.real - up.real) / 2
            one, other = mine_cos + a, theirs_sin + b
            full[one, other] = full[other, one] = (up.imag - down.imag) / 2
            one, other = mine_sin + a, theirs_cos + b
            full[one, other] = full[other, one] = (up.imag + down.imag) / 2
