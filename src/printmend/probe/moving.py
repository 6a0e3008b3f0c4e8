"""Lines and corners at printing speed, after the dots: only a moving head shows its errors of motion.

Marks are printed at rest, after ringing has died away. So a battlement of lines runs along the back of the dots and
another along their right side. Each long leg along X follows a stop of Y, and each along Y a stop of X.
"""

from dataclasses import replace

import numpy as np

from printmend.measure.plan import ProbePlan
from printmend.path import frozen
from printmend.printer import Printer
from printmend.probe.layout import EDGE_MM
from printmend.probe.walk import snapped

LEG_MM, STEP_MM = 9.0, 3.0  # of a battlement: its long legs, and its short ones between them
GAP_MM = 2.6  # from the outermost dots to the nearer legs
LEAST_LEGS = 4  # along a side; shorter ones show too little


def with_moving(plan: ProbePlan, printer: Printer) -> ProbePlan:
    """Return the plan with lines at speed after its dots, along the sides where the bed has room for them."""
    low, high = plan.marks_mm.min(axis=0), plan.marks_mm.max(axis=0)
    bed = np.array([[axis.min_mm + EDGE_MM, axis.max_mm - EDGE_MM] for axis in (printer.x, printer.y)])
    runs = [_battlement(axis, low, high) for axis in range(2) if high[1 - axis] + GAP_MM + STEP_MM <= bed[1 - axis, 1]]
    runs = [run for run in runs if len(run) > 2 * LEAST_LEGS]
    if not runs or len(plan.sheets) > 1:
        return plan
    points = snapped(printer, np.vstack(runs))
    # the last dot's retraction is followed by a move to the first corner
    return replace(plan, waypoints_mm=frozen(np.vstack([plan.waypoints_mm, points])), moving=len(plan.waypoints_mm))


def _battlement(axis: int, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the corners [N, 2] of a battlement whose long legs run along ``axis``, beyond the dots' other end.

    The one along X ends where the one along Y begins: at the right.
    """
    legs = int((high[axis] - low[axis]) // LEG_MM)
    ends = np.repeat(np.linspace(low[axis], high[axis], legs + 1), 2)[1:-1]
    ends = ends if axis == 0 else ends[::-1]
    across = high[1 - axis] + GAP_MM + STEP_MM * (np.arange(len(ends)) // 2 % 2)
    points = np.empty((len(ends), 2))
    points[:, axis], points[:, 1 - axis] = ends, across
    return points
