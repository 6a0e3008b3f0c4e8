"""From the scanner's frame to the bed's: the gauge of a scan (physics.md §4).

A scan does not know where the plate lay. Translation is taken from the marks as a whole: their median error
becomes zero. Rotation cannot be told from one half of a skew, and what the learner may assume is part of the
gauge: on a cartesian machine the x axis keeps its direction (all skew shows as x' = x + y tan γ, physics.md
eq. 14); on a CoreXY, whose motors stretch both diagonals, the antisymmetric half of the error is zero.
"""

from dataclasses import dataclass

import numpy as np

from printmend.measure.plan import ProbePlan
from printmend.metrics.robust import ridge, scale_of, weights_of

LEAST_KEYSTONE_MM = 0.04  # RMS of what perspective moves; less may be the printer's own
MOST_UNLIKE_SHARE = 0.4  # share by which the two ways to see one tilt may differ: else it is no perspective
OPEN_SD_MM = 1e3  # of what slopes, play and waves may be: anything
LEAST_SCATTER_MM = 1e-3  # of marks: no picture is read better
ROUNDS = 8  # of turning frames onto each other, and weighing the marks


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
    # the turn that `linear` still holds, in the convention of the machine
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
    """Return by which share a picture narrows from one side of the marks [M, 2] to the other, as a tilted photo does.

    It is 0 for one that does not.
    Perspective moves the place p by p (g·p), each axis by the other's place, too: x by g_y x y, y by g_x x y, which no
    motor can, and by g_x x² and g_y y². Only where all four agree it is perspective.
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
    """Return the slopes [2, 2] of the errors of ``placed`` [K, 2] (the known marks), freed of play and of waves."""
    xy = plan.marks_mm[known]
    return _freed_fit(plan, known, list((xy - xy.mean(axis=0)).T), placed - xy).T


def _freed_fit(plan: ProbePlan, known: np.ndarray, wanted: list[np.ndarray], error: np.ndarray) -> np.ndarray:
    """Fit the errors [K, 2] of the known marks by columns, robustly and beside slopes, play and waves; return the
    values [len(wanted), 2] of these."""
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
