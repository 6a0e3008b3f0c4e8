"""The marks of one scan: identified, placed in the bed's frame, and each held against the others."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from printmend.measure.consistency import DOUBT_MM, Expectation
from printmend.measure.identity import Match, identify
from printmend.measure.plan import ProbePlan
from printmend.measure.register import Pose, find_pose

LEAST_AGREEMENT = 0.85  # of the sizes with the code; a wrong placement reaches 0.75
ROUNDS, STILL_ROUNDS = 12, 3
FAR_MM = 1.2  # a mark expected no better than this is left until its neighbours are known
LEAST_RUN, LONGEST_RUN, RUN_SHARE = 5, 16, 0.7
JUMP_MM, SAME_SHIFT_MM = 9.0, 0.35
HOPELESS_MM = 0.6  # beyond this spread the rough model says nothing about single marks


@dataclass(frozen=True, eq=False)
class Marks:
    """``match`` says which dot is which mark, ``pose`` how the plate lay.

    ``measured_mm`` [M, 2] in the bed's frame, NaN where a mark was not found; ``expected_mm`` [M, 2] is where the other
    marks say that each should be.
    """

    match: Match
    pose: Pose
    measured_mm: np.ndarray
    expected_mm: np.ndarray

    @property
    def found(self) -> np.ndarray:
        return self.match.found


def read_marks(dots_mm: np.ndarray, diameters_mm: np.ndarray, plan: ProbePlan) -> Marks | None:
    """Tell which of the dots [N, 2] (mm, image axes, y down) is which mark; None where no placement convinces."""
    match = identify(dots_mm, diameters_mm, plan)
    if match is None or match.agreement < LEAST_AGREEMENT or match.found.sum() < 9:
        return None
    dot, expectation = match.dot, Expectation.of(plan)
    for round_ in range(ROUNDS):
        pose, measured = _placed(dots_mm, dot, plan, mirrored=match.mirrored)
        revised = _revised(dot, pose.apply(dots_mm), diameters_mm, measured, expectation)
        if np.array_equal(revised, dot):
            break
        grown, dot = (revised >= 0).sum() > (dot >= 0).sum(), revised
        if not grown and round_ >= STILL_ROUNDS:
            break
    pose, measured = _placed(dots_mm, dot, plan, mirrored=match.mirrored)
    return Marks(replace(match, dot=dot), pose, measured, expectation.marks_mm(measured)[0])


def _placed(dots_mm: np.ndarray, dot: np.ndarray, plan: ProbePlan, *, mirrored: bool) -> tuple[Pose, np.ndarray]:
    found = np.full((len(plan), 2), np.nan)
    found[dot >= 0] = dots_mm[dot[dot >= 0]]
    pose = find_pose(found, plan, mirrored=mirrored)
    return pose, pose.apply(found)


def _revised(
    dot: np.ndarray,
    placed_mm: np.ndarray,
    diameters_mm: np.ndarray,
    measured_mm: np.ndarray,
    expectation: Expectation,
) -> np.ndarray:
    """Drop the marks that lie where the others do not expect them; take up dots that lie where a mark is missing."""
    plan = expectation.plan
    expected, unsure, spread = expectation.marks_mm(measured_mm)
    if spread.max() > HOPELESS_MM:
        return dot
    tolerance = np.maximum(6.0 * spread, DOUBT_MM) + 3.0 * unsure
    with np.errstate(invalid="ignore"):
        doubtful = (np.abs(measured_mm - expected) > tolerance).any(axis=1)
    dot = np.where(doubtful, -1, dot)
    fits = _size_fits(dot, diameters_mm, plan)
    _, near = cKDTree(placed_mm).query(expected[dot < 0])
    claimed = set(dot[dot >= 0].tolist())
    for mark, candidate in sorted(zip(np.flatnonzero(dot < 0).tolist(), near.tolist(), strict=True)):
        off = np.abs(placed_mm[candidate] - expected[mark])
        sure = (tolerance[mark] < FAR_MM).all()
        if sure and candidate not in claimed and (off <= tolerance[mark]).all() and fits(mark, candidate):
            dot[mark] = candidate
            claimed.add(candidate)
    return _after_jumps(dot, placed_mm, expected, fits)


def _size_fits(dot: np.ndarray, diameters_mm: np.ndarray, plan: ProbePlan) -> Callable[[int, int], bool]:
    """Return a test whether a dot has the size of a mark, by what the dots found so far differ from the plan."""
    ratio = np.log(diameters_mm[dot[dot >= 0]] / plan.diameter_mm[dot >= 0])
    usual = float(np.median(ratio))
    spread = max(1.4826 * float(np.median(np.abs(ratio - usual))), 0.03)
    sizes, wanted = np.log(diameters_mm) - usual, np.log(plan.diameter_mm)
    return lambda mark, candidate: bool(abs(sizes[candidate] - wanted[mark]) < max(5 * spread, 0.25))


def _after_jumps(
    dot: np.ndarray, placed_mm: np.ndarray, expected_mm: np.ndarray, fits: Callable[[int, int], bool]
) -> np.ndarray:
    """Find runs of marks that are missing together because the printer jumped: the shift that explains most of them."""
    dot = dot.copy()
    free = np.setdiff1d(np.arange(len(placed_mm)), dot[dot >= 0])
    missing = np.flatnonzero(dot < 0)
    if min(len(free), len(missing)) < LEAST_RUN:
        return dot
    tree = cKDTree(placed_mm[free])
    for run in np.split(missing, np.flatnonzero(np.diff(missing) > 3) + 1):
        for part in np.array_split(run, -(-len(run) // LONGEST_RUN)):
            if len(part) < LEAST_RUN:
                continue
            near = tree.query_ball_point(expected_mm[part], JUMP_MM)
            shifts = [placed_mm[free[k]] - expected_mm[mark] for mark, ks in zip(part, near, strict=True) for k in ks]
            best: list[tuple[int, int]] = []
            for shift in shifts:
                distance, k = tree.query(expected_mm[part] + shift)
                hits = [
                    (int(mark), int(free[i]))
                    for mark, i, off in zip(part, k, distance, strict=True)
                    if off < SAME_SHIFT_MM and fits(int(mark), int(free[i]))
                ]
                best = max(best, hits, key=len)
            if len(best) >= max(LEAST_RUN, RUN_SHARE * len(part)) and len({k for _, k in best}) == len(best):
                for mark, candidate in best:
                    dot[mark] = candidate
    claimed, counts = np.unique(dot[dot >= 0], return_counts=True)
    dot[np.isin(dot, claimed[counts > 1])] = -1
    return dot
