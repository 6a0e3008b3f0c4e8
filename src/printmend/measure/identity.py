"""Match anonymous dots to the plan's marks, whatever the pose and however large the printer's error.

The dots form a square lattice that the printer's fault bends smoothly. So the lattice is grown neighbour by
neighbour, and each step is predicted from the dots around it. This counts rows and columns without knowing where they
should be. The code of large and small dots then says which cell is which: it fits at one place only, in one of the
eight ways to lay a square on the glass. Last, matches with dots of the wrong size are dropped.
"""

import heapq
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from printmend.measure.plan import ProbePlan
from printmend.units import SIGMA_PER_MEDIAN

NEAR_PITCHES = 0.36  # how far a dot may lie from where its neighbours predict it, in pitches of the lattice
SEEDS = 12  # dots from which a lattice is grown, one after the other
LATTICE_SHARE = 0.93  # a lattice with a larger share of the dots is accepted at once; the rest is dust
REACH_PITCHES = 2.6  # how far away neighbours may lie that predict a dot, in pitches of the lattice
LEAST_DOTS = 9  # fewest dots of a lattice
PIECE_SHARE = 0.85  # least share of a further piece's sizes that agree with the code, as for a whole print
PIECE_PITCHES = 2.0  # how far a further piece may lie from where the first one puts it, in pitches of the lattice
Classes = Callable[[int, int], int]  # which class a cell (i, j) is of: dots of one class are shifted alike
# The eight symmetries of a square lattice, as [2, 2] integer matrices; those with determinant −1 are mirrored.
SYMMETRIES = tuple(
    np.array(matrix)
    for matrix in (
        ((1, 0), (0, 1)), ((0, -1), (1, 0)), ((-1, 0), (0, -1)), ((0, 1), (-1, 0)),
        ((1, 0), (0, -1)), ((0, 1), (1, 0)), ((-1, 0), (0, 1)), ((0, -1), (-1, 0)),
    )
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Match:
    """``dot`` [M] the number of the dot of each mark, −1 where it was not found.

    ``pitch`` is the measured lattice pitch in the unit of the dots; ``mirrored`` says that the picture shows the
    print from below. ``agreement`` is the share of the dots whose size fits the code.
    """

    dot: np.ndarray
    pitch: float
    mirrored: bool
    agreement: float

    @property
    def found(self) -> np.ndarray:
        return self.dot >= 0


def identify(dots_mm: np.ndarray, diameters_mm: np.ndarray, plan: ProbePlan) -> Match | None:
    """Match dots [N, 2] to the marks of ``plan``; None if they do not form its lattice.

    The dots' y axis points down, as in images. All lengths may share a wrong scale: only ratios are used.
    """
    if len(dots_mm) < LEAST_DOTS:
        return None
    pitch = lattice_pitch(dots_mm)
    cells = _grow(dots_mm, pitch)
    if len(cells) < LEAST_DOTS:
        return None
    members = np.fromiter(cells.values(), np.int64, len(cells))
    sites = np.array(list(cells), np.int64)
    big = _is_big(diameters_mm[members], plan)
    best = _place(sites, big, plan)
    if best is None:
        return None
    agreement, symmetry, shift = best
    dot = _matched(sites @ symmetry.T + shift, members, plan)
    dot = _with_pieces(dot, members, dots_mm, diameters_mm, pitch, plan)
    dot = _without_strangers(dot, diameters_mm, plan)
    # Growth numbers its cells counter-clockwise in image coordinates, whose y axis points down.
    return Match(dot, pitch, bool(np.linalg.det(symmetry) > 0), agreement)


def _matched(sites: np.ndarray, members: np.ndarray, plan: ProbePlan) -> np.ndarray:
    """Return the dot [M] of each mark, −1 for none; dot ``members`` [K] lies at ``sites`` [K, 2]."""
    where = {tuple(site): mark for mark, site in enumerate(plan.site.tolist())}
    dot = np.full(len(plan), -1)
    for site, member in zip(sites.tolist(), members, strict=True):
        mark = where.get(tuple(site))
        if mark is not None:
            dot[mark] = member
    return dot


def _with_pieces(
    dot: np.ndarray, used: np.ndarray, dots: np.ndarray, diameters: np.ndarray, pitch: float, plan: ProbePlan
) -> np.ndarray:
    """Add the pieces of a print that lie apart from the first, say beyond a stripe that came off.

    A piece counts only if its own sizes spell the code, near the place that the first piece predicts.
    """
    dot, free = dot.copy(), np.setdiff1d(np.arange(len(dots)), used)
    found = dot >= 0
    if found.sum() < LEAST_DOTS:
        return dot
    table = np.hstack([plan.marks_mm, np.ones((len(plan), 1))])
    expected = table @ np.linalg.lstsq(table[found], dots[dot[found]], rcond=None)[0]
    while len(free) >= LEAST_DOTS:
        cells = _grow(dots[free], pitch)
        if len(cells) < LEAST_DOTS:
            break
        sites, own = np.array(list(cells), np.int64), np.fromiter(cells.values(), np.int64, len(cells))
        members, free = free[own], np.delete(free, own)
        best = _place(sites, _is_big(diameters[members], plan), plan)
        if best is None or best[0] < PIECE_SHARE:
            continue
        more = _matched(sites @ best[1].T + best[2], members, plan)
        new = (more >= 0) & (dot < 0)
        if new.any() and np.median(np.hypot(*(dots[more[new]] - expected[new]).T)) < PIECE_PITCHES * pitch:
            dot[new] = more[new]
    return dot


def lattice_pitch(dots: np.ndarray) -> float:
    """Return the usual distance from a dot to its nearest neighbours."""
    distance, _ = cKDTree(dots).query(dots, k=4)
    return float(np.median(distance[:, 1:]))


def _one_class(i: int, j: int) -> int:
    """All cells are of one class."""
    return 0


def _rows_along(i: int, j: int) -> int:
    """A cell's class is the direction in which its row was printed; even cells (i + j) lie in rows along (1, 1)."""
    return (j - i) // 2 % 2 if (i + j) % 2 == 0 else 2 + (i + j - 1) // 2 % 2


def _rows_across(i: int, j: int) -> int:
    """A cell's class is the direction in which its row was printed; even cells lie in rows along (1, −1)."""
    return (i + j) // 2 % 2 if (i + j) % 2 == 0 else 2 + (j - i - 1) // 2 % 2


def _grow(dots: np.ndarray, pitch: float) -> dict[tuple[int, int], int]:
    """Return the largest lattice found: cell → dot, growing from seeds with four regular neighbours."""
    tree = cKDTree(dots)
    seeds = _seeds(dots, tree, pitch)
    best: dict[tuple[int, int], int] = {}
    for classes in (_one_class, _rows_along, _rows_across):
        for seed, basis in seeds:
            cells = _grow_from(seed, basis, dots, tree, classes)
            if len(cells) > len(best):
                best = cells
            if len(best) > LATTICE_SHARE * len(dots):
                return best
    return best


def _seeds(dots: np.ndarray, tree: cKDTree, pitch: float) -> list[tuple[int, np.ndarray]]:
    """Return dots whose four nearest neighbours form a cross, the most regular first, with their basis [2, 2]."""
    _, near = tree.query(dots, k=min(5, len(dots)))
    if near.shape[1] < 5:
        return []
    arms = dots[near[:, 1:]] - dots[:, None]
    order = np.argsort(np.arctan2(arms[..., 1], arms[..., 0]), axis=1)
    arms = np.take_along_axis(arms, order[..., None], axis=1)
    first, second = (arms[:, 0] - arms[:, 2]) / 2, (arms[:, 1] - arms[:, 3]) / 2
    skewed = np.linalg.norm(arms[:, 0] + arms[:, 2], axis=1) + np.linalg.norm(arms[:, 1] + arms[:, 3], axis=1)
    lengths = np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1)
    uneven = np.abs(lengths[0] - pitch) + np.abs(lengths[1] - pitch)
    cross = np.abs((first * second).sum(axis=1)) / (lengths[0] * lengths[1] + 1e-9)
    badness = (skewed + uneven) / pitch + cross
    chosen = np.argsort(badness)[: SEEDS * 4 : 4]
    return [(int(seed), np.stack([first[seed], second[seed]])) for seed in chosen if badness[seed] < 1.2]


