"""Identify the marks of one scan, place them in the bed's frame, and check each against the others."""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from printmend.measure.identity import Match, identify
from printmend.measure.plan import ProbePlan
from printmend.metrics.robust import ridge, scale_of, weights_of
from printmend.units import SIGMA_PER_MEDIAN

# From the scanner's frame to the bed's: the gauge of a scan (physics.md §4).
#
# A scan does not show where the plate lay. Translation comes from all marks together: their median error becomes zero.
# A rotation looks like one half of a skew, so the gauge fixes it by convention, on which the learner relies. On a
# cartesian machine the x axis keeps its direction (all skew shows as x' = x + y tan γ, physics.md eq. 14). On a
# CoreXY, whose motors stretch both diagonals, the antisymmetric half of the error is zero.

LEAST_KEYSTONE_MM = 0.04  # least RMS shift of the marks by perspective; less may be the printer's own error
MOST_UNLIKE_SHARE = 0.4  # share by which two estimates of one tilt may differ: beyond, it is no perspective
OPEN_SD_MM = 1e3  # prior standard deviation of slopes, play and waves: they are free
LEAST_SCATTER_MM = 1e-3  # least scatter of marks: no picture is read better
ROUNDS = 8  # rounds of turning one frame onto the other and reweighting the marks


@dataclass(frozen=True, eq=False)
class Pose:
    """How the plate lay on the glass: bed position = image position @ ``matrix`` [2, 2] + ``shift_mm`` [2]."""

    matrix: np.ndarray
    shift_mm: np.ndarray

    def apply(self, image_mm: np.ndarray) -> np.ndarray:
        """Map positions in the image [..., 2] mm, y down, to the bed."""
        return image_mm @ self.matrix + self.shift_mm


def find_pose(found_mm: np.ndarray, plan: ProbePlan, *, mirrored: bool) -> Pose:
    """Return the pose that brings measured marks [M, 2] mm (image axes, y down, NaN where missing) to the bed.

    Nothing is stretched: the scale of the scan is the scale of the result.
    """
    known = np.isfinite(found_mm).all(axis=1)
    points, wanted = found_mm[known], plan.marks_mm[known]
    upright = np.diag([-1.0 if mirrored else 1.0, -1.0])
    matrix = upright @ turn_onto(points @ upright, wanted)
    linear = _linear(plan, _centred(points @ matrix, wanted), known)
    # the turn that remains in `linear`, by the convention for this kinematics
    angle = linear[1, 0] if plan.kinematics == "cartesian" else (linear[1, 0] - linear[0, 1]) / 2
    matrix = matrix @ _rotation(-angle)
    return Pose(matrix, np.median(wanted - points @ matrix, axis=0))


def _rotation(angle: float) -> np.ndarray:
    """Return the matrix that turns row vectors by ``angle``, counter-clockwise."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s], [-s, c]])


def _centred(points: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    return points + np.median(wanted - points, axis=0)


def turn_onto(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the rotation [2, 2] of points ``a`` [M, 2] onto ``b``, robustly (Kabsch; tails count less)."""
    weight = np.ones(len(a))
    turn = np.eye(2)
    for _ in range(ROUNDS):
        share = weight[:, None] / weight.sum()
        centred_a, centred_b = a - (share * a).sum(axis=0), b - (share * b).sum(axis=0)
        covariance = (share * centred_a).T @ centred_b
        turn = _rotation(float(np.arctan2(covariance[0, 1] - covariance[1, 0], np.trace(covariance))))
        error = np.hypot(*(centred_a @ turn - centred_b).T)
        weight = weights_of(error, scale_of(error, LEAST_SCATTER_MM))
    return turn


