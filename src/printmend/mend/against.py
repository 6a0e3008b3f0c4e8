"""Compare a mended file with its original: read both again and let the model print them."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely

from printmend.clock import file_seconds
from printmend.errors import GcodeError
from printmend.gcode.read import Moves, read_gcode, straightened
from printmend.machine import Mechanism, print_from_home
from printmend.mend.mend import check_gcode
from printmend.mend.prediction import Heights, Prediction, with_doubt
from printmend.messages import say
from printmend.model import SavedModel, exact_model
from printmend.promise.predict import Errors, without_doubt
from printmend.twin.twin import Twin

_CHORD_MM = 0.002  # how far an arc's chords may lie from it
_SAMPLE_MM = 0.5  # longest path between two places that are judged
_FILAMENT_SHARE = 0.01  # share by which the filament of the two files may differ
# A rising path is judged stretch by stretch, each against the wanted path of the same filament and a margin.
_NEAR_MM = 5.0  # the margin: length of wanted path before and after a stretch
_STRETCH_RATIO = 8  # length of a stretch, in `_NEAR_MM`


class _Places(NamedTuple):
    """Places [S] along the extruded path of a file, as they are printed.

    ``layer`` is the layer of the wanted path that a place belongs to, ``distance_mm`` how far it lies from that path,
    ``length_mm`` the length of path that it stands for, and ``rise_mm`` by how much it lies too high.
    """

    layer: np.ndarray
    distance_mm: np.ndarray
    length_mm: np.ndarray
    rise_mm: np.ndarray


def judge_gcode(source: str | Path, output: str | Path, twin: Twin) -> Prediction:
    """Print ``source`` and ``output``, the file made from it, on a twin, and measure the error of each.

    The result's ``before`` is the source's error, ``after`` the output's. Skipped teeth and lost steps, which no file
    can mend, are left out. Raises `InputError` for a twin with a gain table, which gives way-points no places. Raises
    `GcodeError` like `check_gcode`, and if the layers do not correspond.
    """
    truth = twin.homed()
    return judged(check_gcode(source, exact_model(truth)), str(source), str(output), truth)


def checked_against(prediction: Prediction, source: str, output: str, model: SavedModel) -> Prediction:
    """Return what `judged` does, with the model's uncertainty; a file that errs as its source does has the source's."""
    known = judged(prediction, source, output, model.mechanism)
    found = with_doubt(known, model)
    return replace(found, after=found.before) if known.after == known.before else found


def judged(prediction: Prediction, source: str, output: str, mechanism: Mechanism) -> Prediction:
    """Return ``prediction`` with the errors of the file ``output`` in place of those predicted for mending.

    This shares no code with the planner: it reads both files whole and measures, layer by layer, the distance of every
    printed point to the nearest intended line. Among parallel lines, that is less than the distance to its own line.
    Raises `GcodeError` if the layers do not correspond.
    """
    wanted = straightened(read_gcode(source, printer=mechanism.printer).moves, _CHORD_MM)
    given = straightened(read_gcode(output, printer=mechanism.printer).moves, _CHORD_MM)
    # On a rising path, or with a bad screw, a layer's commands differ in height: the filament used tells the layer.
    same = wanted.layer.max(initial=-1) == given.layer.max(initial=-1)
    if mechanism.screw is None and not same and not _is_sloped(wanted):
        raise GcodeError(
            output, wanted=say("layers-of-file", wanted.layer.max(initial=-1) + 1, source),
            came=f"{given.layer.max(initial=-1) + 1}", todo=say("give-file-made-from-it"),
        )  # fmt: skip
    used, got = _advance(wanted).sum(), _advance(given).sum()
    if abs(got - used) > _FILAMENT_SHARE * used:
        raise GcodeError(
            output, wanted=say("filament-of-file", f"{used:.1f}", source), came=say("mm-2", f"{got:.1f}"),
            todo=say("give-file-made-from-it"),
        )  # fmt: skip
    before = _distances(wanted, wanted, mechanism)
    after = _distances(wanted, given, mechanism)
    layers = []
    for number, old in enumerate(prediction.layers):
        row = dict(old)
        for name, places in (("before", before), ("after", after)):
            mine = places.layer == number
            if mine.any():
                row[f"{name}_rms_mm"] = _rms(places.distance_mm[mine], places.length_mm[mine])
                row[f"{name}_max_mm"] = float(places.distance_mm[mine].max())
                if mechanism.screw is not None:
                    row[f"{name}_height_rms_mm"] = _rms(places.rise_mm[mine], places.length_mm[mine])
        layers.append(row)
    heights = None
    if mechanism.screw is not None:
        heights = (_heights(before), _heights(after))
    duration = prediction.duration
    if duration is not None:
        duration = replace(duration, after_s=file_seconds(output, duration.limits, mechanism.printer))
    return replace(
        prediction, duration=duration, before=without_doubt(_errors(before)), after=without_doubt(_errors(after)),
        layers=tuple(layers), commands=prediction.moves + len(given) - len(wanted),
        distance_to=say("nearest-wanted-line"), heights=heights,
    )  # fmt: skip


def _is_sloped(moves: Moves) -> bool:
    """Return whether any extruding move rises or falls, as in a spiral vase."""
    return bool((moves.start_mm[moves.extruding, 2] != moves.end_mm[moves.extruding, 2]).any())


def _rms(error_mm: np.ndarray, length_mm: np.ndarray) -> float:
    return float(np.sqrt(np.average(error_mm**2, weights=length_mm)))


def _heights(places: _Places) -> Heights:
    rise_mm = places.rise_mm
    return Heights(_rms(rise_mm, places.length_mm), float(np.abs(rise_mm).max())) if len(rise_mm) else Heights(0.0, 0.0)


def _errors(places: _Places) -> Errors:
    distance, weight = places.distance_mm, places.length_mm
    if not len(distance):
        return Errors(0.0, 0.0, 0.0)
    order = np.argsort(distance)
    share = np.cumsum(weight[order]) / weight.sum()
    at_p95 = min(int(np.searchsorted(share, 0.95)), len(order) - 1)
    p95 = float(distance[order[at_p95]])
    return Errors(_rms(distance, weight), p95, float(distance.max()))


def _distances(wanted: Moves, given: Moves, mechanism: Mechanism) -> _Places:
    """Return the printed places along the extruded path of ``given``, each with its distance from ``wanted``.

    If a bad screw gives a layer's commands several heights, the filament used so far assigns each place to a layer of
    the wanted path. On a rising path, it assigns each place to a short stretch of it.
    """
    commanded, move, weight, share = _sampled(given)
    printed = print_from_home(mechanism, commanded)
    drawn = given.extruding[move] & given.known[move, :2].all(axis=1) & (weight > 0)
    layer, weight, printed = given.layer[move][drawn], weight[drawn], printed[drawn]
    used, fed, group = _fed(wanted), None, layer
    near = _NEAR_MM * used[-1] / max(float(weight.sum()), _NEAR_MM) if len(used) else 0.0
    sloped = _is_sloped(wanted)
    if sloped or wanted.layer.max(initial=-1) != given.layer.max(initial=-1):
        fed = ((_fed(given) - _advance(given))[move] + share * _advance(given)[move])[drawn]
        order = np.flatnonzero(wanted.extruding)
        layer = wanted.layer[order[np.minimum(np.searchsorted(used[order], fed), len(order) - 1)]]
        group = np.floor(fed / (_STRETCH_RATIO * near)).astype(np.int64) if sloped else layer
    distance, rise = np.zeros(len(layer)), np.zeros(len(layer))
    for number in np.unique(group):
        lines = wanted.extruding & (wanted.layer == number)
        mine = np.flatnonzero(group == number)
        if fed is not None and sloped:
            since = used - _advance(wanted)
            lines = wanted.extruding & (used >= fed[mine].min() - near) & (since <= fed[mine].max() + near)
        lines &= (wanted.start_mm[:, :2] != wanted.end_mm[:, :2]).any(axis=1)
        strings = shapely.linestrings(np.stack([wanted.start_mm[lines, :2], wanted.end_mm[lines, :2]], axis=1))
        points = shapely.points(printed[mine, :2])
        (at, line), found = shapely.STRtree(strings).query_nearest(points, return_distance=True, all_matches=False)
        distance[mine[at]] = found
        foot = shapely.line_locate_point(strings[line], points[at], normalized=True)
        low, high = wanted.start_mm[lines, 2][line], wanted.end_mm[lines, 2][line]
        rise[mine[at]] = printed[mine[at], 2] - (low + foot * (high - low))
    return _Places(layer, distance, weight, rise)


def _advance(moves: Moves) -> np.ndarray:
    """Return the filament [M] of each extruding move."""
    return np.where(moves.extruding, moves.extrusion_mm, 0.0)


def _fed(moves: Moves) -> np.ndarray:
    """Return the filament [M] extruded by the end of each move, without retractions."""
    return np.cumsum(_advance(moves))


def _sampled(moves: Moves) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return commanded places [S, 3] along all moves, the move of each, the length it stands for, and its share of it.

    The places of an extruding move are the middles of equal parts, because a chord has no error at its ends. A move's
    end is a place of length 0. So is its start if the last move ended elsewhere: the head went there by itself, say to
    home.
    """
    start, end = moves.start_mm, moves.end_mm
    length = np.linalg.norm((end - start)[:, :2], axis=1)
    count = np.where(moves.extruding & (length > 0), np.maximum(np.ceil(length / _SAMPLE_MM), 3), 0).astype(np.int64)
    jumped = np.concatenate([[True], (start[1:] != end[:-1]).any(axis=1)])[: len(moves)]
    rows = count + jumped + 1
    move = np.repeat(np.arange(len(moves)), rows)
    place = np.arange(len(move)) - np.repeat(np.cumsum(rows) - rows, rows) - jumped[move]
    inside = (place >= 0) & (place < count[move])
    parts = np.maximum(count[move], 1)
    share = np.where(inside, (place + 0.5) / parts, np.where(place < 0, 0.0, 1.0))
    weight = np.where(inside, length[move] / parts, 0.0)
    return start[move] + share[:, None] * (end - start)[move], move, weight, share
