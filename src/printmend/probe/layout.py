"""Where the marks of a probe print lie and which are large.

The marks fill a square lattice that is turned against the motors' axes by an angle with an irrational tangent, so
that their positions fall evenly on every angle of every pulley. One half of the lattice (i + j even) is visited
along one diagonal of its cells, the other half along the other diagonal: four directions of motion, each all
over the bed.
"""

from dataclasses import dataclass

import numpy as np

from printmend.errors import ConfigError
from printmend.printer import Printer

# tan = 1/golden ratio: the worst number to approximate by fractions, so no pulley angle repeats early.
ROW_ANGLE_RAD = float(np.arctan(2.0 / (1.0 + np.sqrt(5.0))))
EDGE_MM = 4.0  # the nozzle comes no nearer to the edge of the bed
RUN_IN_MM = 9.0  # motion before the first mark of a row: takes up any play of the axes below 4.7 mm
MARKS = 600
MIN_PITCH_MM = 5.5  # nearer dots could touch on a printer that is off by millimetres
LEAST_MM = 30.0
AROUND_PART_MM, TURNS_FOR_PART = 5.0, 1.5
BIG_SHARE = 0.3
CODE_SEED = 20


@dataclass(frozen=True, eq=False)
class Layout:
    """Marks in the order in which they are printed, row by row.

    ``marks_mm`` [M, 2], ``site`` [M, 2] lattice indices, ``big`` [M], ``heading`` [M, 2] the unit vector of the
    motion along the row, ``row`` [M] the number of the row.
    """

    pitch_mm: float
    angle_rad: float
    marks_mm: np.ndarray
    site: np.ndarray
    big: np.ndarray
    heading: np.ndarray
    row: np.ndarray


def mark_area_mm(printer: Printer) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners (low [2], high [2]) of the largest area that marks can fill."""
    margin = EDGE_MM + RUN_IN_MM - 1.0
    low = np.array([printer.x.min_mm, printer.y.min_mm]) + margin
    high = np.array([printer.x.max_mm, printer.y.max_mm]) - margin
    if (high - low < LEAST_MM).any():
        raise ConfigError(
            printer.name,
            wanted=f"{LEAST_MM:.0f} mm for the marks, {margin:.0f} mm from the edges",
            came=f"{high[0] - low[0]:.0f} × {high[1] - low[1]:.0f} mm",
            todo="check the bed in --printer",
        )
    return low, high


def square_mm(printer: Printer, size_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of a square of marks in the middle of the bed, no larger than the bed allows."""
    low, high = mark_area_mm(printer)
    middle = (low + high) / 2
    return np.maximum(low, middle - size_mm / 2), np.minimum(high, middle + size_mm / 2)


def area_around_mm(printer: Printer, points_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the area of marks that a part needs: its own, and one turn of each pulley at the least.

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


def lay_out(printer: Printer, low_mm: np.ndarray, high_mm: np.ndarray, *, marks: int = MARKS) -> Layout:
    """Fill the area between two corners with about ``marks`` marks and order them into rows."""
    area = float(np.prod(high_mm - low_mm))
    pitch = max(float(np.sqrt(area / marks)), MIN_PITCH_MM)
    # On a CoreXY the motors' axes are the diagonals of the bed: turn everything by another 45°.
    heading_rad = ROW_ANGLE_RAD - (np.pi / 4 if printer.kinematics == "corexy" else 0.0)
    angle = heading_rad - np.pi / 4
    basis = pitch * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    reach = int(np.ceil(np.hypot(*(high_mm - low_mm)) / pitch)) + 2
    i, j = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1), indexing="ij")
    site = np.stack([i.ravel(), j.ravel()], axis=1)
    place = site @ basis + (low_mm + high_mm) / 2
    inside = ((place >= low_mm) & (place <= high_mm)).all(axis=1)
    site, place = site[inside], place[inside]
    big = np.random.default_rng(CODE_SEED).random((2 * reach + 1, 2 * reach + 1)) < BIG_SHARE
    big = big[site[:, 0] + reach, site[:, 1] + reach]
    order, heading, row = _rows(site, heading_rad)
    return Layout(pitch, angle, place[order], site[order], big[order], heading, row)


def _rows(site: np.ndarray, heading_rad: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the order [M] of printing, the headings [M, 2] and the numbers of the rows [M]."""
    along, across = site[:, 0] + site[:, 1], site[:, 1] - site[:, 0]
    first = np.array([np.cos(heading_rad), np.sin(heading_rad)])
    second = np.array([-first[1], first[0]])
    order, headings, rows, count = [], [], [], 0
    for parity, line, position, unit in ((0, across, along, first), (1, along, across, second)):
        for index, value in enumerate(np.unique(line[along % 2 == parity])):
            members = np.flatnonzero((along % 2 == parity) & (line == value))
            sign = 1 if index % 2 == 0 else -1
            members = members[np.argsort(sign * position[members])]
            order.append(members)
            headings.append(np.tile(sign * unit, (len(members), 1)))
            rows.append(np.full(len(members), count))
            count += 1
    return np.concatenate(order), np.concatenate(headings), np.concatenate(rows)
