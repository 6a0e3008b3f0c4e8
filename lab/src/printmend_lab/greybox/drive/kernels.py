"""The grey box's loops. Arrays and scalars in, arrays out; checks happen where they are called.

They have many parameters because a kernel takes plain arrays: each part of a drive and each column of its rows is
one.

Every periodic quantity is a table over one turn of the motor with its first entry repeated at the end, so that linear
interpolation needs no wrap.
"""

import numpy as np

from printmend.jit import entry, inner
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


# MacKay's fixed point of the scales of a prior and of σ (physics.md eq. 19). Checks: fit.py.


# Its many parameters are the equations, the prior and the three arrays that it fills. Long because each round of the
# fixed point goes through prior, factor, solution and scales, on the same scratch arrays.
@entry(error_model="numpy")
def settle(
    matrix, slope, pull, about, square, count, usual, group, most, scales, sigma2, floor2, share, rounds,
    values, root, whitened,
):  # fmt: skip
    """Fill the arrays with the posterior after ``rounds`` updates; return (σ², misfit, log determinant).

    ``matrix`` [A, A] and ``slope`` [A] are the equations about 0; about ``about`` [A] their slope is ``pull`` [A] and
    the weighted square of the residuals ``square``, over ``count`` rows. Parameter i has the prior variance
    usual[i] · scales[group[i]]². The last of ``scales`` [G + 1] is 1 and stays, the others are learned, to at most
    ``most`` [G]. ``floor2`` is the least σ², ``share`` the share of σ² that the weights leave. ``values`` [A] become
    the parameters, ``root`` [A] the priors' standard deviations, ``whitened`` [A, A] the inverse of the triangular
    factor of the precision in units of the prior: the covariance is root · whitenedᵀ whitened · root.
    """
    size, groups = len(slope), len(scales) - 1
    factor, spread = np.empty((size, size)), np.empty(size)
    members, settled, moved = np.empty(groups), np.empty(groups), np.empty(groups)
    misfit = 0.0
    for turn in range(rounds + 1):
        for i in range(size):
            root[i] = np.sqrt(usual[i]) * scales[group[i]]
        for i in range(size):
            own = root[i] / sigma2
            for j in range(i, size):
                factor[i, j] = matrix[i, j] * (own * root[j])
            factor[i, i] += 1.0  # the matrix is at least the identity, so that its factor always exists
        cholesky(factor)
        whitened[:] = 0.0
        invert_lower(factor, whitened)
        values[:] = 0.0
        spread[:] = 0.0
        for i in range(size):
            row, along = whitened[i], 0.0
            for j in range(i + 1):
                along += row[j] * (root[j] * slope[j])
            for j in range(i + 1):
                values[j] += row[j] * along
                spread[j] += row[j] * row[j]
        for i in range(size):
            values[i] *= root[i] / sigma2
        misfit = square
        for i in range(size):
            row, bend = matrix[i], 0.0
            for j in range(size):
                bend += row[j] * (values[j] - about[j])
            misfit += (values[i] - about[i]) * (bend - 2.0 * pull[i])
        misfit = max(misfit, 0.0)
        if turn == rounds:
            break
        members[:] = 0.0
        settled[:] = 0.0
        moved[:] = 0.0
        known = 0.0
        for i in range(size):
            known += 1.0 - spread[i]
            if group[i] < groups:
                members[group[i]] += 1.0
                settled[group[i]] += 1.0 - spread[i]
                moved[group[i]] += (values[i] / root[i]) ** 2
        sigma2 = max(misfit / max(count - known, 1.0) / share, floor2)
        # τ² ← τ² Σ w²/v / γ; γ = Σ (1 − C_ii/v_i) counts what the data settle
        for g in range(groups):
            if members[g] > 0.0:
                ratio = min(max((moved[g] + 0.1) / (settled[g] + 0.1), 0.01), 100.0)
                scales[g] = min(max(scales[g] * np.sqrt(ratio), 1e-3), most[g])
    log_det = 0.0
    for i in range(size):
        log_det += 2.0 * np.log(factor[i, i])
    return sigma2, misfit, log_det


# The loop that finds the cheapest history of jumps. Arrays and scalars in, arrays out; checks in jumps.py.