def _grow_from(
    seed: int, basis: np.ndarray, dots: np.ndarray, tree: cKDTree, classes: Classes
) -> dict[tuple[int, int], int]:
    """Grow a lattice from one dot: always the cell with the most known neighbours next."""
    cells: dict[tuple[int, int], int] = {}
    taken: set[int] = set()
    tried: dict[tuple[int, int], int] = {}
    around: dict[tuple[int, int], int] = {}  # how many known neighbours each cell has
    queue: list[tuple[int, int, tuple[int, int]]] = []
    ticket = 0
    reach = int(np.ceil(REACH_PITCHES))
    window = [
        (i, j)
        for i in range(-reach, reach + 1)
        for j in range(-reach, reach + 1)
        if 0 < i * i + j * j <= REACH_PITCHES**2
    ]
    predict = _Prediction.of(window, basis, dots, classes)

    def take(cell: tuple[int, int], dot: int) -> None:
        nonlocal ticket
        cells[cell] = dot
        taken.add(dot)
        for i, j in window:
            beside = (cell[0] + i, cell[1] + j)
            around[beside] = around.get(beside, 0) + 1
        for di, dj in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            free = (cell[0] + di, cell[1] + dj)
            if free not in cells:
                support = around[free]
                if support > tried.get(free, -1):
                    ticket += 1
                    heapq.heappush(queue, (-support, ticket, free))

    take((0, 0), seed)
    while queue:
        support, _, cell = heapq.heappop(queue)
        if cell in cells or tried.get(cell, -1) >= -support:
            continue
        tried[cell] = -support
        known = [cells.get((cell[0] + i, cell[1] + j), -1) for i, j in window]
        place, local = predict.at(cell, known)
        step = np.sqrt(abs(np.linalg.det(local)))
        distance, near = tree.query(place, k=2)
        # With a second dot almost as near, it is unclear which of the two is meant.
        if distance[0] > NEAR_PITCHES * step or near[0] in taken or distance[1] < 1.5 * distance[0]:
            continue
        take(cell, int(near[0]))
    return cells


