"""The marks of one scan: identified, placed in the bed's frame, and each held against the others."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from printmend.measure.consistency import DOUBT_MM, Expectation
from printmend.measure.identity import Match, identify
from printmend.measure.plan import ProbePlan
from printmend.measure.register import Pose, find_pose

LEAST_AGREEMENT = 0.85  # of the sizes with the code; a wrong placement reaches 0.75
ROUNDS = 4
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
    for _ in range(ROUNDS):
        pose, measured = _placed(dots_mm, dot, plan, mirrored=match.mirrored)
        revised = _revised(dot, pose.apply(dots_mm), diameters_mm, measured, expectation)
        if np.array_equal(revised, dot):
            break
        dot = revised
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
    expected, spread = expectation.marks_mm(measured_mm)
    if spread.max() > HOPELESS_MM:
        return dot
    tolerance = np.maximum(6.0 * spread, DOUBT_MM)
    with np.errstate(invalid="ignore"):
        doubtful = (np.abs(measured_mm - expected) > tolerance).any(axis=1)
    dot = np.where(doubtful, -1, dot)
    fit = np.log(diameters_mm[dot[dot >= 0]] / plan.diameter_mm[dot >= 0])
    usual, size_spread = np.median(fit), max(1.4826 * np.median(np.abs(fit - np.median(fit))), 0.03)
    _, near = cKDTree(placed_mm).query(expected[dot < 0])
    claimed = set(dot[dot >= 0].tolist())
    for mark, candidate in sorted(zip(np.flatnonzero(dot < 0).tolist(), near.tolist(), strict=True)):
        size = np.log(diameters_mm[candidate] / plan.diameter_mm[mark]) - usual
        off = np.abs(placed_mm[candidate] - expected[mark])
        if candidate not in claimed and (off <= tolerance).all() and abs(size) < max(5 * size_spread, 0.25):
            dot[mark] = candidate
            claimed.add(candidate)
    return dot
