"""Compiled look-ups and state of a Z screw: how high it lifts the nozzle, and where it pushes it meanwhile.

Z is the third motor: m is what is commanded, u the nozzle's height, and u follows m through `pull` as a belt does. The
push (dx, dy) depends on m alone (physics.md eq. 15), so the belts have to go to the wanted place less the push.
"""

import numpy as np

from printmend.gcode.kernels.layout import (
    EVENT_OFFSET,
    EVENT_RESTORE,
    EVENT_SAVE,
    EVENT_ZERO,
    FLAG_KNOWN_Z1,
    FLAG_RELATIVE,
    KIND_EVENT,
    KIND_HOME,
    KIND_SET,
    SAVED_SLOTS,
    WORD_Z,
)
from printmend.jit import inner
from printmend.machine.kernels.table import push_at
from printmend.plan.kernels.curve import copy_curve, is_flat_arc
from printmend.plan.kernels.layout import (
    HOME_MM,
)
from printmend.plan.kernels.lookup import (
    LOWER,
    UPPER,
    backward,
    forward,
)
from printmend.plan.kernels.state import pull, travel_motor

ZED = 2  # the motor of Z
MOST_PARTS = 4096  # that a rising curve is cut into


@inner
def push(model, m):
    """Return where the screw pushes the nozzle when its motor is at m [mm]."""
    h = model.head
    first, rate, last = h.first[ZED], h.rate[ZED], h.last[ZED]
    x = push_at(model.tables, h.push[0], first, rate, last, m)
    return x, push_at(model.tables, h.push[1], first, rate, last, m)


@inner
def lift(model, state, m):
    """Move the motor of Z, and the nozzle with it."""
    if m != state.mended.m[ZED]:
        pull(model, state.mended, ZED, m)


@inner
def lift_raw(model, state, counts, z):
    """Move Z of the machine that reads the file as it is; return its push and its height."""
    if counts.height == 0:
        return 0.0, 0.0, z
    pull(model, state.raw, ZED, z)
    x, y = push(model, z)
    return x, y, (state.raw.low[ZED] + state.raw.high[ZED]) / 2


@inner
def note_height(layers, row, which, error, weight):
    """Add one sample of the error in height, before (0) or after (1) mending."""
    error = min(abs(error), 1e6)
    layer = layers[row]
    layer.rise_square[which] += weight * error * error
    layer.rise_most[which] = max(layer.rise_most[which], error)


@inner
def commanded(model, record, m, quantum):
    """Round a motor position of Z as it will be written, and keep it within the machine."""
    low, high = min(model.head.z_limits[0], record.z0, record.z1), max(model.head.z_limits[1], record.z0, record.z1)
    m = min(max(m, low), high)
    return record.z1 if abs(m - record.z1) <= quantum / 2 else np.rint(m / quantum) * quantum


@inner
def _loosen_nut(model, belts):
    """Note that the nut of the screw may be anywhere in its play."""
    belts.low[ZED] = forward(model, ZED, LOWER, belts.m[ZED])
    belts.high[ZED] = forward(model, ZED, UPPER, belts.m[ZED])
    belts.side[ZED] = 0.0


@inner
def find(model, state, counts, record, quantum):
    """Find the height again at a move that names it; return the motor position at the move's end."""
    z = record.z1
    if counts.height != 0:
        return commanded(model, record, travel_motor(model, state, ZED, record.z0, z), quantum)
    m = commanded(model, record, (backward(model, ZED, LOWER, z) + backward(model, ZED, UPPER, z)) / 2, quantum)
    counts.height = 1
    state.mended.m[ZED], state.raw.m[ZED] = m, z
    _loosen_nut(model, state.mended)
    _loosen_nut(model, state.raw)
    return m


@inner
def _settle_home(model, belts, z):
    """Put Z to its end stop, and the nut on the flank that homing pressed it to (see `state.settle_home`)."""
    side = model.head.z_home_side
    branch = LOWER if side > 0 else UPPER
    at_home = abs(forward(model, ZED, branch, model.head.z_home) - model.head.z_home) <= HOME_MM
    belts.m[ZED] = z
    _loosen_nut(model, belts)
    if at_home:
        belts.low[ZED] = belts.high[ZED] = forward(model, ZED, branch, z)
        belts.side[ZED] = side


@inner
def height_event(model, state, counts, r):
    """Update what is known of Z after homing, an event or a lost height."""
    known = (r.flags & FLAG_KNOWN_Z1) != 0
    if r.kind == KIND_HOME:
        if r.axes & 4 == 0:
            return
        _settle_home(model, state.mended, r.z1)
        _settle_home(model, state.raw, r.z1)
        counts.height = known
    elif r.kind == KIND_SET:
        counts.height = counts.height and known
    elif r.kind == KIND_EVENT and r.event == EVENT_SAVE:
        state.saved[r.axes, ZED] = state.mended.m[ZED] if counts.height else np.nan
    elif r.kind == KIND_EVENT and r.event == EVENT_RESTORE:
        m = state.mended.m[ZED] + r.z1 - r.z0
        if r.axes < SAVED_SLOTS:
            m = state.saved[r.axes, ZED]
        if counts.height and known and not np.isnan(m):
            lift(model, state, m)
            lift_raw(model, state, counts, r.z1)
        else:
            counts.height = 0
    elif r.kind == KIND_EVENT and r.event != EVENT_OFFSET and r.event != EVENT_ZERO:
        # the firmware went to a height of the mended file, so that of the file as it is is another
        counts.height = counts.height and known and r.z0 == r.z1
        if counts.height:
            _loosen_nut(model, state.mended)


@inner
def follow_copied_height(model, state, counts, r):
    """Follow Z through a move that is written as it is."""
    if not r.flags & FLAG_KNOWN_Z1:
        counts.height = 0
    elif counts.height != 0 and (r.words & WORD_Z or r.z0 != r.z1):
        lift(model, state, state.mended.m[ZED] + r.z1 - r.z0 if r.flags & FLAG_RELATIVE else r.z1)
        lift_raw(model, state, counts, r.z1)


@inner
def is_flat(curve):
    """Say whether a curve stays at one height, so that the push is constant along it."""
    return curve.plane == 0.0 and curve.z0 == curve.z1


@inner
def parts_of(model, curve):
    """Return into how many straight parts a rising curve must be cut for the push to be linear on each."""
    if is_flat(curve):
        return 1
    rise, chords = abs(curve.z1 - curve.z0), 0.0
    if curve.arc != 0.0:
        radius = max(curve.r0, curve.r1)
        chords = abs(curve.sweep) * np.sqrt(radius / (4.0 * model.head.chord))
        if curve.plane != 0.0:
            rise += radius * abs(curve.sweep)
    return max(1, np.int64(min(np.ceil(max(rise / model.head.rise, chords)), 1e9)))


@inner
def is_too_long(model, curve):
    """Say whether a rising curve has more parts than can be cut, as hundreds of turns in one command would."""
    return parts_of(model, curve) > MOST_PARTS


@inner
def aim(model, curve, moved, m0, m1):
    """Fill ``moved`` with where the belts must go for a curve; Z's motor goes from m0 to m1, and the z of ``moved`` is
    m."""
    copy_curve(curve, moved)
    x0, y0 = push(model, m0)
    x1, y1 = push(model, m1)
    moved.x0 -= x0
    moved.y0 -= y0
    moved.x1 -= x1
    moved.y1 -= y1
    if is_flat_arc(curve):
        moved.ca -= x1
        moved.cb -= y1
    if curve.plane == 0.0:
        moved.z0, moved.z1 = m0, m1
