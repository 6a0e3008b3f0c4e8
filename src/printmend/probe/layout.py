"""Lay out a probe: the places of its marks, the path between them, its lines and its net.

The marks fill a square lattice that is rotated from the motors' axes by an angle with an irrational tangent. So their
positions cover the angles of every pulley evenly. Half of the lattice (i + j even) is visited along one diagonal of
its cells, the other half along the other diagonal. This gives four directions of motion, each all over the bed.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from printmend.errors import ConfigError
from printmend.measure.plan import ProbePlan, approaches
from printmend.messages import say
from printmend.path import frozen
from printmend.printer import Printer

# tan = 1/golden ratio: the worst number to approximate by fractions, so no pulley angle repeats early.
ROW_ANGLE_RAD = float(np.arctan(2.0 / (1.0 + np.sqrt(5.0))))
EDGE_MM = 4.0  # the nozzle comes no nearer to the edge of the bed
RUN_IN_MM = 9.0  # motion before the first mark of a row: takes up any play of the axes below 4.7 mm
MARKS = 600  # marks of a whole test print
MIN_PITCH_MM = 5.5  # closer dots could touch on a printer with errors of millimetres
LEAST_AREA_MM = 30.0  # side of the smallest area of marks: three quarters of a turn of the usual pulley
AROUND_PART_MM, TURNS_FOR_PART = 5.0, 1.5
GLASS_EDGE_MM = 8.0  # margin between the outermost marks and the edge of a scanner's glass or of a sheet


@dataclass(frozen=True, eq=False)
class Layout:
    """Marks in the order in which they are printed, row by row.

    ``marks_mm`` [M, 2], ``site`` [M, 2] lattice indices, ``heading`` [M, 2] the unit vector of the motion along the
    row, ``row`` [M] the number of the row.
    """

    pitch_mm: float
    angle_rad: float
    marks_mm: np.ndarray
    site: np.ndarray
    heading: np.ndarray
    row: np.ndarray


def mark_area_mm(printer: Printer) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners (low [2], high [2]) of the largest area that marks can fill."""
    margin = EDGE_MM + RUN_IN_MM - 1.0
    low = np.array([printer.x.min_mm, printer.y.min_mm]) + margin
    high = np.array([printer.x.max_mm, printer.y.max_mm]) - margin
    if (high - low < LEAST_AREA_MM).any():
        raise ConfigError(
            printer.name,
            wanted=say("mm-marks-mm-from-edges", f"{LEAST_AREA_MM:.0f}", f"{margin:.0f}"),
            came=say("mm", f"{high[0] - low[0]:.0f}", f"{high[1] - low[1]:.0f}"),
            todo=say("check-bed-printer"),
        )
    return low, high


