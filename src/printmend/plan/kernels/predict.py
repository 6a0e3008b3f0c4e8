"""Compiled prediction: where the model prints a file, and how far that is from the wanted path."""

import numpy as np

from printmend.gcode.kernels.layout import FLAG_EXTRUDING, KIND_CCW, KIND_CW, KIND_LINEAR
from printmend.jit import inner
from printmend.plan.kernels.curve import (
    distance,
    line_distance,
    norm,
    place,
)
from printmend.plan.kernels.height import lift_raw, note_height
from printmend.plan.kernels.layout import (
    ERROR_BIN_MM,
    ERROR_BINS,
    KEPT_SAMPLES,
    NEAREST_REACH_MM,
    STROKES,
)
from printmend.plan.kernels.lookup import printed, to_motors
from printmend.plan.kernels.state import pull

STILL_MM = 0.002  # a motor that goes less between two places follows the rounding of a file


@inner
def samples_of(model, length):
    """Return at how many places a path of that length is looked at; no bed is longer than 4096 mm."""
    return 1 if length <= model.head.look else np.int64(np.ceil(min(length, 4096.0) / model.head.look))


@inner
def note(layers, row, errors, which, error, weight):
    """Add one sample of the contour error, before (0) or after (1) mending."""
    error = min(error, 1e6)
    layer = layers[row]
    layer.square[which] += weight * error * error
    layer.most[which] = max(layer.most[which], error)
    errors[which, min(np.int64(error * (1.0 / ERROR_BIN_MM)), ERROR_BINS - 1)] += weight


@inner
def with_doubt(belts, error):
    """Add to an error [mm] the standard deviation of belts that may be anywhere between ``low`` and ``high``."""
    wide0, wide1 = belts.high[0] - belts.low[0], belts.high[1] - belts.low[1]
    if wide0 + wide1 <= 0.0:
        return error
    return np.sqrt(error * error + (wide0 * wide0 + wide1 * wide1) / 12.0)


@inner
def _nearest(records, count, i, curve, x, y):
    """Return the distance of a printed place to the wanted path around record i, ahead of it or behind."""
    best, t = distance(curve, x, y)
    if 0.0 <= t <= 1.0:
        return best
    step = 1 if t > 1.0 else -1
    walked = 0.0
    j = i + step
    while 0 <= j < count and walked < NEAREST_REACH_MM:
        r = records[j]
        if r.kind == KIND_LINEAR and r.flags & FLAG_EXTRUDING:
            d, foot = line_distance(r.x0, r.y0, r.x1, r.y1, x, y)
            best = min(best, d)
            if 0.0 < foot < 1.0 or (foot >= 1.0) != (step > 0):
                break
            walked += norm(r.x1 - r.x0, r.y1 - r.y0)
        elif r.x0 != r.x1 or r.y0 != r.y1 or r.kind == KIND_CW or r.kind == KIND_CCW:
            break
        j += step
    return best


@inner
def follow_raw(model, state, x, y):
    """Move the machine that reads the file as it is."""
    m0, m1 = to_motors(model, x, y)
    pull(model, state.raw, 0, m0)
    pull(model, state.raw, 1, m1)


@inner
def _go(samples, axis, change):
    """Note which way an axis of the bed goes."""
    if change > 0.0:
        samples.ways[axis] = 1.0
    elif change < 0.0:
        samples.ways[axis] = -1.0


@inner
def _wind(samples, k, moved):
    """Note how far motor k has gone since it last turned round; what rounding moves it by is no turn."""
    if moved * samples.trend[k] <= 0.0 and abs(moved) > STILL_MM:
        if samples.trend[k] != 0.0:
            for j in range(STROKES - 1, 0, -1):
                samples.strokes[k, j] = samples.strokes[k, j - 1]
            samples.strokes[k, 0] = 0.0
        samples.trend[k] = 1.0 if moved > 0.0 else -1.0
    for j in range(STROKES):
        samples.strokes[k, j] += abs(moved)


@inner
def _follow(model, state, samples, x, y):
    """Move the machine that reads the file as it is, and note its motors' strokes."""
    m0, m1 = state.raw.m[0], state.raw.m[1]
    follow_raw(model, state, x, y)
    _wind(samples, 0, state.raw.m[0] - m0)
    _wind(samples, 1, state.raw.m[1] - m1)


