"""Choose test prints by gain: the information of marks about a machine, and the tile with most gain per printing time.

A tile is a square block of the lattice of marks. It is printed along both diagonals of its cells, to and fro, straight
or with shrinking reversals. It must touch a tile that was chosen before, so that a scan shows one connected lattice.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from printmend.effects import EFFECTS, Places, Scene, Term, columns_of, scene_of
from printmend.effects.sized import Sized
from printmend.infer.fit import begun
from printmend.infer.machine import machine_of
from printmend.machine import Contacts, Mechanism
from printmend.machine.kernels import run
from printmend.measure.checks import check_trace
from printmend.measure.plan import ProbePlan
from printmend.path import Trace, last_way
from printmend.printer import Printer
from printmend.probe.gcode import ACCELERATION_MM_S2, TRAVEL_MM_S, move_s, travel_s
from printmend.probe.layout import (
    MARKS,
    REVERSAL_EVERY,
    REVERSALS_MM,
    STAIRCASE,
    STRAIGHT,
    Grid,
    Layout,
    grid_of,
    passes,
    pitch_for,
    plan_of,
    rows_of,
)

# The information of marks about a machine: the covariance of its effects' sizes, known before anything is measured.
#
# If the contacts of the play are known, every effect is linear. A mark with the columns φ and noise σ adds φφᵀ/σ² to
# the inverse covariance of the sizes, whatever its reading. So the value of marks is known beforehand: if the columns
# at a part's positions have the mean square D, the expected mean square error is tr(C·D) (physics.md eq. 21).

# Effects that a test print must show: those that depend only on the place on the bed.
WANTED = ("place", "scale", "bend", "pulley", "play", "breathing", "friction", "elastic", "skew", "aspect", "bent")
NOISE_MM = 0.05  # noise of a coordinate that is expected in an owner's measurement
LEAST_NOISE_MM = 0.01  # least noise of a scan
PLAY_MM = 0.3  # prior play of a printer with a fault
LEAST_PLAY_MM = 0.02  # least play, so that a taut belt has a direction of contact, too


@dataclass(frozen=True, eq=False)
class Belief:
    """A belief about a printer: the ``covariance`` [P, P] mm² of the sizes of its effects (``terms``), and a
    ``mechanism`` that decides the contacts. ``sigma_mm`` is the noise of a measured coordinate."""

    scene: Scene
    mechanism: Mechanism
    terms: tuple[Term, ...]
    covariance: np.ndarray
    sigma_mm: float

    def contacts(self, motor_mm: np.ndarray) -> Contacts:
        """Follow the motors [N, 2] through their play from rest; the first row pulls both belts."""
        count = len(motor_mm)
        at, side, belt = np.empty((count, 2), np.int64), np.empty((count, 2), np.int8), np.empty((count, 2))
        for motor, table in enumerate(self.mechanism.transmissions):
            lower, upper = table.branches_mm(motor_mm[:, motor])
            wide = np.maximum(LEAST_PLAY_MM - (upper - lower), 0.0) / 2
            found = np.empty(count, np.int64), np.empty(count, np.int8), np.empty(count)
            run.contacts(np.inf, lower - wide, upper + wide, *found)
            at[:, motor], side[:, motor], belt[:, motor] = found
        return Contacts(at, side, belt)

    def columns(self, waypoints_mm: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Return the columns [2K, P] of both coordinates at ``rows`` [K] of a path [N, 2] mm."""
        printer = self.scene.printer
        motor = printer.to_motor(waypoints_mm)
        touch, none = self.contacts(motor), np.zeros((len(rows), 2))
        ways = last_way(waypoints_mm)[rows].astype(float)
        places = Places(
            np.take_along_axis(motor, touch.row, axis=0)[rows], touch.side[rows].astype(float), waypoints_mm[rows],
            ways, none[:, 0], none[:, 0], none,
        )  # fmt: skip
        each = [columns_of(term.effect, places, term.where, term.shape, self.scene) for term in self.terms]
        return np.concatenate(each, axis=2).reshape(2 * len(rows), -1)

    def told(self, columns: np.ndarray) -> "Belief":
        """Return the belief after measuring marks with these columns [M, P]."""
        information = np.linalg.inv(self.covariance) + columns.T @ columns / self.sigma_mm**2
        covariance = np.linalg.inv(information)
        return replace(self, covariance=(covariance + covariance.T) / 2)

    def wanted(self, waypoints_mm: np.ndarray) -> np.ndarray:
        """Return D [P, P] for a part whose path runs through ``waypoints_mm`` [N, 2]."""
        columns = self.columns(waypoints_mm, np.arange(len(waypoints_mm)))
        return np.asarray(columns.T @ columns / len(waypoints_mm))

    def expected_mm(self, wanted: np.ndarray) -> float:
        """Return the expected RMS error of a part with this D, from the uncertainty about the machine [mm]."""
        return float(np.sqrt(max(float((self.covariance * wanted).sum()), 0.0)))


