"""Compiled tracking of all that is not planned: homing, events, lost places, and moves that stay as they are."""

import numpy as np

from printmend.gcode.kernels.layout import (
    EVENT_EXCLUDE,
    EVENT_GEOMETRY,
    EVENT_OFFSET,
    EVENT_RESTORE,
    EVENT_SAVE,
    EVENT_SPLINE,
    EVENT_ZERO,
    FLAG_KNOWN_X1,
    FLAG_KNOWN_Y1,
    FLAG_RELATIVE,
    KIND_EVENT,
    KIND_HOME,
    KIND_SET,
    SAVED_SLOTS,
)
from printmend.jit import inner
from printmend.plan.kernels.lookup import (
    to_motors,
)
from printmend.plan.kernels.predict import (
    follow_raw,
)
from printmend.plan.kernels.state import (
    arrive,
    open_interval,
    settle_home,
)


@inner
def event(model, state, counts, r):
    """Update what is known of the belts after homing, an event or a lost place."""
    known = (r.flags & FLAG_KNOWN_X1) != 0 and (r.flags & FLAG_KNOWN_Y1) != 0
    if r.kind == KIND_HOME:
        if r.axes & 3 == 0:
            return
        settle_home(model, state.mended, r.axes, r.x1, r.y1)
        settle_home(model, state.raw, r.axes, r.x1, r.y1)
        counts.known = known
        if r.axes & 3 == 3:
            counts.anywhere = 0
    elif r.kind == KIND_SET:
        counts.known = counts.known and known
    elif r.kind == KIND_EVENT and r.event == EVENT_SAVE:
        state.saved[r.axes, 0] = state.mended.m[0] if counts.known else np.nan
        state.saved[r.axes, 1] = state.mended.m[1]
    elif r.kind == KIND_EVENT and r.event == EVENT_RESTORE:
        m0, m1 = to_motors(model, r.x1 - r.x0, r.y1 - r.y0)
        m0, m1 = state.mended.m[0] + m0, state.mended.m[1] + m1
        sure = counts.known != 0
        if r.axes < SAVED_SLOTS:
            m0, m1 = state.saved[r.axes, 0], state.saved[r.axes, 1]
            counts.known = not np.isnan(m0)
        counts.known = counts.known and known
        if counts.known:
            arrive(model, state, m0, m1)
            follow_raw(model, state, r.x1, r.y1)
        if counts.known and not sure:
            open_interval(model, state.mended)
            open_interval(model, state.raw)
    elif r.kind == KIND_EVENT and r.event == EVENT_GEOMETRY:
        counts.geometry += 1
    elif r.kind == KIND_EVENT and r.event != EVENT_OFFSET and r.event != EVENT_ZERO:
        counts.splines += r.event == EVENT_SPLINE
        if r.x0 != r.x1 or r.y0 != r.y1:
            known = False  # the firmware went back to a place of the mended file
        counts.known = counts.known and known
        if counts.known:
            open_interval(model, state.mended)
            counts.anywhere = counts.anywhere or r.event == EVENT_EXCLUDE


@inner
def follow_copied(model, state, counts, r, known):
    """Follow a move that is written as it is, because its place is unknown or not all of it can be read."""
    counts.copied += 1
    if counts.known and known:
        m0, m1 = to_motors(model, r.x1, r.y1)
        if r.flags & FLAG_RELATIVE:
            m0, m1 = to_motors(model, r.x1 - r.x0, r.y1 - r.y0)
            m0, m1 = m0 + state.mended.m[0], m1 + state.mended.m[1]
        arrive(model, state, m0, m1)
    counts.known = counts.known and known
