"""The motion of a probe print: way-points that give every mark its direction of approach and its reversal.

Along a row the marks are passed in one direction. Every third mark is overshot and approached from the other
side, by a distance that differs for the two motors; some are approached through a staircase of shrinking
reversals. Long moves have way-points in between, which a simulator or a camera can measure too.
"""

import hashlib
from collections.abc import Sequence

import numpy as np

from printmend.measure.plan import ProbePlan, approaches
from printmend.path import frozen
from printmend.printer import Printer
from printmend.probe.layout import EDGE_MM, MARKS, RUN_IN_MM, Layout

BIG_SHARE = 0.3  # of the marks that are large dots
REVERSALS_MM = (8.0, 6.0, 4.6, 3.4, 2.6, 2.0, 1.5, 1.1, 0.8, 0.6, 0.4, 0.25, 0.15)
REVERSAL_EVERY = 3  # so many rungs both motors turn back
STAIRCASE_EVERY = 45  # so many rungs single steps follow
WAYPOINT_MM, SHORTEST_WAYPOINT_MM = 2.4, 1.0
DOT_MM, BIG_DOT_MM = 1.0, 1.6
PURGE_MM = 100.0  # length of the purge line
STRAIGHT = np.empty((0, 2))
# Swings around a mark by ever shorter reversals, starting ahead of it.
STAIRCASE = np.outer([reversal / 2 * (-1) ** k for k, reversal in enumerate(REVERSALS_MM)], [1.0, 1.0])


def walk(printer: Printer, layout: Layout) -> ProbePlan:
    """Return the plan: home, purge line, then every row of the layout."""
    return walk_with(printer, layout, swings_for(len(layout.marks_mm)))


def swings_for(count: int) -> list[np.ndarray]:
    """Return the way-points [K, 2] before each of so many marks in their order, as `passes` takes them."""
    order = np.random.default_rng(1)
    ladders = [_ladder(order, count) for _ in range(2)]
    swings = []
    for index in range(count):
        rung = index // REVERSAL_EVERY
        if index % STAIRCASE_EVERY == 1:
            swings.append(STAIRCASE)
        elif index % REVERSAL_EVERY == 1:
            swings.append(np.array([[ladders[0][rung], ladders[1][rung]]]))
        else:
            swings.append(STRAIGHT)
    return swings


def walk_with(printer: Printer, layout: Layout, swings: Sequence[np.ndarray]) -> ProbePlan:
    """Return the plan of a layout whose marks are approached by ``swings`` [M]."""
    points, rows = passes(printer, layout, swings)
    # A small bed holds few marks and short rows: way-points lie closer there.
    spacing = max(SHORTEST_WAYPOINT_MM, WAYPOINT_MM * min(1.0, len(rows) / MARKS))
    return plan_of(printer, layout, points, rows, spacing_mm=spacing)


