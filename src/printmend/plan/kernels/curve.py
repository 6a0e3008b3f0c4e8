"""Compiled geometry of one commanded move: a straight line or an arc in any plane, by a parameter t in 0…1."""

import numpy as np

from printmend.gcode.kernels.layout import KIND_CCW, KIND_CW
from printmend.jit import inner
from printmend.plan.kernels.layout import CHORDS_A_RECORD, MIN_PIECE_MM
from printmend.plan.kernels.lookup import is_near

# One commanded move.
CURVE = np.dtype(
    [
        ("arc", "f8"),  # 1 or 0: it is an arc
        *((name, "f8") for name in ("x0", "y0", "z0", "x1", "y1", "z1")),  # where it begins and ends [mm]
        ("ca", "f8"),  # an arc's centre in its plane [mm]
        ("cb", "f8"),
        ("phi", "f8"),  # the angle at which it begins [rad]
        ("sweep", "f8"),  # how far the angle grows on the way to its end [rad]
        ("r0", "f8"),  # the radius at its beginning and at its end [mm]
        ("r1", "f8"),
        ("plane", "f8"),  # 0 XY, 1 ZX, 2 YZ
        ("length", "f8"),  # [mm]
        ("share", "f8"),  # the share of its statement's E
        ("least", "f8"),  # the shortest piece that it may be cut into [mm]
    ],
    align=True,
)
_TURN = 2.0 * np.pi
HIGHEST_MM = 1e4  # no printer is higher: a line of such a length would be cut and looked at for hours
_LOOKS = 24  # places of an arc at which it is asked whether it leaves the bed


@inner
def norm(x, y):
    """Return √(x² + y²) without `hypot`'s care for huge numbers, and so faster."""
    return np.sqrt(x * x + y * y)


@inner
def set_line(curve, x0, y0, z0, x1, y1, z1):
    """Fill a curve with a straight line."""
    curve.arc = 0.0
    curve.x0, curve.y0, curve.z0, curve.x1, curve.y1, curve.z1 = x0, y0, z0, x1, y1, z1
    curve.length = np.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2 + (z1 - z0) ** 2)
    curve.share, curve.least = 1.0, max(MIN_PIECE_MM, curve.length / CHORDS_A_RECORD)


@inner
def copy_curve(curve, to):
    """Make ``to`` the same curve."""
    to.arc, to.plane, to.ca, to.cb, to.phi, to.sweep = (
        curve.arc,
        curve.plane,
        curve.ca,
        curve.cb,
        curve.phi,
        curve.sweep,
    )
    to.x0, to.y0, to.z0, to.x1, to.y1, to.z1 = curve.x0, curve.y0, curve.z0, curve.x1, curve.y1, curve.z1
    to.r0, to.r1, to.length, to.share, to.least = curve.r0, curve.r1, curve.length, curve.share, curve.least


# Its many parameters are the numbers of one arc, each of which becomes a field of the curve.
@inner
def set_arc(curve, x0, y0, z0, x1, y1, z1, ca, cb, plane, clockwise, turns):
    """Fill a curve with an arc about (ca, cb) in its plane: 0 XY, 1 ZX, 2 YZ. Ends that coincide make a full circle."""
    set_line(curve, x0, y0, z0, x1, y1, z1)
    a0, b0, a1, b1, rise = x0, y0, x1, y1, z1 - z0
    if plane == 1:
        a0, b0, a1, b1, rise = z0, x0, z1, x1, y1 - y0
    elif plane == 2:
        a0, b0, a1, b1, rise = y0, z0, y1, z1, x1 - x0
    phi0, phi1 = np.arctan2(b0 - cb, a0 - ca), np.arctan2(b1 - cb, a1 - ca)
    sweep = (phi0 - phi1) % _TURN if clockwise else (phi1 - phi0) % _TURN
    if sweep < 1e-9 or abs(sweep - _TURN) < 1e-9 or (abs(a1 - a0) < 1e-7 and abs(b1 - b0) < 1e-7):
        sweep = _TURN
    sweep += turns * _TURN
    if clockwise:
        sweep = -sweep
    curve.arc, curve.plane, curve.ca, curve.cb, curve.phi, curve.sweep = 1.0, plane, ca, cb, phi0, sweep
    curve.r0, curve.r1 = norm(a0 - ca, b0 - cb), norm(a1 - ca, b1 - cb)
    curve.length = norm((curve.r0 + curve.r1) / 2 * abs(sweep), rise)
    curve.least = max(MIN_PIECE_MM, curve.length / CHORDS_A_RECORD)


