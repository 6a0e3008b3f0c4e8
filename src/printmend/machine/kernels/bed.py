"""How the belts of two motors reach the bed: CoreXY mixing, then a crooked frame (physics.md eq. 13 and 14).

What is needed for it lies in 51 numbers of a flat array ``values`` from index ``at`` on, the fields BED_*, so that it
can stand by itself or inside another kernel's array. `Frame.bed_map` and `LatticeFrame.bed_map` make it. The unit is
the caller's: mm, or full steps.
"""

import numpy as np

from printmend.jit import inner

# 1 or 0: the motors are those of a CoreXY · 1 or 0: the frame is crooked · what is added to x and y, and what they are
# divided by, before the polynomials · the polynomials of x and of y [2, 10], in the order of `Frame.exponents` · how
# many waves there are · these, WAVE_* each
BED_COREXY, BED_FRAMED, BED_ORIGIN, BED_SCALE, BED_TERMS, BED_WAVES, BED_WAVE, BED_FIELDS = 0, 1, 2, 4, 6, 26, 27, 51
MOST_WAVES = 4
# 0 or 1: the wave runs along x or y · its angle a unit of the divided place · cosine and sine in x, and in y
WAVE_AXIS, WAVE_RATE, WAVE_X, WAVE_Y, WAVE_FIELDS = 0, 1, 2, 4, 6
_Y = 10  # the polynomial of y comes so many numbers after that of x
# Newton's method stops at a distance of this, far below what a float64 of a bed resolves after a few steps.
_SAME, _STEPS = 1e-10, 20


@inner(error_model="numpy", _nrt=False)
def mixed(corexy, x, y):
    """Map a place by the belts to motor coordinates: CoreXY a = x + y, b = x − y."""
    return (x + y, x - y) if corexy else (x, y)


@inner(error_model="numpy", _nrt=False)
def unmixed(corexy, a, b):
    """Invert `mixed`."""
    return ((a + b) / 2, (a - b) / 2) if corexy else (a, b)


@inner(error_model="numpy", _nrt=False)
def to_motors(values, at, x, y):
    """Map a place by the belts to motor coordinates, whatever the machine is."""
    return mixed(values[at + BED_COREXY] != 0.0, x, y)


@inner(error_model="numpy", _nrt=False)
def from_motors(values, at, a, b):
    """Invert `to_motors`."""
    return unmixed(values[at + BED_COREXY] != 0.0, a, b)


@inner(error_model="numpy", _nrt=False)
def _polynomial(values, k, p, q):
    """Return Σ a_ij p^i q^j, its coefficients from ``values[k]`` on."""
    linear = values[k] + values[k + 1] * p + values[k + 2] * q
    square = values[k + 3] * p * p + values[k + 4] * p * q + values[k + 5] * q * q
    cubic = (values[k + 6] * p + values[k + 7] * q) * p * p + (values[k + 8] * p + values[k + 9] * q) * q * q
    return linear + square + cubic


@inner(error_model="numpy", _nrt=False)
def _derivatives(values, k, p, q):
    """Return the derivatives of `_polynomial` by p and q."""
    by_p = values[k + 1] + 2 * values[k + 3] * p + values[k + 4] * q
    by_q = values[k + 2] + values[k + 4] * p + 2 * values[k + 5] * q
    by_p += 3 * values[k + 6] * p * p + 2 * values[k + 7] * p * q + values[k + 8] * q * q
    by_q += values[k + 7] * p * p + 2 * values[k + 8] * p * q + 3 * values[k + 9] * q * q
    return by_p, by_q


@inner(error_model="numpy", _nrt=False)
def _waved(values, at, p, q):
    """Return what bent rails add to x and to y."""
    x, y = 0.0, 0.0
    for wave in range(int(values[at + BED_WAVES])):
        k = at + BED_WAVE + WAVE_FIELDS * wave
        angle = values[k + WAVE_RATE] * (p if values[k + WAVE_AXIS] == 0.0 else q)
        cos, sin = np.cos(angle), np.sin(angle)
        x += values[k + WAVE_X] * cos + values[k + WAVE_X + 1] * sin
        y += values[k + WAVE_Y] * cos + values[k + WAVE_Y + 1] * sin
    return x, y


