"""Estimate how a scanned part came out: its outline and holes, the offset of its walls, and its scale along X and Y.

A wall's place with the normal n stands out by

    δ_outline or δ_hole + n·S (p − p₀) + n·(shift, turn, skew) + n·play

where S holds the scales along X and Y. By its outline alone, a part that is too large looks like one with wide lines.
The priors for filaments and scanners then decide how much of either is likely.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from printmend.errors import ScanError
from printmend.machine import healthy_mechanism
from printmend.machine.printing import contacts_of
from printmend.measure.silhouette import ACROSS_MM
from printmend.measure.walls import RASTER_MM, Walls
from printmend.messages import say
from printmend.metrics.robust import own_share, scale_of, weights_of
from printmend.path import FLATBED, Instrument
from printmend.printer import Printer

# Find which walls of a layer belong to its outline and which to holes, and which holes are round.

BESIDE_MM = 0.45  # distance from a bead's edge at which the air beside it is looked up
OUTER, NOWHERE = 0, -1
LEAST_HOLE_MM2 = 1.0  # area of a hole; smaller ones are gaps between beads
LEAST_PLACES = 5  # fewest places of a round hole's wall
ROUND_MM, ROUND_SHARE = 0.05, 0.01  # how far a round hole's places may lie off a circle: mm, and share of the radius
MOST_GAP_RAD = 2.1  # largest unseen gap in a round hole's wall: a third


@dataclass(frozen=True)
class Round:
    """A round hole: its number among a layer's holes, its middle, and the diameter that the file commands."""

    number: int
    x_mm: float
    y_mm: float
    diameter_mm: float


@dataclass(frozen=True, eq=False)
class Outline:
    """For each wall place: ``group`` [S], its hole (`OUTER`: none, `NOWHERE`: not known); ``edge_mm`` [S, 2], the edge
    that the file commands; and ``curvature`` [S] 1/mm, its wall's curvature (negative in round holes). Also the round
    holes."""

    group: np.ndarray
    edge_mm: np.ndarray
    curvature: np.ndarray
    rounds: tuple[Round, ...]


def outline_of(walls: Walls) -> Outline:
    """Return which walls of a layer belong to its outline, and which to holes."""
    air = np.pad(~walls.plastic, 1, constant_values=True).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(air, connectivity=4)
    edge_mm = walls.commanded_mm[walls.row] + walls.half_mm[:, None] * walls.normal
    pixel = np.rint((edge_mm + BESIDE_MM * walls.normal - walls.corner_mm) / RASTER_MM).astype(int) + 1
    pixel = np.clip(pixel, 0, np.array(labels.shape[::-1]) - 1)
    label = labels[pixel[:, 1], pixel[:, 0]]
    outside = labels[0, 0]
    small = stats[:, cv2.CC_STAT_AREA] * RASTER_MM**2 < LEAST_HOLE_MM2
    group = np.full(len(label), NOWHERE)
    group[label == outside] = OUTER
    holes = [one for one in np.unique(label) if one not in (0, outside) and not small[one]]
    for number, one in enumerate(holes, 1):
        group[label == one] = number
    rounds = [found for number in range(1, len(holes) + 1) if (found := _round(number, edge_mm[group == number]))]
    return Outline(group, edge_mm, _curvature(edge_mm, walls.normal, group), tuple(rounds))


def _round(number: int, edge_mm: np.ndarray) -> Round | None:
    """Return a hole as a circle through its places [N, 2] (Kåsa 1976), None if it is not round."""
    if len(edge_mm) < LEAST_PLACES:
        return None
    middle = edge_mm.mean(axis=0)
    x, y = (edge_mm - middle).T
    (a, b, _), *_ = np.linalg.lstsq(np.column_stack([2 * x, 2 * y, np.ones(len(x))]), x * x + y * y, rcond=None)
    away = np.hypot(x - a, y - b)
    radius = float(away.mean())
    angles = np.sort(np.arctan2(y - b, x - a))
    gap = float(np.diff(np.append(angles, angles[0] + 2 * np.pi)).max())
    if np.abs(away - radius).max() > ROUND_MM + ROUND_SHARE * radius or gap > MOST_GAP_RAD:
        return None
    return Round(number, float(middle[0] + a), float(middle[1] + b), 2 * radius)


