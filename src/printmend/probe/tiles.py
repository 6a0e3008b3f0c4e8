"""Test prints chosen by gain: add the tile of marks with the most gain for its printing time.

A tile is a square block of the lattice of marks. It is printed along both diagonals of its cells, to and fro, straight
or with shrinking reversals, and must touch a tile that was chosen before, so that a scanner finds one whole lattice.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from printmend.measure.plan import ProbePlan
from printmend.printer import Printer
from printmend.probe.gcode import ACCELERATION_MM_S2, TRAVEL_MM_S, move_s, travel_s
from printmend.probe.information import Belief, Worth
from printmend.probe.layout import MARKS, Grid, Layout, grid_of, pitch_for, rows_of
from printmend.probe.walk import REVERSAL_EVERY, REVERSALS_MM, STAIRCASE, STRAIGHT, passes, plan_of

SIDE, SMALL_SIDE, SMALL = 4, 3, 150  # marks along a tile; where there are fewer than 150 marks in all
LEAST_TILE_SHARE = 0.5  # share of a tile that must lie within the area
PITCHES_MM = (8.0, 11.0, 15.0, 20.0)  # closer marks are lost to a scanner where belts are very loose
MOST_S = 14.5 * 60  # that one sheet may take
DOT_S = 0.5  # that a dot takes beyond the way to it
TREATMENTS = ("straight", "reversals", "staircase")


@dataclass(frozen=True, eq=False)
class Segment:
    """A tile printed in one way: its marks, the way-points [N, 2] mm and ``rows`` [M], those that are the marks.

    ``columns`` [2K, P] are those at the marks; they do not depend on what was printed before, because the
    run-in takes up the play.
    """

    tile: tuple[int, int]
    layout: Layout
    points_mm: np.ndarray
    rows: np.ndarray
    seconds: float
    columns: np.ndarray


def chosen_plans(
    printer: Printer, area_mm: tuple[np.ndarray, np.ndarray], belief: Belief, worth: Worth, *, marks: int = MARKS
) -> Iterator[ProbePlan]:
    """Choose up to ``marks`` marks within an area by ``worth`` a mark; yield a plan for each of several pitches.

    ``worth(belief, columns)`` returns the gain of a segment with these columns.
    """
    for pitch_mm in _pitches(area_mm, marks):
        grid = grid_of(printer, *area_mm, pitch_mm)
        segments = _choose(printer, grid, belief, worth, marks)
        if segments:
            yield _plan(printer, grid, segments)


def _pitches(area_mm: tuple[np.ndarray, np.ndarray], marks: int) -> list[float]:
    widest = pitch_for(*area_mm, marks)
    return [pitch for pitch in PITCHES_MM if pitch < 0.9 * widest] + [widest]


def _choose(printer: Printer, grid: Grid, belief: Belief, worth: Worth, marks: int) -> list[Segment]:
    tiles = _tiles(grid, SIDE if marks >= SMALL else SMALL_SIDE)
    options = {tile: tuple(_segments(printer, grid, belief, tile, sites)) for tile, sites in tiles.items()}
    segments: list[Segment] = []
    at, left_s, room = np.array(printer.home_mm), MOST_S, marks
    done: set[tuple[int, int]] = set()
    while True:
        best: tuple[float, float, Segment] | None = None
        near = [tile for tile in options if tile not in done and (not done or _touches(tile, done))]
        for segment in (segment for tile in near for segment in options[tile]):
            seconds = segment.seconds + move_s(
                float(np.hypot(*(segment.points_mm[0] - at))), TRAVEL_MM_S, ACCELERATION_MM_S2
            )
            if len(segment.rows) <= room and seconds <= left_s:
                value = worth(belief, segment.columns) / len(segment.rows)
                best = (
                    max(best, (value, seconds, segment), key=lambda one: one[0]) if best else (value, seconds, segment)
                )
        if best is None:
            return segments
        _, seconds, segment = best
        belief = belief.told(segment.columns)
        segments.append(segment)
        done.add(segment.tile)
        at, left_s, room = segment.points_mm[-1], left_s - seconds, room - len(segment.rows)


def _tiles(grid: Grid, side: int) -> dict[tuple[int, int], np.ndarray]:
    """Return the sites of each tile that lies in the area well enough."""
    index, inverse = np.unique(grid.site // side, axis=0, return_inverse=True)
    members = [np.flatnonzero(inverse.ravel() == k) for k in range(len(index))]
    return {
        (int(i), int(j)): sites
        for (i, j), sites in zip(index, members, strict=True)
        if len(sites) >= LEAST_TILE_SHARE * side**2
    }


def _touches(tile: tuple[int, int], done: set[tuple[int, int]]) -> bool:
    return any((tile[0] + i, tile[1] + j) in done for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1)))


def _segments(
    printer: Printer, grid: Grid, belief: Belief, tile: tuple[int, int], members: np.ndarray
) -> Iterator[Segment]:
    order, heading, row = rows_of(grid.site[members], grid.first, origin=0)
    sites = members[order]
    layout = Layout(grid.pitch_mm, grid.angle_rad, grid.place_mm[sites], grid.site[sites], heading, row)
    for treatment in TREATMENTS:
        points, rows = passes(printer, layout, _swings(treatment, len(sites), tile))
        seconds = travel_s(points) + DOT_S * len(rows)
        yield Segment(tile, layout, points, rows, seconds, belief.columns(points, rows))


def _swings(treatment: str, marks: int, tile: tuple[int, int]) -> list[np.ndarray]:
    """Return the way-points before each mark: none, an overshoot of every third, or one staircase besides."""
    if treatment == "straight":
        return [STRAIGHT] * marks
    ladder = np.random.default_rng([abs(tile[0]), abs(tile[1])]).permutation(REVERSALS_MM)
    swings = []
    for index in range(marks):
        rung = index // REVERSAL_EVERY
        pair = ladder[rung % len(ladder)], ladder[(rung + 5) % len(ladder)]
        swings.append(np.array([pair]) if index % REVERSAL_EVERY == 1 else STRAIGHT)
    if treatment == "staircase":
        swings[marks // 2] = STAIRCASE
    return swings


def _plan(printer: Printer, grid: Grid, segments: list[Segment]) -> ProbePlan:
    layouts = [segment.layout for segment in segments]
    first = np.cumsum([0, *(len(segment.points_mm) for segment in segments)])
    rows = np.concatenate([at + segment.rows for at, segment in zip(first, segments, strict=False)])
    names = ("marks_mm", "site", "heading", "row")
    parts = [np.concatenate([getattr(layout, name) for layout in layouts]) for name in names]
    points = np.concatenate([segment.points_mm for segment in segments])
    return plan_of(printer, Layout(grid.pitch_mm, grid.angle_rad, *parts), points, rows)