def passes(printer: Printer, layout: Layout, swings: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the way-points [N, 2] of the rows, each with its run-in, and the way-point [M] of every mark.

    ``swings`` [M] of [K, 2] are way-points before each mark: how far beyond it, in mm of each motor.
    """
    low = np.array([printer.x.min_mm, printer.y.min_mm]) + EDGE_MM
    high = np.array([printer.x.max_mm, printer.y.max_mm]) - EDGE_MM
    points, rows = [], np.empty(len(layout.marks_mm), np.int64)
    for index, (mark, heading) in enumerate(zip(layout.marks_mm, layout.heading, strict=True)):
        if index == 0 or layout.row[index] != layout.row[index - 1]:
            points.append(np.clip(mark - RUN_IN_MM * heading, low, high))
        ahead = np.sign(printer.to_motor(heading))
        points += [np.clip(mark + printer.from_motor(ahead * swing), low, high) for swing in swings[index]]
        points.append(mark)
        rows[index] = len(points) - 1
    return np.array(points), rows


def plan_of(
    printer: Printer, layout: Layout, points_mm: np.ndarray, rows: np.ndarray, *, spacing_mm: float = WAYPOINT_MM
) -> ProbePlan:
    """Return the plan of a path: home and purge line, the way-points [N, 2], of which ``rows`` [M] are the marks."""
    lead = [np.array(printer.home_mm), *purge_mm(printer)]
    waypoints = snapped(printer, np.concatenate([lead, points_mm]))
    moved = np.concatenate([[True], (np.diff(waypoints, axis=0) != 0).any(axis=1)])
    waypoints, kept = _subdivided(printer, waypoints[moved], spacing_mm, first=len(lead))
    rows = kept[np.cumsum(moved)[rows + len(lead)] - 1]
    direction, reversal = approaches(waypoints)
    return ProbePlan(
        printer=printer.name,
        kinematics=printer.kinematics,
        mm_per_turn=(printer.x.mm_per_turn, printer.y.mm_per_turn),
        pitch_mm=layout.pitch_mm,
        angle_rad=layout.angle_rad,
        dot_mm=DOT_MM,
        big_dot_mm=BIG_DOT_MM,
        waypoints_mm=frozen(waypoints),
        rows=rows,
        site=layout.site,
        big=code_of(printer, waypoints, layout.site),
        direction=direction[rows],
        reversal_mm=reversal[rows],
    )


def code_of(printer: Printer, waypoints_mm: np.ndarray, site: np.ndarray) -> np.ndarray:
    """Return which marks [M] are large dots: they spell which plan this is, so that no other plan fits its plate.

    The code is drawn from a digest of the printer's name and the way-points [N, 2], a bit for each ``site`` [M, 2].
    """
    whole = np.rint(waypoints_mm * 1000.0).astype("<i8")
    digest = hashlib.sha256(printer.name.encode() + whole.tobytes()).digest()
    sites, which = np.unique(site, axis=0, return_inverse=True)
    drawn = np.random.default_rng(list(digest)).random(len(sites)) < BIG_SHARE
    return np.asarray(drawn[which.ravel()])


def purge_mm(printer: Printer) -> list[np.ndarray]:
    """Return the ends of the purge line, along the front edge."""
    start = np.array([printer.x.min_mm, printer.y.min_mm]) + EDGE_MM
    length = min(PURGE_MM, printer.x.length_mm - 2 * EDGE_MM)
    return [start, start + np.array([length, 0.0])]


def snapped(printer: Printer, points_mm: np.ndarray) -> np.ndarray:
    """Move points [N, 2] onto the motors' micro-steps, so that the printer need not round them."""
    motors = printer.to_motor(points_mm)
    pitch = np.array([axis.mm_per_step / axis.microsteps for axis in (printer.x, printer.y)])
    return np.round(printer.from_motor(np.rint(motors / pitch) * pitch), 5)


def _ladder(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return reversal distances [count]: the whole ladder in shuffled order, again and again."""
    repeats = -(-count // len(REVERSALS_MM))
    return np.concatenate([rng.permutation(REVERSALS_MM) for _ in range(repeats)])[:count]


def _subdivided(
    printer: Printer, points: np.ndarray, spacing_mm: float, *, first: int
) -> tuple[np.ndarray, np.ndarray]:
    """Put way-points on long moves after row ``first``; return them all and the new rows of the old ones."""
    rng = np.random.default_rng(2)
    moves = np.diff(points, axis=0)
    parts = np.maximum(1, np.rint(np.hypot(*moves.T) / spacing_mm)).astype(int)
    parts[:first] = 1
    shares = [(np.arange(1, count) + rng.uniform(-0.3, 0.3, count - 1)) / count for count in parts.tolist()]
    inner, share = np.repeat(np.arange(len(moves)), parts - 1), np.concatenate(shares)
    kept = np.concatenate([[0], np.cumsum(parts)])
    out = np.empty((kept[-1] + 1, 2))
    out[kept] = points
    out[np.setdiff1d(np.arange(len(out)), kept)] = snapped(printer, points[inner] + share[:, None] * moves[inner])
    return out, kept