def _curvature(edge_mm: np.ndarray, normal: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Return the curvature of walls from their neighbours in the order of motion: 1/R outside, −1/R in a hole."""
    step, turn = np.diff(edge_mm, axis=0), np.diff(normal, axis=0)
    length2 = (step**2).sum(axis=1)
    near = (length2 < 2.5**2) & (length2 > 1e-6) & (group[1:] == group[:-1])
    bend = np.where(near, (step * turn).sum(axis=1) / np.where(near, length2, 1.0), np.nan)
    with np.errstate(invalid="ignore"):
        both = np.stack([np.append(np.nan, bend), np.append(bend, np.nan)])
    known = np.isfinite(both)
    return np.where(known.any(axis=0), np.nansum(both, axis=0) / np.maximum(known.sum(axis=0), 1), 0.0).clip(-1.0, 1.0)


SHARE_MM = 100.0  # scales, turns and skew are in mm per this distance
OFFSET_SD_MM, HOLE_SD_MM, SHIFT_SD_MM = 0.3, 0.3, 1.0  # prior standard deviations
TURN_SD_MM, SKEW_SD_MM, PLAY_SD_MM = 1.0, 0.5, 0.1
# Prior of a part's scale error in any filament [share], and standard deviation of machines' scales (`filament.ledger`).
ANY_MEAN, ANY_SD, MACHINE_SD = -0.004, 0.004, 0.002
EDGE_SD_MM = 0.008  # common error of all edges in a scan, outwards or inwards
UPPER_SD_MM = 0.01  # the same above the first layer, beside which the foot shows
LEAST_SIGMA_MM, ROUNDS = 0.004, 12
LEAST_SHARE = 0.08  # least share of the places that count as independent
RANGE = 1.645  # standard deviations of a 90 % range
# A ray is averaged with its neighbours. Over these, a curved wall recedes by this times its curvature [mm²].
_BENT_MM2 = float(np.mean(np.square(ACROSS_MM))) / 2


@dataclass(frozen=True)
class Known:
    """The prior of the part's scale along X and Y, as shares: its mean and its standard deviation."""

    mean: tuple[float, float] = (ANY_MEAN, ANY_MEAN)
    sd: tuple[float, float] = (float(np.hypot(ANY_SD, MACHINE_SD)),) * 2


@dataclass(frozen=True, eq=False)
class Layer:
    """One scanned layer: its number from 1, its walls, their outline, and how far each place stands out [S] mm.

    ``off_mm`` [N, 2] are the machine's errors at the walls' way-points, None if not known.
    """

    number: int
    walls: Walls
    outline: Outline
    stands_mm: np.ndarray
    off_mm: np.ndarray | None = None


@dataclass(frozen=True)
class Hole:
    """A round hole as it came out, with the standard deviation ``sd_mm``; ``own_mm`` is how far its wall stands out of
    the plastic beyond all holes of its layer."""

    at: Round
    diameter_mm: float
    sd_mm: float
    own_mm: float


@dataclass(frozen=True, eq=False)
class Side:
    """The estimate of one layer: how far its outline stands out, and how far its holes' walls stand into the holes
    (None: no hole), each with its standard deviation. Also its round holes, and its size along X and Y, as commanded
    and as printed."""

    layer: int
    outline_mm: float
    outline_sd_mm: float
    hole_mm: float | None
    hole_sd_mm: float
    extra_sd_mm: float
    rounds: tuple[Hole, ...]
    size_mm: tuple[float, float]
    came_mm: tuple[float, float]
    came_sd_mm: tuple[float, float]
    width_mm: float
    places: int
    sigma_mm: float


@dataclass(frozen=True, eq=False)
class Estimate:
    """The estimate of a part from one or two scanned layers. ``scale`` [2] are the shares by which it is too large in X
    and Y, ``scale_sd`` [2] their standard deviations; ``is_machine_off``: the machine's own are already removed.
    ``shown`` [2] are the scales in a picture of an unknown size, as its sizes have them, None for another's."""

    sides: tuple[Side, ...]
    scale: tuple[float, float]
    scale_sd: tuple[float, float]
    is_machine_off: bool
    shown: tuple[float, float] | None = None

    @property
    def first(self) -> Side | None:
        """The first layer, None if it was not scanned."""
        return next((side for side in self.sides if side.layer == 1), None)

    @property
    def upper(self) -> Side | None:
        """A layer above the first, None if none was scanned."""
        return next((side for side in self.sides if side.layer > 1), None)

    @property
    def foot_mm(self) -> tuple[float, float] | None:
        """The elephant's foot and its standard deviation, None unless both layers were scanned."""
        if self.first is None or self.upper is None:
            return None
        sd = float(np.hypot(self.first.outline_sd_mm, self.upper.outline_sd_mm))
        return self.first.outline_mm - self.upper.outline_mm, sd


def estimated(layers: Sequence[Layer], printer: Printer, instrument: Instrument | None, known: Known) -> Estimate:
    """Estimate a part from scanned layers. The machine's errors are removed if they are known for all layers. Raises
    `ScanError` if too few walls were seen."""
    blocks = [_block(layer, printer) for layer in layers]
    is_machine_off = all(layer.off_mm is not None for layer in layers)
    own, shared = blocks[0].own.shape[1], blocks[0].shared.shape[1]
    count = shared + own * len(blocks)
    columns = np.zeros((sum(len(block.wanted) for block in blocks), count))
    first = 0
    for at, block in enumerate(blocks):
        rows = slice(first, first := first + len(block.wanted))
        columns[rows, :shared] = block.shared
        columns[rows, shared + at * own : shared + (at + 1) * own] = block.own
    wanted = np.concatenate([block.wanted for block in blocks])
    mean, prior = np.zeros(count), np.zeros((count, count))
    mean[:2] = SHARE_MM * np.array(known.mean)
    prior[:2, :2] = np.diag(np.square(SHARE_MM * np.array(known.sd)))
    by = instrument or FLATBED
    prior[2:5, 2:5] = SHARE_MM**2 * (by.covariance + np.diag([by.resized_sd**2, 0.0, 0.0])) + 1e-12 * np.eye(3)
    play = 1e-6 if is_machine_off else PLAY_SD_MM
    prior[5:shared, 5:shared] = np.diag(np.square([SKEW_SD_MM, play, play]))
    sds = [OFFSET_SD_MM, HOLE_SD_MM, TURN_SD_MM, SHIFT_SD_MM, SHIFT_SD_MM]
    prior[shared:, shared:] = np.diag(np.square(np.tile(sds, len(blocks))))
    values, covariance, left, sigma = _solved(columns, wanted, mean, prior)
    shows = np.zeros((2, count))
    shows[:, :2] = np.eye(2) / SHARE_MM
    if by.resized_sd:  # nobody knows the part's own scale, and what the prior says is no size
        shows[:, 2:4] = np.array([[1.0, 1.0], [1.0, -1.0]]) / SHARE_MM
    sides, first = [], 0
    for at, (layer, block) in enumerate(zip(layers, blocks, strict=True)):
        rows = slice(first, first := first + len(block.wanted))
        own_at = slice(shared + at * own, shared + (at + 1) * own)
        sides.append(_side(layer, block, values, covariance, shows, own_at, left[rows], sigma))
    scale_sd = np.sqrt(np.diag(covariance)[:2]) / SHARE_MM
    shown = _pair(shows @ values) if by.resized_sd else None
    return Estimate(tuple(sides), _pair(values / SHARE_MM), _pair(scale_sd), is_machine_off, shown)


def _pair(values: np.ndarray) -> tuple[float, float]:
    return float(values[0]), float(values[1])


@dataclass(frozen=True, eq=False)
class _Block:
    """The rows of one layer: the places ``seen`` [R], their ``group`` [R], the values to explain ``wanted`` [R], the
    columns that all layers share, and its own columns."""

    seen: np.ndarray
    group: np.ndarray
    wanted: np.ndarray
    shared: np.ndarray
    own: np.ndarray


def _block(layer: Layer, printer: Printer) -> _Block:
    walls, outline = layer.walls, layer.outline
    seen = np.flatnonzero(np.isfinite(layer.stands_mm) & (outline.group != NOWHERE))
    if len(seen) < 20:
        raise ScanError(
            say("subject-scan"), wanted=say("walls-part"), came=say("places", len(seen)), todo=say("scan-600-dpi-2")
        )
    n, group = walls.normal[seen], outline.group[seen]
    x, y = ((outline.edge_mm[seen] - outline.edge_mm[seen].mean(axis=0)) / SHARE_MM).T
    motor = printer.to_motor(walls.commanded_mm)
    side = contacts_of(healthy_mechanism(printer), motor).side[walls.row[seen]]
    play = np.stack([n @ np.asarray(printer.from_motor(each)) for each in np.eye(2)], axis=1) * side / 2
    wanted = layer.stands_mm[seen] + _BENT_MM2 * outline.curvature[seen]
    if layer.off_mm is not None:
        off_mm = layer.off_mm[walls.row[seen]]
        wanted = wanted - np.sum((off_mm - off_mm.mean(axis=0)) * n, axis=1)
    common, half, lean = n[:, 0] * x + n[:, 1] * y, n[:, 0] * x - n[:, 1] * y, n[:, 0] * y + n[:, 1] * x
    shared = np.column_stack([n[:, 0] * x, n[:, 1] * y, common, half, lean, n[:, 0] * y, play])
    turn = n[:, 1] * x - n[:, 0] * y
    own = np.column_stack([group == OUTER, group > OUTER, turn, n]).astype(float)
    return _Block(seen, group, wanted, shared, own)


def _solved(
    columns: np.ndarray, wanted: np.ndarray, mean: np.ndarray, prior: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return the values [P], their covariance, the residuals [R] and their standard deviation; outliers count less."""
    inverse = np.linalg.inv(prior)
    weight, sigma, share, values = np.ones(len(wanted)), 0.05, 0.25, mean
    covariance = prior
    for _ in range(ROUNDS):
        scaled = columns * (share * weight)[:, None]
        covariance = np.linalg.inv(inverse + columns.T @ scaled / sigma**2)
        values = covariance @ (inverse @ mean + scaled.T @ wanted / sigma**2)
        left = wanted - columns @ values
        sigma = scale_of(left, LEAST_SIGMA_MM)
        weight, share = weights_of(left, sigma), max(own_share(left, sigma), LEAST_SHARE)
    return values, covariance, left, sigma


def _side(
    layer: Layer, block: _Block, values: np.ndarray, covariance: np.ndarray, shows: np.ndarray, own: slice,
    left: np.ndarray, sigma: float,
) -> Side:  # fmt: skip
    """Return the estimate of one layer; ``shows`` [2, P] of the values are the scales that its sizes have."""
    outline, hole = own.start, own.start + 1
    sd = np.sqrt(np.diag(covariance))
    has_holes = bool((block.group > OUTER).any())
    apart = covariance[hole, hole] + covariance[outline, outline] - 2 * covariance[outline, hole]
    edge_sd = EDGE_SD_MM if layer.number == 1 else UPPER_SD_MM
    rounds = [
        _hole(one, edge_sd, values, covariance, hole, shows, left[block.group == one.number], sigma)
        for one in layer.outline.rounds
    ]
    edge = layer.outline.edge_mm[layer.outline.group == OUTER]
    size = edge.max(axis=0) - edge.min(axis=0) if len(edge) else np.zeros(2)
    pick = size[:, None] * shows
    pick[:, outline] = 2.0
    came = size + pick @ values
    came_sd = np.sqrt(np.einsum("ap,pq,aq->a", pick, covariance, pick) + (2 * edge_sd) ** 2)
    return Side(
        layer.number, float(values[outline]), float(np.hypot(sd[outline], edge_sd)),
        float(values[hole]) if has_holes else None, float(np.hypot(sd[hole], edge_sd)),
        float(np.hypot(np.sqrt(max(apart, 0.0)), EDGE_SD_MM)), tuple(rounds), (float(size[0]), float(size[1])),
        (float(came[0]), float(came[1])), (float(came_sd[0]), float(came_sd[1])),
        float(np.median(2 * layer.walls.half_mm)), len(block.seen), sigma,
    )  # fmt: skip


# Its many parameters are the layer's values that a hole needs.
def _hole(
    one: Round, edge_sd: float, values: np.ndarray, covariance: np.ndarray, hole: int, shows: np.ndarray,
    left: np.ndarray, sigma: float,
) -> Hole:  # fmt: skip
    """Return a round hole as it came out, from all holes' offset and the mean residual of its own places."""
    free = max(len(left) * 0.25, 1.0)
    spread = sigma / np.sqrt(free)
    own = float(np.mean(np.clip(left, -3 * sigma, 3 * sigma))) if len(left) else 0.0
    pick = one.diameter_mm * shows.mean(axis=0)
    pick[hole] = -2.0
    diameter = one.diameter_mm + float(pick @ values) - 2 * own
    sd = np.sqrt(pick @ covariance @ pick + (2 * spread) ** 2 + (2 * edge_sd) ** 2)
    return Hole(one, diameter, float(sd), own)
