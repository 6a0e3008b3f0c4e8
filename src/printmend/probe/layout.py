"""The places of a probe's marks.

The marks fill a square lattice that is turned against the motors' axes by an angle with an irrational tangent, so
that their positions fall evenly on every angle of every pulley. One half of the lattice (i + j even) is visited
along one diagonal of its cells, the other half along the other diagonal: four directions of motion, each all
over the bed.
"""

from dataclasses import dataclass

import numpy as np

from printmend.errors import ConfigError
from printmend.messages import say
from printmend.printer import Printer

# tan = 1/golden ratio: the worst number to approximate by fractions, so no pulley angle repeats early.
ROW_ANGLE_RAD = float(np.arctan(2.0 / (1.0 + np.sqrt(5.0))))
EDGE_MM = 4.0  # the nozzle comes no nearer to the edge of the bed
RUN_IN_MM = 9.0  # motion before the first mark of a row: takes up any play of the axes below 4.7 mm
MARKS = 600  # of a whole test print
MIN_PITCH_MM = 5.5  # closer dots could touch on a printer with errors of millimetres
LEAST_AREA_MM = 30.0  # side of the smallest area of marks: three quarters of a turn of the usual pulley
AROUND_PART_MM, TURNS_FOR_PART = 5.0, 1.5
GLASS_EDGE_MM = 8.0  # between the outermost marks and the edge of a scanner's glass or of a sheet of paper


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
    """Return the corners of a square of marks in the middle of the bed; raise `ConfigError` where it has no room."""
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
    """Return the corners of the area of marks that a part needs: its own, and one turn of each pulley at least.

    ``points_mm`` [N, 2] are the ends of the part's moves.
    """
    low, high = mark_area_mm(printer)
    turn = TURNS_FOR_PART * np.array([printer.x.mm_per_turn, printer.y.mm_per_turn])
    part_low, part_high = points_mm.min(axis=0) - AROUND_PART_MM, points_mm.max(axis=0) + AROUND_PART_MM
    short = np.maximum(turn - (part_high - part_low), 0.0) / 2
    wanted_low, wanted_high = part_low - short, part_high + short
    # where the bed ends on one side, take the missing turn from the other
    shift = np.maximum(low - wanted_low, 0.0) - np.maximum(wanted_high - high, 0.0)
    return np.maximum(wanted_low + shift, low), np.minimum(wanted_high + shift, high)


@dataclass(frozen=True, eq=False)
class Grid:
    """The square lattice of an area, and what of it lies inside.

    ``site`` [S, 2] lattice indices, ``place_mm`` [S, 2] where they are on the bed, ``first`` [2] the direction of the
    cells' first diagonal, along which sites with i + j even are visited.
    """

    pitch_mm: float
    angle_rad: float
    site: np.ndarray
    place_mm: np.ndarray
    first: np.ndarray


def grid_of(printer: Printer, low_mm: np.ndarray, high_mm: np.ndarray, pitch_mm: float) -> Grid:
    """Return the lattice of a pitch between two corners."""
    # On a CoreXY the motors' axes are the diagonals of the bed: turn everything by another 45°.
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

    Rows are printed to and fro; the first runs along its diagonal, or the one numbered ``origin`` of the whole lattice.
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
