"""How the belts of two motors reach the bed: CoreXY mixing, then a crooked frame (physics.md eq. 13 and 14).

A record of BED, made by `Frame.bed_map` or `lattice_bed`, holds all parameters. The unit is the caller's: mm, or full
steps.
"""

import numpy as np

from printmend.jit import inner

MOST_WAVES = 192  # of one frame
WAVE = np.dtype(
    [
        ("rate", "f8", 2),  # its angle per unit of the scaled place along x and along y [rad]
        ("x", "f8", 2),  # what its cosine and its sine add to x
        ("y", "f8", 2),  # and to y
    ]
)
WAVE_FIELDS = 6  # numbers of a wave as a row of an array
BED = np.dtype(
    [
        ("corexy", "f8"),  # 1 or 0: the motors are those of a CoreXY
        ("framed", "f8"),  # 1 or 0: the frame is crooked
        ("origin", "f8", 2),  # what is added to x and y before the polynomials and the waves,
        ("scale", "f8", 2),  # and what they are divided by
        ("terms", "f8", (2, 10)),  # the polynomials of x and of y, in the order of `Frame.exponents`
        ("wave_count", "i8"),
        ("waves", WAVE, MOST_WAVES),
    ],
    align=True,
)
# Newton's method stops once x and y together are off by less than this, in the caller's unit, or after so many steps.
# Each step doubles the digits, so that a few do on any frame near to square.
_REACHED, _STEPS = 1e-10, 20


@inner
def mixed(corexy, x, y):
    """Map a place by the belts to motor coordinates: CoreXY a = x + y, b = x − y."""
    return (x + y, x - y) if corexy else (x, y)


@inner
def unmixed(corexy, a, b):
    """Invert `mixed`."""
    return ((a + b) / 2, (a - b) / 2) if corexy else (a, b)


@inner
def to_motors(way, x, y):
    """Map a place by the belts to motor coordinates, whatever the machine is."""
    return mixed(way.corexy != 0.0, x, y)


@inner
def from_motors(way, a, b):
    """Invert `to_motors`."""
    return unmixed(way.corexy != 0.0, a, b)


@inner
def _polynomial(a, p, q):
    """Return Σ a_ij p^i q^j for coefficients a [10]."""
    linear = a[0] + a[1] * p + a[2] * q
    square = a[3] * p * p + a[4] * p * q + a[5] * q * q
    cubic = (a[6] * p + a[7] * q) * p * p + (a[8] * p + a[9] * q) * q * q
    return linear + square + cubic


@inner
def _derivatives(a, p, q):
    """Return the derivatives of `_polynomial` by p and q."""
    by_p = a[1] + 2 * a[3] * p + a[4] * q
    by_q = a[2] + a[4] * p + 2 * a[5] * q
    by_p += 3 * a[6] * p * p + 2 * a[7] * p * q + a[8] * q * q
    by_q += a[7] * p * p + 2 * a[8] * p * q + 3 * a[9] * q * q
    return by_p, by_q


@inner
def _waved(way, p, q):
    """Return what bent rails add to x and to y."""
    x, y = 0.0, 0.0
    for k in range(way.wave_count):
        wave = way.waves[k]
        angle = wave.rate[0] * p + wave.rate[1] * q
        cos, sin = np.cos(angle), np.sin(angle)
        x += wave.x[0] * cos + wave.x[1] * sin
        y += wave.y[0] * cos + wave.y[1] * sin
    return x, y


@inner
def _waved_derivatives(way, p, q):
    """Return the derivatives of `_waved`: of x by p and by q, of y by p and by q."""
    xp, xq, yp, yq = 0.0, 0.0, 0.0, 0.0
    for k in range(way.wave_count):
        wave = way.waves[k]
        angle = wave.rate[0] * p + wave.rate[1] * q
        cos, sin = np.cos(angle), np.sin(angle)
        x = wave.x[1] * cos - wave.x[0] * sin
        y = wave.y[1] * cos - wave.y[0] * sin
        xp, yp = xp + wave.rate[0] * x, yp + wave.rate[0] * y
        xq, yq = xq + wave.rate[1] * x, yq + wave.rate[1] * y
    return xp, xq, yp, yq


@inner
def onto_bed(way, x, y):
    """Map a place given by the belts to the bed: the place plus the frame's polynomials and waves of it."""
    if way.framed == 0.0:
        return x, y
    p, q = (x + way.origin[0]) / way.scale[0], (y + way.origin[1]) / way.scale[1]
    by_x, by_y = _waved(way, p, q)
    x += _polynomial(way.terms[0], p, q) + by_x
    return x, y + _polynomial(way.terms[1], p, q) + by_y


@inner
def slopes(way, x, y):
    """Return the derivatives of `onto_bed` at belts (x, y): of x by x and by y, of y by x and by y."""
    if way.framed == 0.0:
        return 1.0, 0.0, 0.0, 1.0
    wide, deep = way.scale[0], way.scale[1]
    p, q = (x + way.origin[0]) / wide, (y + way.origin[1]) / deep
    xp, xq = _derivatives(way.terms[0], p, q)
    yp, yq = _derivatives(way.terms[1], p, q)
    wxp, wxq, wyp, wyq = _waved_derivatives(way, p, q)
    return 1.0 + (xp + wxp) / wide, (xq + wxq) / deep, (yp + wyp) / wide, 1.0 + (yq + wyq) / deep


@inner
def off_bed(way, x, y):
    """Return the place by the belts whose image on the bed is (x, y): Newton's method on `onto_bed`."""
    if way.framed == 0.0:
        return x, y
    u, v = x, y
    for _ in range(_STEPS):
        at_x, at_y = onto_bed(way, u, v)
        ex, ey = x - at_x, y - at_y
        if abs(ex) + abs(ey) < _REACHED:
            break
        xx, xy, yx, yy = slopes(way, u, v)
        area = xx * yy - xy * yx
        u += (yy * ex - xy * ey) / area
        v += (xx * ey - yx * ex) / area
    return u, v


@inner
def printed(way, a, b):
    """Return the place on the bed for belts of the two motors at a and b."""
    x, y = from_motors(way, a, b)
    return onto_bed(way, x, y)


@inner
def wanted(way, x, y):
    """Return where the belts of the two motors have to be for the place (x, y) on the bed."""
    u, v = off_bed(way, x, y)
    return to_motors(way, u, v)


@inner
def anchor(way, x, y):
    """Shift the frame's constant terms so that the place (x, y), where a layer starts, stays where it is."""
    if way.framed != 0.0:
        bed_x, bed_y = onto_bed(way, x, y)
        way.terms[0, 0] += x - bed_x
        way.terms[1, 0] += y - bed_y
