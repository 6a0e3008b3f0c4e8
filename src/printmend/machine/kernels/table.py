"""Look-ups in the tables of a transmission and of a screw.

All tables lie in one flat array ``values``; one begins at index ``table``. Its entry i stands for motor position
``first`` + i / ``rate``; ``last`` is the index of its last entry, as a float.
"""

import numpy as np

from printmend.jit import inner


@inner
def branch_at(values, table, first, rate, last, m):
    """Return a branch of a transmission at motor position m; beyond the table it continues with slope 1."""
    place = (m - first) * rate
    if not place > 0.0:
        return values[table] + (m - first)
    if place >= last:
        return values[table + np.int64(last)] + (place - last) / rate
    i = np.int64(place)
    below = values[table + i]
    return below + (place - i) * (values[table + i + 1] - below)


@inner
def push_at(values, table, first, rate, last, m):
    """Return where a screw pushes the nozzle along one axis at motor position m; beyond the table that is constant."""
    place = (m - first) * rate
    if not place > 0.0:
        return values[table]
    if place >= last:
        return values[table + np.int64(last)]
    i = np.int64(place)
    below = values[table + i]
    return below + (place - i) * (values[table + i + 1] - below)
