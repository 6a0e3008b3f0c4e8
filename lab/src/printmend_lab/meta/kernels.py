"""Loops over a trace's rows: contacts and columns. Arrays and scalars in, arrays out; checks in meta.py."""

import numpy as np

from printmend.jit import entry, inner
from printmend.machine.kernels.play import FREE, contact
from printmend.machine.kernels.table import branch_at

FAR = 9.0  # spacings from its middle at which a bump is 3e-18


@entry
def touches(motor, first, rate, lower, upper, start, at, side):
    """Follow ``motor`` [N] from a belt at ``start``; fill ``at`` [N], the row of the last contact (−1 before the
    first), and ``side`` [N], its branch (0 before the first). The tables begin at ``first``, 1/``rate`` apart."""
    last = float(len(lower) - 1)
    belt, row, branch = start, -1, FREE
    for i in range(len(motor)):
        low = branch_at(lower, 0, first, rate, last, motor[i])
        high = branch_at(upper, 0, first, rate, last, motor[i])
        belt, moved = contact(belt, low, high)
        if moved != FREE:
            row, branch = i, moved
        at[i], side[i] = np.int64(row), np.int8(branch)


@entry
def fill_columns(at, side, other, rate, scale, harmonics, playing, elastic, bells, out):
    """Fill ``out`` [N, C], the columns of rows at ``at``, ``side`` and ``other`` [N].

    ``rate`` is 2π a turn, ``scale`` the length of 1; ``harmonics`` and ``playing`` count the waves of the place and of
    the play, ``elastic`` [E] those that change along the bed. ``bells`` [2, 3] says of the narrow and the wide bumps
    where the first one is, how far apart they are, and how many.
    """
    for i in range(len(at)):
        row, x, q, half = out[i], at[i] / scale, other[i] / scale, side[i] / 2
        row[0], row[1], end = 1.0, x, 2
        turned = complex(np.cos(rate * at[i]), np.sin(rate * at[i]))
        power = complex(1.0, 0.0)
        for _ in range(harmonics):
            power = power * turned
            row[end], row[end + 1], end = power.real, power.imag, end + 2
        for kind in range(2):
            end = _bells(at[i], bells[kind], row, end)
        wide = end - int(bells[1, 2])
        for k in elastic:
            row[end], row[end + 1], end = x * row[2 * k], x * row[2 * k + 1], end + 2
        row[end], row[end + 1], row[end + 2], row[end + 3], row[end + 4] = q, q * q, q * x, x * x, q * q * q
        row[end + 5], end = half, end + 6
        for k in range(2, 2 + 2 * playing):
            row[end], end = half * row[k], end + 1
        for k in range(wide, wide + int(bells[1, 2])):
            row[end], end = half * row[k], end + 1
        row[end], row[end + 1] = half * x, half * x * x


@inner(error_model="python", _nrt=True)
def _bells(at, bell, row, end):
    """Fill bells about places that are as far apart as the bells are wide; return the next free column."""
    first, apart, count = bell[0], bell[1], int(bell[2])
    for k in range(count):
        away = (at - first) / apart - k
        row[end + k] = np.exp(-0.5 * away * away) if abs(away) < FAR else 0.0
    return end + count