@dataclass(frozen=True, eq=False)
class _Prediction:
    """Affine fits to the neighbours of cells, those in a ``window`` of W offsets.

    ``design`` [W, 6] and ``weight`` [W, 1] are of all of these, but for the classes that the last three columns tell
    apart. The neighbours of another class may be shifted as a whole. Where they are few or lie on one line, a fit is
    held by ``prior`` [6, 6] towards the usual basis and no shift, which pulls by ``pull`` [6, 2].
    """

    window: list[tuple[int, int]]
    dots: np.ndarray
    classes: Classes
    design: np.ndarray
    weight: np.ndarray
    prior: np.ndarray
    pull: np.ndarray

    @classmethod
    def of(cls, window: list[tuple[int, int]], basis: np.ndarray, dots: np.ndarray, classes: Classes) -> "_Prediction":
        offsets = np.array(window, float)
        weight = np.exp(-(offsets**2).sum(axis=1) / 6.0)[:, None]
        design = np.hstack([np.ones((len(offsets), 1)), offsets, np.zeros((len(offsets), 3))])
        prior = np.diag([0.0, 0.15, 0.15, *([0.1 if classes is not _one_class else 1.0] * 3)])
        pull = prior @ np.vstack([np.zeros(2), basis, np.zeros((3, 2))])
        return cls(window, dots, classes, design, weight, prior, pull)

    def at(self, cell: tuple[int, int], known: list[int]) -> tuple[np.ndarray, np.ndarray]:
        """Return where ``cell`` should lie, and the local basis [2, 2]; ``known`` [W] are the dots of its neighbours,
        −1 for none."""
        dot = np.array(known)
        there = np.flatnonzero(dot >= 0)
        design, weight, places = self.design[there], self.weight[there], self.dots[dot[there]]
        if self.classes is not _one_class:
            own = self.classes(*cell)
            for row, number in enumerate(there.tolist()):
                i, j = self.window[number]
                if other := (self.classes(cell[0] + i, cell[1] + j) - own) % 4:
                    design[row, 2 + other] = 1.0
        normal = design.T @ (weight * design) + self.prior
        fit = np.linalg.solve(normal, design.T @ (weight * places) + self.pull)
        return fit[0], fit[1:3]