def _bed_scene(printer: Printer) -> Scene:
    """Return the scene of a measurement of the whole bed."""
    low, high = np.array([[axis.min_mm, axis.max_mm] for axis in printer.axes[:2]], float).T
    corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])
    return scene_of(Trace(corners, corners), printer)


def prior_belief(printer: Printer) -> Belief:
    """Return the belief about any damaged printer: the priors of effects, and some play."""
    scene = _bed_scene(printer)
    mechanism, _ = machine_of(scene, [Sized("play", motor, (), np.array([PLAY_MM])) for motor in range(2)])
    terms = _terms(scene)
    sd_mm = np.concatenate([term.sd_mm for term in terms])
    return Belief(scene, mechanism, terms, np.diag(sd_mm**2), NOISE_MM)


def belief_after(printer: Printer, trace: Trace) -> Belief:
    """Return the belief after a first trace: its information on top of the priors of the effects found.

    An effect that was not found keeps the prior of its mildest term. Raises `TraceError` like `learn`.
    """
    check_trace(trace, printer)
    with threadpool_limits(1, user_api="blas"):
        fit, turned = begun(trace, scene_of(trace, printer))
    scene = replace(_bed_scene(printer), turns_mm=fit.scene.turns_mm)
    found = {(block.effect, block.where) for block in fit.blocks}
    terms = _terms(scene, found)
    sd_mm = np.concatenate([term.sd_mm for term in terms])
    sigma_mm = max(fit.state.sigma_mm, LEAST_NOISE_MM)
    belief = Belief(scene, fit.mechanism, terms, np.diag(sd_mm**2), sigma_mm)
    return belief.told(belief.columns(turned.commanded_mm, np.flatnonzero(turned.measured_rows)))


def _terms(scene: Scene, found: set[tuple[str, int]] | None = None) -> tuple[Term, ...]:
    """Return one term of each effect at each place: the widest, or the mildest if it was not ``found``."""
    chosen: dict[tuple[str, int], Term] = {}
    for name in WANTED:
        for term in EFFECTS[name].terms(scene):
            key, size = (name, term.where), float(np.linalg.norm(term.sd_mm))
            widest = found is None or key in found
            old = float(np.linalg.norm(chosen[key].sd_mm)) if key in chosen else (0.0 if widest else np.inf)
            if size > old if widest else size < old:
                chosen[key] = term
    return tuple(chosen.values())


Worth = Callable[[Belief, np.ndarray], float]


def fall_of(wanted: np.ndarray) -> Worth:
    """Return the function that values marks for a part with this D: the decrease of its expected square error [mm²]."""

    def worth(belief: Belief, columns: np.ndarray) -> float:
        reach = columns @ belief.covariance
        spread = reach @ columns.T + belief.sigma_mm**2 * np.eye(len(columns))
        return float(np.trace(np.linalg.solve(spread, reach @ wanted @ reach.T)))

    return worth


def information(belief: Belief, columns: np.ndarray) -> float:
    """Return the information of marks, ½ log det(I + ΦCΦᵀ/σ²) [nats]."""
    seen = columns @ belief.covariance @ columns.T / belief.sigma_mm**2
    return 0.5 * float(np.linalg.slogdet(np.eye(len(columns)) + seen)[1])


def still_unknown(belief: Belief) -> float:
    """Return the entropy of a belief, ½ log det C [nats], up to a constant."""
    return 0.5 * float(np.linalg.slogdet(belief.covariance)[1])


SIDE, SMALL_SIDE, SMALL = 4, 3, 150  # marks along a tile; the same for fewer than 150 marks in all
LEAST_TILE_SHARE = 0.5  # share of a tile that must lie within the area
PITCHES_MM = (8.0, 11.0, 15.0, 20.0)  # closer marks cannot be identified if belts are very loose
MOST_S = 14.5 * 60  # longest time of one sheet
DOT_S = 0.5  # time of a dot beyond the travel to it
TREATMENTS = ("straight", "reversals", "staircase")


@dataclass(frozen=True, eq=False)
class Segment:
    """A tile printed in one way: its marks, the way-points [N, 2] mm, and the marks' ``rows`` [M] among these.

    ``columns`` [2M, P] belong to the marks. They do not depend on anything printed before, because the run-in takes up
    the play.
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
    """Choose up to ``marks`` marks within an area by their ``worth``; yield a plan for each of several pitches.

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
    """Return the sites of each tile of which at least `LEAST_TILE_SHARE` lies in the area."""
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
    """Return the way-points before each mark: none, an overshoot of every third mark, or also one staircase."""
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
