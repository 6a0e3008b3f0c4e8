"""The marks of one scan: identified, placed in the bed's frame, and each held against the others."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from printmend.measure.consistency import LEAST_DOUBT_MM, Expectation, Expected
from printmend.measure.identity import Match, identify
from printmend.measure.plan import ProbePlan
from printmend.measure.register import Pose, find_pose
from printmend.units import SIGMA_PER_MEDIAN

LEAST_AGREEMENT = 0.85  # share of the sizes that agree with the code; a wrong placement reaches 0.75
MOST_ROUNDS = 12  # of dropping marks and taking up dots
GROWING_ROUNDS = 3  # rounds after which it goes on only while more marks are found
MOST_TOLERANCE_MM = 1.2  # a mark whose place is known less well than this is left until its neighbours are known
LEAST_MARKS = 9  # that must be found
SUPPORT_REACH = 5  # marks printed before a mark, and as many after, that support it
LEAST_SUPPORT = 0.5  # share of them that must be found, beside the share of all marks that are
LEAST_RUN, LONGEST_RUN = 8, 20  # marks of a run that a jump shifted together; a longer one is cut
RUN_SHARE = 0.8  # share of a run that must lie under its shift
RUN_REACH = 12  # marks before and after one that may be of its run
LONGEST_JUMP_MM = 9.0
SAME_SHIFT_MM = 0.35  # how far a mark of a run may lie from where the run's shift puts it
APART_MM = 0.7  # marks whose common error differs by more lie on two sides of a jump
ODD_SPREADS, ODD_MM = 2.5, 0.15  # after a jump, a mark this many spreads and mm from its place may be another mark
RUN_NATS, RUN_LEAD_NATS = 5.0, 4.0  # log odds that a run's sizes must have, and have beyond the next best shift's
ODD_SIZE_NATS = -3.0  # least log odds of one dot, whose size may not fit because it is smeared
HOPELESS_MM = 0.6  # where marks spread by more about the rough model, it says nothing about single marks
DOUBT_SPREADS, DOUBT_SDS = 6.0, 3.0  # a mark is doubted this many spreads and standard deviations from its place


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
    if match is None or match.agreement < LEAST_AGREEMENT or match.found.sum() < LEAST_MARKS:
        return None
    dot, expectation = match.dot, Expectation.of(plan)
    for round_ in range(MOST_ROUNDS):
        pose, measured = _placed(dots_mm, dot, plan, mirrored=match.mirrored)
        revised = _revised(dot, pose.apply(dots_mm), diameters_mm, measured, expectation)
        if np.array_equal(revised, dot):
            break
        grown, dot = (revised >= 0).sum() > (dot >= 0).sum(), revised
        if not grown and round_ >= GROWING_ROUNDS:
            break
    sizes = Sizes.of(dot, diameters_mm, plan)
    _, measured = _placed(dots_mm, dot, plan, mirrored=match.mirrored)
    expected = expectation.marks(measured)
    if expected.spread_mm.max() > HOPELESS_MM:
        return None
    dot = _vouched_for(dot, measured, expected, sizes, plan.pitch_mm)
    if (dot >= 0).sum() < LEAST_MARKS:
        return None
    pose, measured = _placed(dots_mm, dot, plan, mirrored=match.mirrored)
    return Marks(replace(match, dot=dot), pose, measured, expectation.marks(measured).place_mm)


@dataclass(frozen=True, eq=False)
class Sizes:
    """``dots`` [N] and ``marks`` [M] logarithms of diameters, on one scale; their ``sd``; ``share`` of big marks."""

    dots: np.ndarray
    marks: np.ndarray
    sd: float
    share: float

    @classmethod
    def of(cls, dot: np.ndarray, diameters_mm: np.ndarray, plan: ProbePlan) -> "Sizes":
        """Learn how dots differ from their intended size from the marks found so far."""
        ratio = np.log(diameters_mm[dot[dot >= 0]] / plan.diameter_mm[dot >= 0])
        usual = float(np.median(ratio))
        sd = max(SIGMA_PER_MEDIAN * float(np.median(np.abs(ratio - usual))), 0.03)
        return cls(np.log(diameters_mm) - usual, np.log(plan.diameter_mm), sd, float(plan.big.mean()))

    def fits(self, mark: int, candidate: int) -> bool:
        """Say whether a dot could be a mark, all else being right."""
        return bool(abs(self.dots[candidate] - self.marks[mark]) < max(5 * self.sd, 0.25))

    def evidence(self, marks: np.ndarray, candidates: np.ndarray) -> np.ndarray:
        """Return the log odds [K] that dots are these marks rather than any others, by their size alone."""
        observed, small, large = self.dots[candidates], self.marks.min(), self.marks.max()
        of_mark = -(((observed - self.marks[marks]) / self.sd) ** 2) / 2
        other = np.logaddexp(
            np.log(self.share) - ((observed - large) / self.sd) ** 2 / 2,
            np.log1p(-self.share) - ((observed - small) / self.sd) ** 2 / 2,
        )
        return np.maximum(of_mark - other, ODD_SIZE_NATS)


def _vouched_for(
    dot: np.ndarray, measured_mm: np.ndarray, expected: Expected, sizes: Sizes, pitch_mm: float
) -> np.ndarray:
    """Drop the marks that no others confirm.

    A mark is dropped where too many marks printed around it are missing, and where the others, asked without it, expect
    it far away. Of a run of marks that a skipped tooth shifted together, those are dropped that lie beside their place,
    and all where the sizes of the run do not spell the code.
    """
    window = np.ones(2 * SUPPORT_REACH + 1)
    beside = np.convolve(dot >= 0, window, "same") - (dot >= 0)
    total = (np.convolve(np.ones(len(dot)), window, "same") - 1) * (dot >= 0).mean()
    far = (np.abs(np.nan_to_num(expected.left_out_mm)) > pitch_mm / 4).any(axis=1)
    shifted = (np.abs(expected.shared_mm) > APART_MM).any(axis=1)
    with np.errstate(invalid="ignore"):
        odd = (np.abs(measured_mm - expected.place_mm) > np.maximum(ODD_SPREADS * expected.spread_mm, ODD_MM)).any(
            axis=1
        )
    dot = np.where(far | (beside < LEAST_SUPPORT * total) | (shifted & odd), -1, dot)
    found = np.flatnonzero(dot >= 0)
    shared, evidence = expected.shared_mm[found], sizes.evidence(found, dot[found])
    for at in np.flatnonzero(np.abs(shared).max(axis=1) > APART_MM):
        near = slice(max(0, at - RUN_REACH), at + RUN_REACH + 1)
        alike = np.abs(shared[near] - shared[at]).max(axis=1) < APART_MM
        if evidence[near][alike].sum() < RUN_NATS:
            dot[found[at]] = -1
    return dot


def _placed(dots_mm: np.ndarray, dot: np.ndarray, plan: ProbePlan, *, mirrored: bool) -> tuple[Pose, np.ndarray]:
    """Return how the plate lay, by the marks found so far, and these [M, 2] on the bed."""
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
    known = expectation.marks(measured_mm)
    expected = known.place_mm
    if known.spread_mm.max() > HOPELESS_MM:
        return dot
    tolerance = np.maximum(DOUBT_SPREADS * known.spread_mm, LEAST_DOUBT_MM) + DOUBT_SDS * known.unsure_mm
    with np.errstate(invalid="ignore"):
        doubtful = (np.abs(measured_mm - expected) > tolerance).any(axis=1)
    dot = np.where(doubtful, -1, dot)
    sizes = Sizes.of(dot, diameters_mm, plan)
    _, near = cKDTree(placed_mm).query(expected[dot < 0])
    claimed = set(dot[dot >= 0].tolist())
    for mark, candidate in sorted(zip(np.flatnonzero(dot < 0).tolist(), near.tolist(), strict=True)):
        off = np.abs(placed_mm[candidate] - expected[mark])
        sure = (tolerance[mark] < MOST_TOLERANCE_MM).all()
        if sure and candidate not in claimed and (off <= tolerance[mark]).all() and sizes.fits(mark, candidate):
            dot[mark] = candidate
            claimed.add(candidate)
    return _after_jumps(dot, placed_mm, expected, sizes)


def _after_jumps(dot: np.ndarray, placed_mm: np.ndarray, expected_mm: np.ndarray, sizes: Sizes) -> np.ndarray:
    """Take up runs of marks that are missing together because the printer jumped.

    A run is looked for under the one shift at which its sizes spell the code. A lattice that is shifted by its own
    pitch fits as well in place; only the sizes tell it, so a run must be long enough.
    """
    dot = dot.copy()
    free = np.setdiff1d(np.arange(len(placed_mm)), dot[dot >= 0])
    missing = np.flatnonzero(dot < 0)
    if min(len(free), len(missing)) < LEAST_RUN:
        return dot
    tree = cKDTree(placed_mm[free])
    for run in np.split(missing, np.flatnonzero(np.diff(missing) > 3) + 1):
        for part in np.array_split(run, -(-len(run) // LONGEST_RUN)):
            if len(part) >= LEAST_RUN:
                marks, found = _shifted_run(part, tree, free, placed_mm, expected_mm, sizes)
                dot[marks] = found
    claimed, counts = np.unique(dot[dot >= 0], return_counts=True)
    dot[np.isin(dot, claimed[counts > 1])] = -1
    return dot


def _shifted_run(
    part: np.ndarray, tree: cKDTree, free: np.ndarray, placed_mm: np.ndarray, expected_mm: np.ndarray, sizes: Sizes
) -> tuple[np.ndarray, np.ndarray]:
    """Return marks of a run and the free dots they are under the one shift that explains them, or none."""
    nothing = np.empty(0, np.int64), np.empty(0, np.int64)
    near = tree.query_ball_point(expected_mm[part], LONGEST_JUMP_MM)
    found: list[tuple[float, np.ndarray, np.ndarray]] = []
    for mark, ks in zip(part, near, strict=True):
        for k in ks:
            distance, at = tree.query(expected_mm[part] + (placed_mm[free[k]] - expected_mm[mark]))
            hit = distance < SAME_SHIFT_MM
            if hit.sum() >= max(LEAST_RUN, RUN_SHARE * len(part)) and len(set(at[hit].tolist())) == hit.sum():
                marks, dots = part[hit], free[at[hit]]
                found.append((float(sizes.evidence(marks, dots).sum()), marks, dots))
    if not found:
        return nothing
    best, marks, dots = max(found, key=lambda one: one[0])
    others = [score for score, _, other in found if len(np.intersect1d(dots, other)) * 2 < len(dots)]
    if best < RUN_NATS or best - max(others, default=0.0) < RUN_LEAD_NATS:
        return nothing
    fitting = np.array([sizes.fits(mark, dot) for mark, dot in zip(marks.tolist(), dots.tolist(), strict=True)])
    return marks[fitting], dots[fitting]