def narrowing(placed_mm: np.ndarray, plan: ProbePlan) -> float:
    """Return by which share a picture narrows across the marks [M, 2], as a tilted photo does; 0 if it does not.

    Perspective moves the place p by p (g·p): x by g_x x² + g_y x y, and y by g_y y² + g_x x y. No motor can make the
    mixed terms. It is perspective only if all four terms agree.
    """
    known = np.isfinite(placed_mm).all(axis=1)
    at = plan.to_motor(plan.marks_mm[known])
    a, b = (at - at.mean(axis=0)).T
    fit = _freed_fit(plan, known, [a * a, a * b, b * b], plan.to_motor(placed_mm[known]) - at)
    own, cross = np.array([fit[0, 0], fit[2, 1]]), np.array([fit[1, 1], fit[1, 0]])
    moved = np.stack([a, b], axis=1) * (np.stack([a, b], axis=1) @ cross)[:, None]
    slant = float(np.hypot(*cross))
    if (
        np.sqrt((moved**2).sum(axis=1).mean()) < LEAST_KEYSTONE_MM
        or np.hypot(*(own - cross)) > MOST_UNLIKE_SHARE * slant
    ):
        return 0.0
    return slant * float(np.ptp(np.stack([a, b], axis=1) @ cross / slant))