@inner
def trace(curve, r):
    """Fill a curve with a record's motion."""
    if r.kind == KIND_CW or r.kind == KIND_CCW:
        set_arc(curve, r.x0, r.y0, r.z0, r.x1, r.y1, r.z1, r.c0, r.c1, r.plane, r.kind == KIND_CW, r.turns)
    else:
        curve.plane = 0.0
        set_line(curve, r.x0, r.y0, r.z0, r.x1, r.y1, r.z1)


@inner
def place(curve, t):
    """Return (x, y, z) at t."""
    if t >= 1.0:
        return curve.x1, curve.y1, curve.z1
    x = curve.x0 + t * (curve.x1 - curve.x0)
    y = curve.y0 + t * (curve.y1 - curve.y0)
    z = curve.z0 + t * (curve.z1 - curve.z0)
    if curve.arc == 0.0:
        return x, y, z
    phi, r = curve.phi + t * curve.sweep, curve.r0 + t * (curve.r1 - curve.r0)
    a, b = curve.ca + r * np.cos(phi), curve.cb + r * np.sin(phi)
    if curve.plane == 0.0:
        return a, b, z
    if curve.plane == 1.0:
        return b, y, a
    return x, a, b


@inner
def stays_near(model, curve):
    """Say whether all of a curve lies where the model knows the machine."""
    if not max(abs(curve.z0), abs(curve.z1)) <= HIGHEST_MM:
        return False
    if curve.arc == 0.0:
        return is_near(model, curve.x0, curve.y0) and is_near(model, curve.x1, curve.y1)
    for i in range(_LOOKS + 1):
        x, y, _ = place(curve, i / _LOOKS)
        if not is_near(model, x, y):
            return False
    return True


@inner
def is_flat_arc(curve):
    """Say whether a curve is an arc that is seen as one from above."""
    return curve.arc != 0.0 and curve.plane == 0.0


@inner
def aside_and_along(curve, x, y, t):
    """Return how far (x, y) lies from the whole curve and, along it, from the place of t [mm]."""
    at_x, at_y, _ = place(curve, t)
    if curve.arc == 0.0:
        dx, dy = curve.x1 - curve.x0, curve.y1 - curve.y0
        length = norm(dx, dy)
        if length > 0.0:
            aside = ((x - at_x) * dy - (y - at_y) * dx) / length
            along = ((x - at_x) * dx + (y - at_y) * dy) / length
            return abs(aside), abs(along)
    elif curve.plane == 0.0:
        aside = norm(x - curve.ca, y - curve.cb) - (curve.r0 + t * (curve.r1 - curve.r0))
        square = (x - at_x) ** 2 + (y - at_y) ** 2
        return abs(aside), np.sqrt(max(square - aside * aside, 0.0))
    return norm(x - at_x, y - at_y), 0.0


@inner
def distance(curve, x, y):
    """Return the distance [mm] of (x, y) to the curve seen from above, and the parameter of its foot, unclamped."""
    if is_flat_arc(curve) and curve.r0 > 0.0:
        dx, dy = x - curve.ca, y - curve.cb
        swept = (np.arctan2(dy, dx) - curve.phi) * np.sign(curve.sweep) % _TURN
        t = swept / abs(curve.sweep)
        if t <= 1.0:
            return abs(norm(dx, dy) - (curve.r0 + t * (curve.r1 - curve.r0))), t
        to_start, to_end = norm(x - curve.x0, y - curve.y0), norm(x - curve.x1, y - curve.y1)
        return (to_start, -1.0) if to_start < to_end else (to_end, 2.0)
    return line_distance(curve.x0, curve.y0, curve.x1, curve.y1, x, y)


@inner
def line_distance(x0, y0, x1, y1, x, y):
    """Return the distance [mm] of (x, y) to a line, and the parameter of its foot, unclamped."""
    dx, dy = x1 - x0, y1 - y0
    square = dx * dx + dy * dy
    t = ((x - x0) * dx + (y - y0) * dy) / square if square > 0.0 else 0.0
    inside = min(max(t, 0.0), 1.0)
    return norm(x - x0 - inside * dx, y - y0 - inside * dy), t
