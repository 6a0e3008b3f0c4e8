"""The simulator of the paper's published code. Arrays and scalars in, arrays out; checks happen in twin.py."""

import numpy as np

from printmend.jit import entry, inner


@inner
def _displacement(nominal, control, gains):
    """Return the published displacement of ``control`` from ``nominal`` (physics.md §8.1)."""
    size = gains.shape[0]
    x = float(nominal)
    sign = 1 if control > 0 else -1
    for _ in range(abs(control)):
        index = int(np.rint(x)) - 1  # rint rounds half to even; −1 is the last column, as in the published code
        if index < 0:
            index += size
        index = min(index, size - 1)  # a bed longer than the table: its last gain goes on
        x = min(max(x + sign * gains[index], 0.0), size - 1.0)
    return x - nominal


@entry
def displace(nominal, controls, gains, out):
    """Fill out [K] with the published displacements of controls [K], each from its nominal position [K]."""
    for k in range(controls.shape[0]):
        out[k] = _displacement(nominal[k], controls[k], gains)


@entry
def run_gain(controls, axis, nominal, gains, bed, out):
    """Follow the controls [T, 2] of one axis by the published rules; fill out[:, axis] [T + 1]."""
    printed = float(nominal)
    out[0, axis] = printed
    for t in range(controls.shape[0]):
        c = controls[t, axis]
        printed = min(max(printed + _displacement(nominal, c, gains), 0.0), float(bed))
        nominal = min(max(nominal + c, 0), bed)
        out[t + 1, axis] = printed


@entry
def tabulate_gain(gains, table):
    """Fill table [bed + 1, 2·c_max + 1] with the published displacement of every control at every nominal position."""
    c_max = table.shape[1] // 2
    for nominal in range(table.shape[0]):
        for control in range(-c_max, c_max + 1):
            table[nominal, control + c_max] = _displacement(nominal, control, gains)