def _linear(plan: ProbePlan, placed: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return the slopes [2, 2] of the errors of the known marks ``placed`` [K, 2]; play and waves are fitted beside."""
    xy = plan.marks_mm[known]
    return _freed_fit(plan, known, list((xy - xy.mean(axis=0)).T), placed - xy).T


def _freed_fit(plan: ProbePlan, known: np.ndarray, wanted: list[np.ndarray], error: np.ndarray) -> np.ndarray:
    """Fit the columns ``wanted`` to the errors [K, 2] of the known marks, robustly, with slopes, play and waves beside
    them; return their coefficients [len(wanted), 2]."""
    xy = plan.marks_mm[known]
    motor = plan.to_motor(xy)
    columns = [*wanted, np.ones(len(xy)), *plan.motor_approaches[0][known].T.astype(float)]
    if len(wanted) > 2:
        columns += list((xy - xy.mean(axis=0)).T)
    for axis in range(2):
        phase = 2 * np.pi * motor[:, axis] / plan.mm_per_turn[axis]
        columns += [wave(k * phase) for k in range(1, 5) for wave in (np.cos, np.sin)]
    design = np.stack(columns, axis=1)
    sds = np.full(design.shape[1], OPEN_SD_MM)
    fits = (ridge(design, one, sds, first_mm=np.std(one), least_mm=LEAST_SCATTER_MM)[0] for one in error.T)
    return np.stack(list(fits), axis=1)[: len(wanted)]


# Check every mark against its neighbours with a rough model of the fault, to catch dust taken for a mark.
#
# The model has two smooth branches for each motor, play between them, and the waves of its pulley. It describes any
# single fault well enough to detect a wrong mark that is off by a fraction of a millimetre. An error that all marks of
# a stretch share, say after a skipped tooth, is no reason for doubt.

HARMONICS_OF_TURN = 10  # harmonics of a pulley's turn in the rough model
COSINES_OF_BED = 14  # cosines along an axis in the rough model
SIDE_ROUNDS = 3  # rounds of finding each belt's side and the model in turn
SURE_OF_SIDE_MM = 2.5  # in the first round, a motor that moved this far one way pushes the belt from a known side
NEIGHBOUR_MARKS = 5  # marks printed one after the other: an error that they share is a jump, not a mistake
LEAST_DOUBT_MM = 0.15  # a mark that lies nearer than this to where it is expected is never doubted
FIRST_SPREAD_MM, LEAST_SPREAD_MM = 0.5, 0.02  # spread of marks about the rough model: first guess, and least
# Prior standard deviations, as large as damaged printers need (physics.md §3), in the order of `_columns`: origin,
# scale over half a bed, fading waves, the pulley's waves, bends without a period; then terms of the other motor.
PRIOR_SD_MM = np.array(
    [
        *(5.0, 40.0, 3.0, 3.0),
        *np.repeat(3.0 / np.arange(1, HARMONICS_OF_TURN + 1) ** 1.5, 2),
        *(5.0 / np.arange(1, COSINES_OF_BED + 1)),
    ]
)
CROSS_PRIOR_SD_MM = np.array([5.0, 2.0, 2.0, 2.0])


@dataclass(frozen=True, eq=False)
class Expected:
    """Where each mark should be: ``place_mm`` [M, 2], with the model's standard deviation ``unsure_mm`` [M, 2].

    ``left_out_mm`` [M, 2] is each mark's leave-one-out residual (NaN if missing). ``shared_mm`` [M, 2] is the part of
    its place that only the marks printed just before or after support. ``spread_mm`` [2] is the usual residual.
    """

    place_mm: np.ndarray
    unsure_mm: np.ndarray
    left_out_mm: np.ndarray
    shared_mm: np.ndarray
    spread_mm: np.ndarray


@dataclass(frozen=True, eq=False)
class Expectation:
    """A plan as the rough model needs it, computed once: for each motor its way-points and its columns."""

    plan: ProbePlan
    motors_mm: np.ndarray
    columns: tuple[np.ndarray, np.ndarray]

    @classmethod
    def of(cls, plan: ProbePlan) -> "Expectation":
        """Prepare for ``plan``."""
        motors = plan.to_motor(plan.waypoints_mm)
        return cls(
            plan, motors, (_columns(motors[:, 0], plan.mm_per_turn[0]), _columns(motors[:, 1], plan.mm_per_turn[1]))
        )

    def marks(self, measured_mm: np.ndarray) -> Expected:
        """Return where each mark should be, given all measured ones [M, 2] mm (NaN where one was not found)."""
        marks = self.plan.to_motor(measured_mm)
        place, unsure, left_out, shared = (np.empty_like(marks) for _ in range(4))
        spread = np.empty(2)
        for motor in range(2):
            across = self.motors_mm[self.plan.rows, 1 - motor]
            place[:, motor], unsure[:, motor], left_out[:, motor], shared[:, motor], spread[motor] = _expected(
                self.motors_mm[:, motor], self.columns[motor], self.plan.rows, marks[:, motor], across
            )
        if self.plan.kinematics == "corexy":
            spread = np.full(2, np.hypot(*spread) / 2)
            unsure = np.repeat(np.hypot(unsure[:, :1], unsure[:, 1:]) / 2, 2, axis=1)
        bed = self.plan.from_motor
        return Expected(bed(place), unsure, bed(left_out), bed(shared), spread)


def _expected(
    motor: np.ndarray, columns: np.ndarray, rows: np.ndarray, measured: np.ndarray, across: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
    """Return place, its standard deviation, the error left out, the shared error (each [M]) and the usual spread."""
    known = np.isfinite(measured)
    over = (across - across.mean()) / (np.ptp(across) / 2 + 1e-9)
    cross = np.stack([over, over**2, over**3, over * columns[rows, 1]], axis=1)
    contact, side, sure = _contacts_by_run(motor)
    use = known & sure[rows]
    prior = np.concatenate([PRIOR_SD_MM, PRIOR_SD_MM, CROSS_PRIOR_SD_MM])
    shared, left_out = np.zeros(len(rows)), np.full(len(rows), np.nan)
    for _ in range(SIDE_ROUNDS):
        design = np.hstack([_sided(columns[contact[rows]], side[rows]), cross])
        error = measured - motor[contact[rows]]
        fit, covariance, left_out[use] = ridge(
            design[use], (error - shared)[use], prior, first_mm=FIRST_SPREAD_MM, least_mm=LEAST_SPREAD_MM
        )
        shared = _shared_error(np.where(known, error - design @ fit, np.nan))
        # contacts under these branches: where the belt was last pushed, and from which side
        width = 2 * columns.shape[1]
        lower = motor + _sided(columns, np.ones(len(motor))) @ fit[:width]
        upper = motor + _sided(columns, -np.ones(len(motor))) @ fit[:width]
        contact, side = _contacts_by_play(np.minimum(lower, upper), np.maximum(lower, upper))
        use = known
    design = np.hstack([_sided(columns[contact[rows]], side[rows]), cross])
    prediction = motor[contact[rows]] + design @ fit
    unsure = np.sqrt(np.einsum("mi,ij,mj->m", design, covariance, design, optimize=True))
    shared = _shared_error(np.where(known, measured - prediction, np.nan))
    prediction = prediction + shared
    spread = scale_of((measured - prediction)[known], 0.0)
    return prediction, unsure, left_out, shared, spread


def _columns(motor: np.ndarray, turn_mm: float) -> np.ndarray:
    """Return a line, waves and bends [N, C] at motor positions; the second column is the place from −1 to 1."""
    place = (motor - (motor.min() + motor.max()) / 2) / (np.ptp(motor) / 2 + 1e-9)
    phase = 2 * np.pi * motor / turn_mm
    waves = [wave(k * phase) for k in range(1, HARMONICS_OF_TURN + 1) for wave in (np.cos, np.sin)]
    bends = [np.cos(k * np.pi / 2 * (place + 1)) for k in range(1, COSINES_OF_BED + 1)]
    return np.stack([np.ones_like(place), place, place * waves[0], place * waves[1], *waves, *bends], axis=1)


def _sided(columns: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Return the columns for both branches: their mean, and half their difference times the side."""
    return np.hstack([columns, side[:, None] * columns])


def _contacts_by_run(motor: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return for each way-point itself as its contact, the side it is pushed from, and whether that side is sure."""
    side, run = [0.0], [0.0]
    for move in np.diff(motor).tolist():
        pushed = math.copysign(1.0, move) if move else side[-1]
        run.append(abs(move) + (run[-1] if pushed == side[-1] else 0.0))
        side.append(pushed)
    return np.arange(len(motor)), np.array(side), np.array(run) >= SURE_OF_SIDE_MM


def _contacts_by_play(lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Follow position ← clip(position, lower, upper); return the way-point [N] of the last contact and its side."""
    contact, side = [], []
    position, last, pushed = float(upper[0]), 0, -1.0
    for row, (low, high) in enumerate(zip(lower.tolist(), upper.tolist(), strict=True)):
        if position <= low:
            position, last, pushed = low, row, 1.0
        elif position >= high:
            position, last, pushed = high, row, -1.0
        contact.append(last)
        side.append(pushed)
    return np.array(contact), np.array(side)


def _shared_error(residual: np.ndarray) -> np.ndarray:
    """Return the error [M] that each mark shares with the NEIGHBOUR_MARKS printed before or after it.

    A skipped tooth shifts everything printed afterwards, so a mark at such a jump agrees with one side only. The nearer
    side counts; for a mark that was not found, the side before it.
    """
    before, after = _median_before(residual), _median_before(residual[::-1])[::-1]
    before, after = np.where(np.isnan(before), after, before), np.where(np.isnan(after), before, after)
    with np.errstate(invalid="ignore"):
        nearer_after = np.abs(residual - after) < np.abs(residual - before)
    return np.nan_to_num(np.where(nearer_after, after, before))


def _median_before(residual: np.ndarray) -> np.ndarray:
    """Return the median of the known NEIGHBOUR_MARKS before each mark, NaN where fewer than three are known."""
    padded = np.concatenate([np.full(NEIGHBOUR_MARKS, np.nan), residual])
    around = np.stack([padded[k : k + len(residual)] for k in range(NEIGHBOUR_MARKS)], axis=1)
    count = np.isfinite(around).sum(axis=1)
    ordered = np.sort(around, axis=1)  # NaN sorts last
    last, rows = np.maximum(count, 1), np.arange(len(residual))
    median = (ordered[rows, (last - 1) // 2] + ordered[rows, last // 2]) / 2
    return np.where(count > 2, median, np.nan)


LEAST_AGREEMENT = 0.85  # share of the sizes that agree with the code; a wrong placement reaches 0.75
MOST_ROUNDS = 12  # rounds of dropping marks and adding dots
GROWING_ROUNDS = 3  # after these, further rounds only follow while more marks are found
MOST_TOLERANCE_MM = 1.2  # a mark whose place is known less well than this waits until its neighbours are known
LEAST_MARKS = 9  # fewest marks that must be found
SUPPORT_REACH = 5  # so many marks printed before a mark, and as many after it, support it
LEAST_SUPPORT = 0.5  # least share of these that must be found, relative to the share of all marks
LEAST_RUN, LONGEST_RUN = 8, 20  # marks in a run that a jump shifted together; a longer run is cut
RUN_SHARE = 0.8  # least share of a run's marks that must fit its shift
RUN_REACH = 12  # so many marks before and after a mark may belong to its run
LONGEST_JUMP_MM = 9.0
SAME_SHIFT_MM = 0.35  # how far a mark of a run may lie from where the run's shift puts it
APART_MM = 0.7  # marks whose common errors differ by more lie on two sides of a jump
ODD_SPREADS, ODD_MM = 2.5, 0.15  # after a jump, a mark this many spreads and mm from its place may be another mark
RUN_NATS, RUN_LEAD_NATS = 5.0, 4.0  # least log odds of a run's sizes, and their least lead over the next best shift
ODD_SIZE_NATS = -3.0  # least log odds of a single dot: a smeared dot may have the wrong size
HOPELESS_MM = 0.6  # if marks spread by more about the rough model, it says nothing about single marks
DOUBT_SPREADS, DOUBT_SDS = 6.0, 3.0  # a mark is doubted this many spreads and standard deviations from its place


@dataclass(frozen=True, eq=False)
class Marks:
    """``match`` says which dot is which mark, ``pose`` how the plate lay.

    ``measured_mm`` [M, 2] are the marks in the bed's frame, NaN where not found. ``expected_mm`` [M, 2] is where the
    rough model expects them.
    """

    match: Match
    pose: Pose
    measured_mm: np.ndarray
    expected_mm: np.ndarray

    @property
    def found(self) -> np.ndarray:
        return self.match.found


def read_marks(dots_mm: np.ndarray, diameters_mm: np.ndarray, plan: ProbePlan) -> Marks | None:
    """Match the dots [N, 2] (mm, image axes, y down) to the plan's marks; None if no placement convinces."""
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
        """Estimate from the marks found so far how dots differ from their intended size."""
        ratio = np.log(diameters_mm[dot[dot >= 0]] / plan.diameter_mm[dot >= 0])
        usual = float(np.median(ratio))
        sd = max(SIGMA_PER_MEDIAN * float(np.median(np.abs(ratio - usual))), 0.03)
        return cls(np.log(diameters_mm) - usual, np.log(plan.diameter_mm), sd, float(plan.big.mean()))

    def fits(self, mark: int, candidate: int) -> bool:
        """Return whether a dot's size allows it to be a mark."""
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

    A mark is dropped if too many marks printed around it are missing, or if the others, fitted without it, expect it
    far away. In a run that a skipped tooth shifted, marks off their expected place are dropped, too. All of a run are
    dropped if its sizes do not spell the code.
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
    """Return the plate's pose by the marks found so far, and these marks [M, 2] on the bed."""
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
    """Drop marks that lie where the others do not expect them; add dots that lie where a mark is missing."""
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
    """Add runs of marks that are missing together because the printer jumped.

    A run is accepted under the one shift at which its sizes spell the code. Shifted by its own pitch, a lattice fits
    its places equally well. Only the sizes show the difference, so a run must be long enough.
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
    """Return the marks of a run and their free dots, under the one shift that explains them; empty if none does."""
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
