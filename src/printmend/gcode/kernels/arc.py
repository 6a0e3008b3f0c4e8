"""Arcs as chords."""

import numpy as np

from printmend.jit import entry


# Its many parameters are the fields of a record's arc: a caller that has no record gives them as they are.
@entry
def arc_chords(x0, y0, z0, x1, y1, z1, c0, c1, plane, clockwise, turns, tolerance, points):
    """Return how many chords an arc needs; fill ``points`` [n, 3] with their ends if it has that length.

    The sagitta r(1 − cos(φ/2)) of each chord is at most ``tolerance`` [mm]. A slightly different end radius (rounded
    coordinates) is blended in linearly, as firmwares do; the last point is the end itself.
    """
    if plane == 0:
        a0, b0, a1, b1, h0, h1 = x0, y0, x1, y1, z0, z1
    elif plane == 1:
        a0, b0, a1, b1, h0, h1 = z0, x0, z1, x1, y0, y1
    else:
        a0, b0, a1, b1, h0, h1 = y0, z0, y1, z1, x0, x1
    radius0, radius1 = np.hypot(a0 - c0, b0 - c1), np.hypot(a1 - c0, b1 - c1)
    angle0 = np.arctan2(b0 - c1, a0 - c0)
    sweep = np.arctan2(b1 - c1, a1 - c0) - angle0
    if clockwise:
        while sweep >= -1e-9:
            sweep -= 2.0 * np.pi
        sweep -= 2.0 * np.pi * turns
    else:
        while sweep <= 1e-9:
            sweep += 2.0 * np.pi
        sweep += 2.0 * np.pi * turns
    widest = max(radius0, radius1)
    step = 2.0 * np.arccos(max(1.0 - tolerance / widest, 0.0)) if widest > 0.0 else np.pi
    count = int(max(min(np.ceil(abs(sweep) / max(step, 1e-4)), 1e6), 1.0))
    if len(points) != count:
        return count
    for i in range(count):
        part = (i + 1) / count
        angle = angle0 + sweep * part
        radius = radius0 + (radius1 - radius0) * part
        a, b, h = c0 + radius * np.cos(angle), c1 + radius * np.sin(angle), h0 + (h1 - h0) * part
        if i + 1 == count:
            a, b = a1, b1
        if plane == 0:
            points[i, 0], points[i, 1], points[i, 2] = a, b, h
        elif plane == 1:
            points[i, 2], points[i, 0], points[i, 1] = a, b, h
        else:
            points[i, 1], points[i, 2], points[i, 0] = a, b, h
    return count