@inner
def keep(samples, state, curve, s, length, x, y, row):
    """Keep a place of the extruded path, the curve at ``s`` printed at (x, y), if the last kept one is far enough back.

    When there is no room left, every other place is dropped and the distance doubles.
    """
    samples.since += length
    if samples.since < samples.gap:
        return
    kept = samples.kept
    if samples.count == KEPT_SAMPLES:
        total = 0.0
        for j in range(KEPT_SAMPLES // 2):
            weight = kept[2 * j].weight + kept[2 * j + 1].weight
            kept[j] = kept[2 * j]
            kept[j].weight = weight
            total += weight
        samples.count = KEPT_SAMPLES // 2
        samples.gap = max(2.0 * samples.gap, total / (KEPT_SAMPLES // 2))
    wanted_x, wanted_y, _ = place(curve, s)
    step = min(0.01, 0.5 - abs(s - 0.5))
    ahead_x, ahead_y, _ = place(curve, s + step)
    behind_x, behind_y, _ = place(curve, s - step)
    along = norm(ahead_x - behind_x, ahead_y - behind_y)
    tx, ty = 1.0, 0.0
    if along > 0.0:
        tx, ty = (ahead_x - behind_x) / along, (ahead_y - behind_y) / along
    sample = kept[samples.count]
    samples.count += 1
    sample.place[0], sample.place[1], sample.tangent[0], sample.tangent[1] = wanted_x, wanted_y, tx, ty
    sample.off = (y - wanted_y) * tx - (x - wanted_x) * ty
    sample.side[0], sample.side[1] = state.mended.side[0], state.mended.side[1]
    sample.ways[0], sample.ways[1] = samples.ways[0], samples.ways[1]
    for j in range(STROKES):
        sample.strokes[0, j], sample.strokes[1, j] = samples.strokes[0, j], samples.strokes[1, j]
    sample.layer, sample.weight = row, samples.since
    samples.since = 0.0


# Its many parameters are the arrays of one file's way through `mend`, handed on as they are.
@inner
def predict_raw(model, curve, state, counts, records, count, i, noted, row, layers, errors, samples, moved, files):
    """Print a move as the file has it; where ``noted``, add up its distance to the wanted path, of as many ``files``: a
    line that both have alike is as far off in both."""
    straight = curve.arc == 0.0
    looks = 0
    push_x = push_y = 0.0
    if noted:
        looks = samples_of(model, curve.length)
    elif not straight:
        looks = 16
    for j in range(looks):
        s = (j + 0.5) / looks
        if straight:
            x, y = curve.x0 + s * (curve.x1 - curve.x0), curve.y0 + s * (curve.y1 - curve.y0)
        else:
            x, y, _ = place(curve, s)
        _follow(model, state, samples, x, y)
        if moved is not None:
            _, _, z = place(curve, s)
            push_x, push_y, risen = lift_raw(model, state, counts, z)
            if noted:
                for which in range(files):
                    note_height(layers, row, which, risen - z, curve.length / looks)
        if noted:
            a = (state.raw.low[0] + state.raw.high[0]) / 2
            b = (state.raw.low[1] + state.raw.high[1]) / 2
            x, y = printed(model, a, b)
            x, y = x + push_x, y + push_y
            error = with_doubt(state.raw, _nearest(records, count, i, curve, x, y))
            for which in range(files):
                note(layers, row, errors, which, error, curve.length / looks)
            keep(samples, state, curve, s, curve.length / looks, x, y, row)
    _follow(model, state, samples, curve.x1, curve.y1)
    _go(samples, 0, curve.x1 - curve.x0)
    _go(samples, 1, curve.y1 - curve.y0)
    if moved is not None:
        lift_raw(model, state, counts, curve.z1)


@inner
def layer_of(state, counts, layers, record):
    """Return the row of the layer that an extruding record belongs to: by the slicer's comments, else by height."""
    if record.layer > 0:
        new = record.layer != counts.mark
    else:
        new = abs(record.z1 - state.layer_z) > (1e-3 if record.z0 == record.z1 else 0.05)
    if new or counts.layer < 0:
        counts.layer += 1
        counts.mark = record.layer
        state.layer_z = record.z1
        layers[counts.layer].z = record.z1
    return counts.layer
