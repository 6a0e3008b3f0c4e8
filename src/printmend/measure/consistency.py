"""Check every mark against its neighbours with a rough model of the fault, to catch dust taken for a mark.

Two smooth branches for each motor, with the waves of its pulley, and play between them explain any single fault
well enough to see a stranger that is off by a fraction of a millimetre. What all marks of a stretch of the print
share, as after a skipped tooth, is no reason for doubt.
"""

from dataclasses import dataclass

import numpy as np

from printmend.measure.plan import ProbePlan
from printmend.metrics.robust import ridge, scale_of

HARMONICS_OF_TURN = 10  # waves of a pulley's turn that the rough model has
COSINES_OF_BED = 14  # bends along an axis that it has
SIDE_ROUNDS = 3  # how often the side of each belt and the model are found in turn
SURE_OF_SIDE_MM = 2.5  # having moved this far, a belt is on the side it pushes, in the first round
NEIGHBOUR_MARKS = 5  # marks printed one after the other: an error that they share is a jump, not a mistake
LEAST_DOUBT_MM = 0.15  # a mark that lies nearer than this to where it is expected is never doubted
FIRST_SPREAD_MM, LEAST_SPREAD_MM = 0.5, 0.02  # of marks about the rough model: first guess, and smallest believed
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
    """Where each mark should be: ``place_mm`` [M, 2], ``unsure_mm`` [M, 2] the model's own standard deviation.

    ``left_out_mm`` [M, 2] is how far each mark would lie from its place had it no say in that itself (NaN where
    missing); ``shared_mm`` [M, 2] the part of its place that only the marks printed next to it vouch for;
    ``spread_mm`` [2] how far marks usually lie from their place.
    """

    place_mm: np.ndarray
    unsure_mm: np.ndarray
    left_out_mm: np.ndarray
    shared_mm: np.ndarray
    spread_mm: np.ndarray


@dataclass(frozen=True, eq=False)
class Expectation:
    """What the rough model needs to know of a plan, computed once: for each motor its way-points and its columns."""

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
    side, run = np.zeros(len(motor)), np.zeros(len(motor))
    for row, move in enumerate(np.diff(motor).tolist(), start=1):
        side[row] = np.sign(move) or side[row - 1]
        run[row] = abs(move) + (run[row - 1] if side[row] == side[row - 1] else 0.0)
    return np.arange(len(motor)), side, run >= SURE_OF_SIDE_MM


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
    """Return the error [M] that each mark shares with the NEIGHBOUR_MARKS printed before it or after it, the likelier.

    A skipped tooth shifts all that is printed afterwards: the marks at such a jump agree with one side only. A mark
    that was not found takes the side before it.
    """
    before, after = _median_before(residual), _median_before(residual[::-1])[::-1]
    before, after = np.where(np.isnan(before), after, before), np.where(np.isnan(after), before, after)
    with np.errstate(invalid="ignore"):
        nearer_after = np.abs(residual - after) < np.abs(residual - before)
    return np.nan_to_num(np.where(nearer_after, after, before))


def _median_before(residual: np.ndarray) -> np.ndarray:
    """Return the median of what is known of the NEIGHBOUR_MARKS before each mark, NaN where fewer than three are."""
    padded = np.concatenate([np.full(NEIGHBOUR_MARKS, np.nan), residual])
    around = np.stack([padded[k : k + len(residual)] for k in range(NEIGHBOUR_MARKS)], axis=1)
    count = np.isfinite(around).sum(axis=1)
    ordered = np.sort(around, axis=1)  # NaN sorts last
    last, rows = np.maximum(count, 1), np.arange(len(residual))
    median = (ordered[rows, (last - 1) // 2] + ordered[rows, last // 2]) / 2
    return np.where(count > 2, median, np.nan)
