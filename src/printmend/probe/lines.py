"""What a probe prints beside its dots: lines at printing speed, and a thin net under the dots of a plate."""

from dataclasses import replace

import numpy as np

from printmend.errors import ConfigError
from printmend.measure.plan import ProbePlan, approaches
from printmend.messages import say
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


DOT_MM, BIG_DOT_MM = 1.6, 2.5
FRAME_MM = 6.0  # from the outermost dots to the frame
LEAST_FRAME_MM = 3.0  # between the outermost marks and the edge of the bed
FIRST = 3  # way-points before the net: home and the purge line
FRAME_CORNERS = 5  # of which the last is the first again


def with_net(plan: ProbePlan, printer: Printer) -> ProbePlan:
    """Return the plan with a net before its dots, and larger dots.

    Raises `ConfigError` where the dots come too near to the edge of the bed for a frame.
    """
    low, high = plan.marks_mm.min(axis=0) - FRAME_MM, plan.marks_mm.max(axis=0) + FRAME_MM
    bed = np.array([[axis.min_mm + EDGE_MM, axis.max_mm - EDGE_MM] for axis in (printer.x, printer.y)])
    low, high = np.maximum(low, bed[:, 0]), np.minimum(high, bed[:, 1])
    if (plan.marks_mm.min(axis=0) - low).min() < LEAST_FRAME_MM or (
        high - plan.marks_mm.max(axis=0)
    ).min() < LEAST_FRAME_MM:
        raise ConfigError(
            "--net", wanted=say("mm-bed-around-dots", f"{EDGE_MM + LEAST_FRAME_MM:.0f}"), came=say("less"),
            todo=say("terminal-make-size-smaller"),
        )  # fmt: skip
    frame = np.array([low, (high[0], low[1]), high, (low[0], high[1]), low])
    threads = _threads(plan, low, high)
    points = snapped(printer, np.vstack([frame, threads.reshape(-1, 2)]))
    waypoints = np.concatenate([plan.waypoints_mm[:FIRST], points, plan.waypoints_mm[FIRST:]])
    rows = plan.rows + len(points)
    direction, reversal = approaches(waypoints)
    return replace(
        plan, waypoints_mm=frozen(waypoints), rows=rows, direction=direction[rows], reversal_mm=reversal[rows],
        dot_mm=DOT_MM, big_dot_mm=BIG_DOT_MM, net=FIRST + len(points),
    )  # fmt: skip


def strokes_of(plan: ProbePlan) -> list[tuple[int, int]]:
    """Return the first and last way-point of each stroke of a plan's net, the frame first; none without a net."""
    if not plan.net:
        return []
    threads = range(FIRST + FRAME_CORNERS, plan.net, 2)
    return [(FIRST, FIRST + FRAME_CORNERS - 1), *((row, row + 1) for row in threads)]


def _threads(plan: ProbePlan, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the ends [K, 2, 2] of a thread along each row of the lattice, from frame to frame, drawn to and fro."""
    along, across = plan.site.sum(axis=1), plan.site[:, 1] - plan.site[:, 0]
    basis = plan.pitch_mm * np.array(
        [[np.cos(plan.angle_rad), np.sin(plan.angle_rad)], [-np.sin(plan.angle_rad), np.cos(plan.angle_rad)]]
    )
    found: list[np.ndarray] = []
    for parity, line, way in ((0, across, basis[0] + basis[1]), (1, along, basis[1] - basis[0])):
        unit = way / np.hypot(*way)
        for value in np.unique(line[along % 2 == parity]):
            mark = plan.marks_mm[np.flatnonzero((along % 2 == parity) & (line == value))[0]]
            with np.errstate(divide="ignore"):
                near, far = (low - mark) / unit, (high - mark) / unit
            ends = mark + np.array([np.minimum(near, far).max(), np.maximum(near, far).min()])[:, None] * unit
            found.append(ends if len(found) % 2 else ends[::-1])
    return np.array(found)
