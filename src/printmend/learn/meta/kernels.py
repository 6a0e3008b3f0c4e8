"""The loop that follows a motor through its play. Arrays and scalars in, arrays out; checks in meta.py."""

import numpy as np

from printmend.jit import entry
from printmend.machine.kernels.play import FREE, contact
from printmend.machine.kernels.table import branch_at


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