def _is_big(diameters: np.ndarray, plan: ProbePlan) -> np.ndarray:
    """Separate large dots from small by the gap between the two sizes, without trusting the scale."""
    order = np.sort(np.log(diameters))
    ratio = np.log(plan.big_dot_mm / plan.dot_mm)
    share = float(plan.big.mean())
    small, large = np.quantile(order, (1 - share) / 2), np.quantile(order, 1 - share / 2)
    middle = (small + large) / 2 if large - small > 0.4 * ratio else np.inf
    return np.log(diameters) > middle


def _place(sites: np.ndarray, big: np.ndarray, plan: ProbePlan) -> tuple[float, np.ndarray, np.ndarray] | None:
    """Return the best (agreement, symmetry, shift) of the grown cells on the plan's sites; None if none stands out.

    A placement scores the dots whose size agrees, minus those that disagree, minus those outside the plan. These are
    correlations of two small pictures, computed by FFT.
    """
    plan_low = plan.site.min(axis=0)
    extent = np.ptp(plan.site, axis=0) + 1
    scores: list[tuple[float, float, np.ndarray, np.ndarray]] = []
    for symmetry in SYMMETRIES:
        turned = sites @ symmetry.T
        low = turned.min(axis=0)
        shape = tuple(int(n) for n in extent + np.ptp(turned, axis=0) + 1)
        code, inside = np.zeros(shape), np.zeros(shape)
        code[tuple((plan.site - plan_low).T)] = np.where(plan.big, 1.0, -1.0)
        inside[tuple((plan.site - plan_low).T)] = 1.0
        seen, there = np.zeros(shape), np.zeros(shape)
        seen[tuple((turned - low).T)] = np.where(big, 1.0, -1.0)
        there[tuple((turned - low).T)] = 1.0
        seen_f, there_f = np.conj(np.fft.rfft2(seen)), np.conj(np.fft.rfft2(there))
        agree = np.fft.irfft2(np.fft.rfft2(code) * seen_f, s=shape)
        overlap = np.fft.irfft2(np.fft.rfft2(inside) * there_f, s=shape)
        score = agree - 0.3 * (len(sites) - overlap)
        for flat in np.argsort(score.ravel())[-2:]:
            at = np.array(np.unravel_index(flat, shape))
            at = np.where(at > extent, at - np.array(shape), at)
            share = float(agree.ravel()[flat] / max(overlap.ravel()[flat], 1.0))
            scores.append((float(score.ravel()[flat]), (1 + share) / 2, symmetry, at + plan_low - low))
    scores.sort(key=lambda entry: -entry[0])
    best, second = scores[0], scores[1]
    if best[0] < 0.25 * len(sites) or best[0] < 1.3 * max(second[0], 0.0):
        return None
    return best[1], best[2], best[3]


def _without_strangers(dot: np.ndarray, diameters: np.ndarray, plan: ProbePlan) -> np.ndarray:
    """Drop matches of dots of the wrong size."""
    dot = dot.copy()
    found = np.flatnonzero(dot >= 0)
    size = np.log(diameters[dot[found]] / plan.diameter_mm[found])
    spread = max(SIGMA_PER_MEDIAN * np.median(np.abs(size - np.median(size))), 0.03)
    dot[found[np.abs(size - np.median(size)) > max(5.0 * spread, 0.25)]] = -1
    return dot
