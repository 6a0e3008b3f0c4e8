"""The twin's loops. Arrays and scalars in, arrays out; checks happen in twin.py."""

import numpy as np

from printmend.jit import entry


@entry
def run_play(motor, position, lower, upper, out):
    """Follow motor indices [T] through position ← clip(position, lower[m], upper[m]); write positions to out [T]."""
    for t in range(motor.shape[0]):
        m = motor[t]
        position = min(max(position, lower[m]), upper[m])
        out[t] = position


@entry
def run_play_controls(controls, axis, motor, position, lower, upper, out):
    """Follow the controls [T, 2] of one axis from motor index ``motor``; fill out[:, axis] [T + 1].

    The tables are monotone, so only the end of each control matters. Returns False when the motor leaves them.
    """
    out[0, axis] = position
    last = lower.shape[0] - 1
    for t in range(controls.shape[0]):
        motor += controls[t, axis]
        if motor < 0 or motor > last:
            return False
        position = min(max(position, lower[motor]), upper[motor])
        out[t + 1, axis] = position
    return True


@entry
def gain_displacement(nominal, control, gains):
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
def run_gain(controls, axis, nominal, gains, bed, out):
    """Follow the controls [T, 2] of one axis by the published rules; fill out[:, axis] [T + 1]."""
    printed = float(nominal)
    out[0, axis] = printed
    for t in range(controls.shape[0]):
        c = controls[t, axis]
        printed = min(max(printed + gain_displacement(nominal, c, gains), 0.0), float(bed))
        nominal = min(max(nominal + c, 0), bed)
        out[t + 1, axis] = printed


@entry
def tabulate_gain(gains, table):
    """Fill table [bed + 1, 2·c_max + 1] with the published displacement of every control at every nominal position."""
    c_max = table.shape[1] // 2
    for nominal in range(table.shape[0]):
        for control in range(-c_max, c_max + 1):
            table[nominal, control + c_max] = gain_displacement(nominal, control, gains)


@entry
def bend(belts, low_mm, pitch_mm, coefficients, scale_mm, out):
    """Map belt positions [N, 2] full steps through a frame (mechanism.Frame), coefficients [2, 10] mm, to out."""
    for n in range(belts.shape[0]):
        u = (low_mm[0] + belts[n, 0] * pitch_mm[0]) / scale_mm
        v = (low_mm[1] + belts[n, 1] * pitch_mm[1]) / scale_mm
        u2, uv, v2 = u * u, u * v, v * v
        for axis in range(2):
            c = coefficients[axis]
            off = c[0] + c[1] * u + c[2] * v + c[3] * u2 + c[4] * uv + c[5] * v2
            off += c[6] * u2 * u + c[7] * u2 * v + c[8] * u * v2 + c[9] * v2 * v
            out[n, axis] = belts[n, axis] + off / pitch_mm[axis]