@inner(error_model="numpy", _nrt=False)
def _waved_derivatives(values, at, p, q):
    """Return the derivatives of `_waved`: of x by p and by q, of y by p and by q."""
    xp, xq, yp, yq = 0.0, 0.0, 0.0, 0.0
    for wave in range(int(values[at + BED_WAVES])):
        k = at + BED_WAVE + WAVE_FIELDS * wave
        rate = values[k + WAVE_RATE]
        along_x = values[k + WAVE_AXIS] == 0.0
        angle = rate * (p if along_x else q)
        cos, sin = rate * np.cos(angle), rate * np.sin(angle)
        x = values[k + WAVE_X + 1] * cos - values[k + WAVE_X] * sin
        y = values[k + WAVE_Y + 1] * cos - values[k + WAVE_Y] * sin
        if along_x:
            xp, yp = xp + x, yp + y
        else:
            xq, yq = xq + x, yq + y
    return xp, xq, yp, yq


@inner(error_model="numpy", _nrt=False)
def onto_bed(values, at, x, y):
    """Map a place given by the belts to the bed: the place plus the frame's polynomials and waves of it."""
    if values[at + BED_FRAMED] == 0.0:
        return x, y
    p = (x + values[at + BED_ORIGIN]) / values[at + BED_SCALE]
    q = (y + values[at + BED_ORIGIN + 1]) / values[at + BED_SCALE + 1]
    by_x, by_y = _waved(values, at, p, q)
    x += _polynomial(values, at + BED_TERMS, p, q) + by_x
    return x, y + _polynomial(values, at + BED_TERMS + _Y, p, q) + by_y


@inner(error_model="numpy", _nrt=False)
def slopes(values, at, x, y):
    """Return the derivatives of `onto_bed` at belts (x, y): of x by x and by y, of y by x and by y."""
    if values[at + BED_FRAMED] == 0.0:
        return 1.0, 0.0, 0.0, 1.0
    wide, deep = values[at + BED_SCALE], values[at + BED_SCALE + 1]
    p, q = (x + values[at + BED_ORIGIN]) / wide, (y + values[at + BED_ORIGIN + 1]) / deep
    xp, xq = _derivatives(values, at + BED_TERMS, p, q)
    yp, yq = _derivatives(values, at + BED_TERMS + _Y, p, q)
    wxp, wxq, wyp, wyq = _waved_derivatives(values, at, p, q)
    return 1.0 + (xp + wxp) / wide, (xq + wxq) / deep, (yp + wyp) / wide, 1.0 + (yq + wyq) / deep


@inner(error_model="numpy", _nrt=False)
def off_bed(values, at, x, y):
    """Return the place by the belts whose image on the bed is (x, y): Newton's method on `onto_bed`."""
    if values[at + BED_FRAMED] == 0.0:
        return x, y
    u, v = x, y
    for _ in range(_STEPS):
        at_x, at_y = onto_bed(values, at, u, v)
        ex, ey = x - at_x, y - at_y
        if abs(ex) + abs(ey) < _SAME:
            break
        xx, xy, yx, yy = slopes(values, at, u, v)
        area = xx * yy - xy * yx
        u += (yy * ex - xy * ey) / area
        v += (xx * ey - yx * ex) / area
    return u, v


@inner(error_model="numpy", _nrt=False)
def printed(values, at, a, b):
    """Return the place on the bed for belts of the two motors at a and b."""
    x, y = from_motors(values, at, a, b)
    return onto_bed(values, at, x, y)


@inner(error_model="numpy", _nrt=False)
def wanted(values, at, x, y):
    """Return where the belts of the two motors have to be for the place (x, y) on the bed."""
    u, v = off_bed(values, at, x, y)
    return to_motors(values, at, u, v)


@inner(error_model="numpy", _nrt=False)
def anchor(values, at, x, y):
    """Move the frame's constant terms so that it leaves the place (x, y), where a layer starts, where it is."""
    if values[at + BED_FRAMED] != 0.0:
        bed_x, bed_y = onto_bed(values, at, x, y)
        values[at + BED_TERMS] += x - bed_x
        values[at + BED_TERMS + _Y] += y - bed_y