def square_mm(printer: Printer, size_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of a square of marks in the middle of the bed; raise `ConfigError` if it does not fit."""
    low, high = mark_area_mm(printer)
    middle = (low + high) / 2
    if size_mm > (high - low).max():
        raise ConfigError(
            say("size"), wanted=say("most-mm", f"{(high - low).max():.0f}", printer.name),
            came=say("mm-2", f"{size_mm:g}"), todo=say("make-smaller-leave-out-whole-bed"),
        )  # fmt: skip
    return np.maximum(low, middle - size_mm / 2), np.minimum(high, middle + size_mm / 2)


def glass_area_mm(printer: Printer, glass_mm: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the largest area of marks that a scanner's glass, or a sheet, shows with a free margin.

    Raises `ConfigError` for a glass too small for any marks.
    """
    low, high = mark_area_mm(printer)
    room = np.array(glass_mm) - 2 * GLASS_EDGE_MM
    size = max((np.minimum(high - low, side) for side in (room, room[::-1])), key=lambda one: float(one.prod()))
    if (size < LEAST_AREA_MM).any():
        raise ConfigError(
            "--scanner", wanted=say("glass-least-mm-side", f"{LEAST_AREA_MM + 2 * GLASS_EDGE_MM:.0f}"),
            came=say("mm", f"{glass_mm[0]:g}", f"{glass_mm[1]:g}"), todo=say("give-width-height-mm-216x297"),
        )  # fmt: skip
    return (low + high - size) / 2, (low + high + size) / 2


def area_around_mm(printer: Printer, points_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the area of marks that a part needs: its own, but at least 1.5 turns of each pulley.

    ``points_mm`` [N, 2] are the ends of the part's moves.
    """
    low, high = mark_area_mm(printer)
    turn = TURNS_FOR_PART * np.array(printer.mm_per_turn)
    part_low, part_high = points_mm.min(axis=0) - AROUND_PART_MM, points_mm.max(axis=0) + AROUND_PART_MM
    short = np.maximum(turn - (part_high - part_low), 0.0) / 2
    wanted_low, wanted_high = part_low - short, part_high + short
    # if the bed ends on one side, take the missing travel from the other side
    shift = np.maximum(low - wanted_low, 0.0) - np.maximum(wanted_high - high, 0.0)
    return np.maximum(wanted_low + shift, low), np.minimum(wanted_high + shift, high)


@dataclass(frozen=True, eq=False)
class Grid:
    """The sites of a square lattice that lie inside an area.

    ``site`` [S, 2] are lattice indices, ``place_mm`` [S, 2] their places on the bed. ``first`` [2] is the direction of
    the cells' first diagonal, along which sites with i + j even are visited.
    """

    pitch_mm: float
    angle_rad: float
    site: np.ndarray
    place_mm: np.ndarray
    first: np.ndarray


def grid_of(printer: Printer, low_mm: np.ndarray, high_mm: np.ndarray, pitch_mm: float) -> Grid:
    """Return the lattice with this pitch between two corners."""
    # On a CoreXY the motors' axes are the diagonals of the bed: rotate the lattice by another 45°.
    heading_rad = ROW_ANGLE_RAD - (np.pi / 4 if printer.kinematics == "corexy" else 0.0)
    angle = heading_rad - np.pi / 4
    basis = pitch_mm * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    reach = int(np.ceil(np.hypot(*(high_mm - low_mm)) / pitch_mm)) + 2
    i, j = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1), indexing="ij")
    site = np.stack([i.ravel(), j.ravel()], axis=1)
    place = site @ basis + (low_mm + high_mm) / 2
    inside = ((place >= low_mm) & (place <= high_mm)).all(axis=1)
    first = np.array([np.cos(heading_rad), np.sin(heading_rad)])
    return Grid(pitch_mm, angle, site[inside], place[inside], first)


def pitch_for(low_mm: np.ndarray, high_mm: np.ndarray, marks: int) -> float:
    """Return the pitch at which about ``marks`` marks fill the area between two corners."""
    return max(float(np.sqrt(np.prod(high_mm - low_mm) / marks)), MIN_PITCH_MM)


def lay_out(printer: Printer, low_mm: np.ndarray, high_mm: np.ndarray, *, marks: int = MARKS) -> Layout:
    """Fill the area between two corners with about ``marks`` marks and order them into rows."""
    grid = grid_of(printer, low_mm, high_mm, pitch_for(low_mm, high_mm, marks))
    order, heading, row = rows_of(grid.site, grid.first)
    return Layout(grid.pitch_mm, grid.angle_rad, grid.place_mm[order], grid.site[order], heading, row)


def rows_of(
    site: np.ndarray, first: np.ndarray, *, origin: int | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the order [M] of printing, the headings [M, 2] and the numbers of the rows [M].

    Rows are printed to and fro. The row that runs along its diagonal's own direction is the first, or row ``origin``
    of the whole lattice.
    """
    along, across = site[:, 0] + site[:, 1], site[:, 1] - site[:, 0]
    second = np.array([-first[1], first[0]])
    order, headings, rows, count = [], [], [], 0
    for parity, line, position, unit in ((0, across, along, first), (1, along, across, second)):
        values = np.unique(line[along % 2 == parity])
        for value in values:
            members = np.flatnonzero((along % 2 == parity) & (line == value))
            sign = 1 if (value - (values[0] if origin is None else origin)) // 2 % 2 == 0 else -1
            members = members[np.argsort(sign * position[members])]
            order.append(members)
            headings.append(np.tile(sign * unit, (len(members), 1)))
            rows.append(np.full(len(members), count))
            count += 1
    return np.concatenate(order), np.concatenate(headings), np.concatenate(rows)


# The motion of a probe print: way-points that give every mark its direction of approach and its reversal.
#
# Along a row the marks are passed in one direction. Every third mark is overshot, by different distances for the two
# motors, and approached from the other side. Some are approached through a staircase of shrinking reversals. Long moves
# have way-points in between, which a simulator or a camera can measure, too.

BIG_SHARE = 0.3  # share of the marks that are large dots
REVERSALS_MM = (8.0, 6.0, 4.6, 3.4, 2.6, 2.0, 1.5, 1.1, 0.8, 0.6, 0.4, 0.25, 0.15)
REVERSAL_EVERY = 3  # before one in so many marks, both motors reverse
STAIRCASE_EVERY = 45  # one in so many marks is approached by a staircase
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
    """Return the way-points [K, 2] before each of ``count`` marks in printing order, as `passes` takes them."""
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
    # A small bed has few marks and short rows: place the way-points closer there.
    spacing = max(SHORTEST_WAYPOINT_MM, WAYPOINT_MM * min(1.0, len(rows) / MARKS))
    return plan_of(printer, layout, points, rows, spacing_mm=spacing)


def passes(printer: Printer, layout: Layout, swings: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the way-points [N, 2] of the rows, each with its run-in, and the way-point [M] of every mark.

    ``swings`` [M] of [K, 2] are the way-points before each mark: their distances beyond it, in mm of each motor.
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
        mm_per_turn=printer.mm_per_turn,
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
    """Return which marks [M] are large dots: they encode the plan, so that no other plan fits its plate.

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
    """Return reversal distances [count]: the whole ladder, shuffled anew each time."""
    repeats = -(-count // len(REVERSALS_MM))
    return np.concatenate([rng.permutation(REVERSALS_MM) for _ in range(repeats)])[:count]


def _subdivided(
    printer: Printer, points: np.ndarray, spacing_mm: float, *, first: int
) -> tuple[np.ndarray, np.ndarray]:
    """Insert way-points into long moves after row ``first``; return all of them, and the new rows of the old ones."""
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


# A probe also prints lines at printing speed, and a thin net under the dots of a plate.

LEG_MM, STEP_MM = 9.0, 3.0  # a battlement's long legs, and the short ones between them
GAP_MM = 2.6  # from the outermost dots to the nearer legs
LEAST_LEGS = 4  # fewest legs along a side; fewer show too little


def with_moving(plan: ProbePlan, printer: Printer) -> ProbePlan:
    """Return the plan with lines at speed after its dots, along the sides where the bed has room."""
    low, high = plan.marks_mm.min(axis=0), plan.marks_mm.max(axis=0)
    bed = np.array([[axis.min_mm + EDGE_MM, axis.max_mm - EDGE_MM] for axis in (printer.x, printer.y)])
    runs = [_battlement(axis, low, high) for axis in range(2) if high[1 - axis] + GAP_MM + STEP_MM <= bed[1 - axis, 1]]
    runs = [run for run in runs if len(run) > 2 * LEAST_LEGS]
    if not runs or len(plan.sheets) > 1:
        return plan
    points = snapped(printer, np.vstack(runs))
    # after the last dot's retraction, the head moves to the first corner
    return replace(plan, waypoints_mm=frozen(np.vstack([plan.waypoints_mm, points])), moving=len(plan.waypoints_mm))


def _battlement(axis: int, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the corners [N, 2] of a battlement with long legs along ``axis``, beyond the dots' upper end across it.

    The battlement along X ends where the one along Y begins, at the right.
    """
    legs = int((high[axis] - low[axis]) // LEG_MM)
    ends = np.repeat(np.linspace(low[axis], high[axis], legs + 1), 2)[1:-1]
    ends = ends if axis == 0 else ends[::-1]
    across = high[1 - axis] + GAP_MM + STEP_MM * (np.arange(len(ends)) // 2 % 2)
    points = np.empty((len(ends), 2))
    points[:, axis], points[:, 1 - axis] = ends, across
    return points


NET_DOT_MM, BIG_NET_DOT_MM = 1.6, 2.5
FRAME_MM = 6.0  # from the outermost dots to the frame
LEAST_FRAME_MM = 3.0  # least distance between the outermost marks and the edge of the bed
FIRST = 3  # way-points before the net: home and the purge line
FRAME_CORNERS = 5  # the last corner repeats the first


def with_net(plan: ProbePlan, printer: Printer) -> ProbePlan:
    """Return the plan with a net before its dots, and larger dots.

    Raises `ConfigError` if the dots come too near to the edge of the bed for a frame.
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
        dot_mm=NET_DOT_MM, big_dot_mm=BIG_NET_DOT_MM, net=FIRST + len(points),
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
