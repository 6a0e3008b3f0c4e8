"""The hybrid's loop. Arrays and scalars in, arrays out; checks happen in residual.py."""

from printmend.jit import entry


@entry
def follow_branches(lower_mm, upper_mm, start_mm, at, side, belt_mm):
    """Follow play between ``lower_mm`` and ``upper_mm`` [N], the branches at every row's motor position.

    Fills per row the row of the last contact (−1 before the first), its side (−1 lower, +1 upper, 0 none yet) and the
    belt's place.
    """
    value, row, branch = start_mm, -1, 0
    for t in range(lower_mm.shape[0]):
        if value < lower_mm[t]:
            value, row, branch = lower_mm[t], t, -1
        if value > upper_mm[t]:
            value, row, branch = upper_mm[t], t, 1
        at[t] = row
        side[t] = branch
        belt_mm[t] = value
