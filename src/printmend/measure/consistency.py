"""Does every mark lie where the others say? A rough model of the fault, to catch dust taken for a mark.

Two smooth branches for each motor, with the waves of its pulley, and play between them explain any single fault
well enough to see a stranger that is off by a fraction of a millimetre. What all marks of a stretch of the print
share, as after a skipped tooth, is no reason for doubt.
"""

from dataclasses import dataclass

import numpy as np

from printmend.measure.plan import ProbePlan

WAVES = 10
ROUNDS = 3
SURE_OF_SIDE_MM = 2.5  # having moved this far, a belt is on the side it pushes, in the first round
RUNNING = 9  # marks whose common error is a jump, not a mistake
DOUBT_MM = 0.15


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

    def marks_mm(self, measured_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return where each mark should be [M, 2] mm and the spread [2] around that.

        ``measured_mm`` [M, 2] is NaN where a mark was not found.
        """
        marks = self.plan.to_motor(measured_mm)
        expected, spread = np.empty_like(marks), np.empty(2)
        for motor in range(2):
            across = self.motors_mm[self.plan.rows, 1 - motor]
            expected[:, motor], spread[motor] = _expected(
                self.motors_mm[:, motor], self.columns[motor], self.plan.rows, marks[:, motor], across
            )
        if self.plan.kinematics == "corexy":
            spread = np.full(2, np.hypot(*spread) / 2)
        return self.plan.from_motor(expected), spread


def _expected(
    motor: np.ndarray, columns: np.ndarray, rows: np.ndarray, measured: np.ndarray, across: np.ndarray
) -> tuple[np.ndarray, float]:
    known = np.isfinite(measured)
    over = (across - across.mean()) / (np.ptp(across) / 2 + 1e-9)
    cross = np.stack([over, over**2, over**3, over * columns[rows, 1]], axis=1)
    contact, side, sure = _contacts_by_run(motor)
    use = known & sure[rows]
    for _ in range(ROUNDS):
        design = np.hstack([_sided(columns[contact[rows]], side[rows]), cross])
        fit = _robust_fit(design[use], (measured - motor[contact[rows]])[use])
        # contacts under these branches: where the belt was last pushed, and from which side
        width = 2 * columns.shape[1]
        lower = motor + _sided(columns, np.ones(len(motor))) @ fit[:width]
        upper = motor + _sided(columns, -np.ones(len(motor))) @ fit[:width]
        contact, side = _contacts_by_play(np.minimum(lower, upper), np.maximum(lower, upper))
        use = known
    design = np.hstack([_sided(columns[contact[rows]], side[rows]), cross])
    prediction = motor[contact[rows]] + design @ fit
    prediction = prediction + _running_median(np.where(known, measured - prediction, np.nan))
    return prediction, 1.4826 * float(np.median(np.abs((measured - prediction)[known])))


def _columns(motor: np.ndarray, turn_mm: float) -> np.ndarray:
    """Return polynomials and waves [N, C] at motor positions; the second column is the place from −1 to 1."""
    place = (motor - (motor.min() + motor.max()) / 2) / (np.ptp(motor) / 2 + 1e-9)
    phase = 2 * np.pi * motor / turn_mm
    waves = [wave(k * phase) for k in range(1, WAVES + 1) for wave in (np.cos, np.sin)]
    return np.stack(
        [np.ones_like(place), place, place**2, place**3, place * waves[0], place * waves[1], *waves], axis=1
    )


def _sided(columns: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Return the columns for both branches: their mean, and half their difference times the side."""
    return np.hstack([columns, side[:, None] * columns])


def _robust_fit(design: np.ndarray, target: np.ndarray) -> np.ndarray:
    weight = np.ones(len(target))
    ridge = 1e-3 * np.eye(design.shape[1])
    for _ in range(5):
        fit = np.linalg.solve(design.T @ (weight[:, None] * design) + ridge, design.T @ (weight * target))
        residual = target - design @ fit
        scale = max(1.4826 * float(np.median(np.abs(residual))), 0.01)
        weight = 1.0 / (1.0 + (residual / (2 * scale)) ** 2)
    return fit


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


def _running_median(residual: np.ndarray) -> np.ndarray:
    """Return the median of the RUNNING neighbours in order of printing, the mark itself left out."""
    half = RUNNING // 2
    padded = np.concatenate([np.full(half, np.nan), residual, np.full(half, np.nan)])
    around = np.stack([padded[k : k + len(residual)] for k in range(RUNNING) if k != half], axis=1)
    count = np.isfinite(around).sum(axis=1)
    ordered = np.sort(around, axis=1)  # NaN sorts last
    last, rows = np.maximum(count, 1), np.arange(len(residual))
    median = (ordered[rows, (last - 1) // 2] + ordered[rows, last // 2]) / 2
    return np.where(count > 2, median, 0.0)
