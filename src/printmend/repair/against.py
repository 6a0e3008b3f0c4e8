"""Judge a finished file against the one it was made from: both are read again and printed by the model."""

from dataclasses import replace

import numpy as np
import shapely

from printmend.errors import GcodeError
from printmend.gcode.arcs import straightened
from printmend.gcode.read import Moves, read_gcode
from printmend.mechanism import Mechanism
from printmend.repair.prediction import Errors, Prediction
from printmend.twin.kernels import run_play

_CHORD_MM = 0.002
_SAMPLE_MM = 0.5


def judged(prediction: Prediction, source: str, output: str, mechanism: Mechanism) -> Prediction:
    """Return ``prediction`` with what the file ``output`` does in place of what mending would do.

    Shares nothing with the planner: the files are read whole, layer by layer the distance of every printed place to
    the nearest wanted one is measured. Where lines lie side by side that is less than the distance from its own line.
    Raises `GcodeError` where the layers do not correspond.
    """
    wanted = straightened(read_gcode(source, printer=mechanism.printer).moves, _CHORD_MM)
    given = straightened(read_gcode(output, printer=mechanism.printer).moves, _CHORD_MM)
    if wanted.layer.max(initial=-1) != given.layer.max(initial=-1):
        raise GcodeError(
            output, wanted=f"the {wanted.layer.max(initial=-1) + 1} layers of {source}",
            came=f"{given.layer.max(initial=-1) + 1}", todo="give the file that was made from it",
        )  # fmt: skip
    before = _distances(wanted, wanted, mechanism)
    after = _distances(wanted, given, mechanism)
    layers = []
    for number, old in enumerate(prediction.layers):
        row = dict(old)
        for name, (layer, distance, weight) in (("before", before), ("after", after)):
            mine = layer == number
            if mine.any():
                row[f"{name}_rms_mm"] = float(np.sqrt(np.average(distance[mine] ** 2, weights=weight[mine])))
                row[f"{name}_max_mm"] = float(distance[mine].max())
        layers.append(row)
    return replace(
        prediction, before=_errors(*before[1:]), after=_errors(*after[1:]), layers=tuple(layers), commands=len(given),
        distance_to="the nearest wanted line of its layer",
    )  # fmt: skip


def _errors(distance: np.ndarray, weight: np.ndarray) -> Errors:
    if not len(distance):
        return Errors(0.0, 0.0, 0.0)
    order = np.argsort(distance)
    share = np.cumsum(weight[order]) / weight.sum()
    at_p95 = min(int(np.searchsorted(share, 0.95)), len(order) - 1)
    p95 = float(distance[order[at_p95]])
    return Errors(float(np.sqrt(np.average(distance**2, weights=weight))), p95, float(distance.max()))


def _distances(wanted: Moves, given: Moves, mechanism: Mechanism) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (layer, distance to the wanted path, weight) [S] of places along the extruded path of ``given``."""
    commanded, move, weight = _sampled(given)
    printed = _printed(commanded, mechanism)
    drawn = given.extruding[move] & given.known[move, :2].all(axis=1) & (weight > 0)
    layer, weight, printed = given.layer[move][drawn], weight[drawn], printed[drawn]
    distance = np.zeros(len(layer))
    for number in np.unique(layer):
        lines = wanted.extruding & (wanted.layer == number)
        ends = np.stack([wanted.start_mm[lines, :2], wanted.end_mm[lines, :2]], axis=1)
        tree = shapely.STRtree(shapely.linestrings(ends[(ends[:, 0] != ends[:, 1]).any(axis=1)]))
        mine = np.flatnonzero(layer == number)
        (at, _), found = tree.query_nearest(shapely.points(printed[mine]), return_distance=True, all_matches=False)
        distance[mine[at]] = found
    return layer, distance, weight


def _sampled(moves: Moves) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return commanded places [S, 2] along all moves, the move of each and the length it stands for.

    The places of an extruding move lie in the middle of equal parts of it, for at its end a chord is exact. Its end is
    a place of length 0, and so is the start of one that does not begin where the last one ended (the head went there
    by itself, homing for example).
    """
    start, end = moves.start_mm[:, :2], moves.end_mm[:, :2]
    length = np.linalg.norm(end - start, axis=1)
    count = np.where(moves.extruding & (length > 0), np.maximum(np.ceil(length / _SAMPLE_MM), 3), 0).astype(np.int64)
    jumped = np.concatenate([[True], (start[1:] != end[:-1]).any(axis=1)])[: len(moves)]
    rows = count + jumped + 1
    move = np.repeat(np.arange(len(moves)), rows)
    place = np.arange(len(move)) - np.repeat(np.cumsum(rows) - rows, rows) - jumped[move]
    inside = (place >= 0) & (place < count[move])
    parts = np.maximum(count[move], 1)
    share = np.where(inside, (place + 0.5) / parts, np.where(place < 0, 0.0, 1.0))
    return start[move] + share[:, None] * (end - start)[move], move, np.where(inside, length[move] / parts, 0.0)


def _printed(commanded_mm: np.ndarray, mechanism: Mechanism) -> np.ndarray:
    """Print places [S, 2] one after the other, from the home position."""
    printer = mechanism.printer
    home_mm = np.array(printer.home_mm)
    motors = printer.to_motor(np.concatenate([home_mm[None], commanded_mm]))
    at_home = printer.to_motor(mechanism.frame.invert(home_mm))
    belts = np.empty_like(motors)
    for motor, transmission in enumerate(mechanism.transmissions):
        lower, upper = transmission.branches_mm(motors[:, motor])
        column = np.empty(len(motors))
        run_play(np.arange(len(motors)), at_home[motor], lower, upper, column)
        belts[:, motor] = column
    return mechanism.frame.apply(printer.from_motor(belts))[1:]