@entry
def cheapest_levels(cost, price, path):
    """Choose a level for every row so that the sum of ``cost`` and ``price`` for each rung climbed is least.

    ``cost`` [N, A, B] is what row t costs at level (a, b); going from (a, b) to (c, d) costs price·(|c − a| + |d − b|),
    starting at (a, b) half of that counted from the middle level. Fills ``path`` [N, 2]; returns the whole cost.
    """
    count, across, along = cost.shape
    best = np.empty((across, along))
    for a in range(across):
        for b in range(along):
            best[a, b] = cost[0, a, b] + 0.5 * price * (abs(a - across // 2) + abs(b - along // 2))
    origin = np.empty((count, across, along), np.int32)
    for t in range(1, count):
        back = origin[t]
        for a in range(across):
            for b in range(along):
                back[a, b] = a * along + b
        # The cheapest way to every level: the distance transform of |Δa| + |Δb|, two passes a direction.
        for a in range(across):
            for b in range(1, along):
                if best[a, b - 1] + price < best[a, b]:
                    best[a, b], back[a, b] = best[a, b - 1] + price, back[a, b - 1]
            for b in range(along - 2, -1, -1):
                if best[a, b + 1] + price < best[a, b]:
                    best[a, b], back[a, b] = best[a, b + 1] + price, back[a, b + 1]
        for b in range(along):
            for a in range(1, across):
                if best[a - 1, b] + price < best[a, b]:
                    best[a, b], back[a, b] = best[a - 1, b] + price, back[a - 1, b]
            for a in range(across - 2, -1, -1):
                if best[a + 1, b] + price < best[a, b]:
                    best[a, b], back[a, b] = best[a + 1, b] + price, back[a + 1, b]
        best += cost[t]
    level, least = 0, np.inf
    for a in range(across):
        for b in range(along):
            if best[a, b] < least:
                level, least = a * along + b, best[a, b]
    for t in range(count - 1, -1, -1):
        path[t, 0], path[t, 1] = level // along, level % along
        if t > 0:
            level = origin[t, level // along, level % along]
    return least


# What a fit with the waves of one length leaves, for many lengths (least squares' periodogram). Checks: period.py.

RIDGE = 1e-9  # share of the equations' trace that is added to their diagonal


# Its many parameters are the rows of one motor, and how many waves are fitted to them.
@entry(error_model="numpy")
def lengths_left(lengths, motor, side, along, fixed, error, weight, harmonics, play_harmonics, fading, left):
    """Fill left [L] with the weighed sum of squares that a fit with the waves of each length [L] leaves.

    The N rows are at ``motor`` [N]; beside the columns ``fixed`` [N, F] are fitted cos and sin of the first
    ``harmonics`` of the length, the first ``play_harmonics`` of them times ``side`` [N], and where ``fading`` is true
    the first one times ``along`` [N]. ``error`` [N] is what is fitted, with the weights ``weight`` [N].
    """
    given = fixed.shape[1]
    waves = 2 * (harmonics + play_harmonics + (1 if fading else 0))
    size = given + waves
    gram, row, first = np.zeros((size + 1, size + 1)), np.empty(size + 1), np.zeros((given + 1, given + 1))
    for n in range(len(motor)):
        row[0] = error[n]
        for i in range(given):
            row[1 + i] = fixed[n, i]
        for i in range(given + 1):
            share, below = weight[n] * row[i], first[i]
            for j in range(i + 1):
                below[j] += share * row[j]
    for at in range(len(lengths)):
        gram[:] = 0.0
        for i in range(given + 1):
            for j in range(given + 1):
                gram[i, j] = first[i, j]
        for n in range(len(motor)):
            row[0] = error[n]
            for i in range(given):
                row[1 + i] = fixed[n, i]
            angle = motor[n] * (2.0 * np.pi / lengths[at])
            c, s = np.cos(angle), np.sin(angle)
            a, b = c, s
            k = given + 1
            for harmonic in range(harmonics):
                row[k], row[k + 1] = a, b
                k += 2
                if harmonic < play_harmonics:
                    row[k], row[k + 1] = a * side[n], b * side[n]
                    k += 2
                a, b = a * c - b * s, a * s + b * c
            if fading:
                row[k], row[k + 1] = c * along[n], s * along[n]
            for i in range(given + 1, size + 1):
                share, below = weight[n] * row[i], gram[i]
                for j in range(i + 1):
                    below[j] += share * row[j]
        left[at] = _left(gram)


@inner(_nrt=True)
def _left(gram):
    """Return what the best fit leaves: ``gram`` [1 + C, 1 + C] holds the products, in its lower triangle, first those
    of the error."""
    size = gram.shape[0] - 1
    factor, pull = np.empty((size, size)), np.empty(size)
    trace = 0.0
    for i in range(size):
        trace += gram[1 + i, 1 + i]
    for i in range(size):
        pull[i] = gram[1 + i, 0]
        for j in range(i + 1):
            factor[j, i] = gram[1 + i, 1 + j]
        factor[i, i] += RIDGE * trace
    cholesky(factor)
    left = gram[0, 0]
    for i in range(size):  # forwards through L: the fit explains the square of what comes out
        for j in range(i):
            pull[i] -= factor[i, j] * pull[j]
        pull[i] /= factor[i, i]
        left -= pull[i] * pull[i]
    return max(left, 1e-12)


# Factors and inverses of small symmetric matrices, the latter of which numpy has not for triangles. Checks: fit.py.


@entry
def lower_inverse(factor, out):
    """Fill out [N, N], zeros, with the inverse of a lower triangular matrix."""
    invert_lower(factor, out)


@inner(error_model="python", _nrt=True)
def invert_lower(factor, out):
    """Fill out [N, N], zeros, with the inverse of the lower triangle of ``factor``, row by row: L X = I, forwards."""
    for i in range(factor.shape[0]):
        row = out[i]
        row[i] = 1.0
        for k in range(i):
            share, above = factor[i, k], out[k]
            for j in range(k + 1):
                row[j] -= share * above[j]
        share = 1.0 / factor[i, i]
        for j in range(i + 1):
            row[j] *= share


@inner(error_model="python", _nrt=True)
def cholesky(matrix):
    """Turn the upper triangle of a positive definite matrix [N, N] into Lᵀ, row by row, and write L below it."""
    size = matrix.shape[0]
    for k in range(size):
        row = matrix[k]
        root = np.sqrt(row[k])
        row[k] = root
        for j in range(k + 1, size):
            row[j] /= root
            matrix[j, k] = row[j]
        for i in range(k + 1, size):
            share, below = row[i], matrix[i]
            for j in range(i, size):
                below[j] -= share * row[j]
