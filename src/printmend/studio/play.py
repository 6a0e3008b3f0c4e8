"""The play screen's virtual printer: sliders break it, a test print is scanned and learned from, and a part mended."""

import itertools
import math
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
import shapely

from printmend.corruption import (
    Corruption,
    CrookedFrame,
    Drive,
    EccentricBore,
    Ellipse,
    FlatSpot,
    Play,
    Polygon,
    Screw,
)
from printmend.corruption.cause import Cause
from printmend.corruption.transmission import Pulley
from printmend.measure.plan import ProbePlan
from printmend.path import Trace
from printmend.printer import Printer, read_printer
from printmend.probe import design_probe
from printmend.probe.gcode import CLOSING, LIFT_MM_S, PLAIN_START, TRAVEL_MM_S, filament_mm
from printmend.studio import kernels
from printmend.studio.offered import MOST_DENT_MM, Shape, causes_of
from printmend.studio.scene import NEAR
from printmend.twin import Twin
from printmend.units import TURN_RAD

# The part of the play screen: a plate with round holes, a word and a thin wall, whose damage anyone sees.
#
# A hole that is not round, a wavy word and a wall that is not straight show the faults of a pulley, a belt or a screw.
# The G-code is made here, for the middle of the printer's bed.

SIZE_MM = (92.0, 60.0)
LAYER_MM, BEAD_MM, PRINT_MM_S = 0.25, 0.45, 40.0
PLATE_LAYERS, WORD_LAYERS, WALL_LAYERS = 8, 5, 40  # the word and the wall stand on the plate
WORD, _LETTER_MM, _SPACE_MM, _WORD_AT_MM, _WORD_BEAD_MM = "printmend", 8.4, 2.2, (-38.5, -21.5), 0.8
HOLES_MM = ((-24.0, 10.0, 13.0), (4.0, 16.0, 7.0), (4.0, -3.0, 4.0))  # x, y and radius, from the middle
_WALL_MM = ((17.0, -6.0), (40.0, 24.0))
_CORNER_MM, _CHORD_MM = 5.0, 0.6

Stroke = np.ndarray  # points [N, 2] mm of a bead


def _arc(x: float, y: float, across: float, high: float, begin_deg: float, end_deg: float) -> list[tuple[float, float]]:
    angles = np.radians(np.linspace(begin_deg, end_deg, 7 + round(abs(end_deg - begin_deg) / 20)))
    return [(x + across * math.cos(a), y + high * math.sin(a)) for a in angles]


# Strokes of the letters; lower-case letters have the height 1.
_BOWL = _arc(0.4, 0.5, 0.4, 0.5, 0, 360)
_LETTERS: dict[str, tuple[float, list[list[tuple[float, float]]]]] = {
    "p": (0.8, [[(0, -0.45), (0, 1)], _BOWL]),
    "r": (0.5, [[(0, 0), (0, 1)], [*_arc(0.42, 0.55, 0.42, 0.45, 180, 70)]]),
    "i": (0.0, [[(0, 0), (0, 1)], [(0, 1.33), (0, 1.45)]]),
    "n": (0.7, [[(0, 0), (0, 1)], [(0, 0.6), *_arc(0.35, 0.62, 0.35, 0.38, 180, 0), (0.7, 0)]]),
    "t": (0.5, [[(0.2, 1.4), *_arc(0.45, 0.25, 0.25, 0.25, 180, 280)], [(-0.05, 1), (0.5, 1)]]),
    "m": (1.1, [
        [(0, 0), (0, 1)], [(0, 0.6), *_arc(0.275, 0.68, 0.275, 0.32, 180, 0), (0.55, 0)],
        [(0.55, 0.6), *_arc(0.825, 0.68, 0.275, 0.32, 180, 0), (1.1, 0)],
    ]),
    "e": (0.8, [[(0.02, 0.52), (0.8, 0.52), *_arc(0.4, 0.5, 0.4, 0.5, 5, 320)]]),
    "d": (0.8, [_BOWL, [(0.8, 1.5), (0.8, 0)]]),
}  # fmt: skip


@lru_cache(maxsize=1)
def layers() -> tuple[tuple[tuple[Stroke, float, bool], ...], ...]:
    """Return each layer's strokes, from the middle of the part: points, bead width, and whether it is infill."""
    plate, above = [], (*((stroke, _WORD_BEAD_MM, False) for stroke in _word()),)
    wall = ((np.array(_WALL_MM), BEAD_MM, False),)
    for number in range(PLATE_LAYERS):
        plate.append(
            (*((one, BEAD_MM, False) for one in _outlines()), *((one, BEAD_MM, True) for one in _fill(number)))
        )
    stands = [(*(above if number < WORD_LAYERS else ()), *wall) for number in range(WALL_LAYERS)]
    return (*plate, *stands)


def plate_gcode(printer: Printer) -> bytes:
    """Return the file that prints the part in the middle of a printer's bed."""
    middle, lines = (
        np.array(printer.middle_mm),
        ["; a plate with holes, a word and a wall\n", PLAIN_START, "G90\nM83\nG92 E0\n"],
    )
    for number, strokes in enumerate(layers(), start=1):
        z_mm = number * LAYER_MM
        lines.append(f";LAYER_CHANGE\n;Z:{z_mm:g}\n;HEIGHT:{LAYER_MM:g}\nG1 Z{z_mm:g} F{LIFT_MM_S * 60:g}\n")
        for stroke, bead_mm, _ in strokes:
            places = stroke + middle
            lines.append(f"G0 X{places[0][0]:.3f} Y{places[0][1]:.3f} F{TRAVEL_MM_S * 60:g}\n")
            feed = f" F{PRINT_MM_S * 60:g}"
            for before, place in itertools.pairwise(places):
                e_mm = filament_mm(math.dist(before, place) * bead_mm * LAYER_MM)
                lines.append(f"G1 X{place[0]:.3f} Y{place[1]:.3f} E{e_mm:.5f}{feed}\n")
                feed = ""
    return "".join([*lines, f"G0 Z{len(layers()) * LAYER_MM + 10:g} F{LIFT_MM_S * 60:g}\n", CLOSING]).encode()


def _word() -> Iterator[Stroke]:
    x, y = _WORD_AT_MM
    for letter in WORD:
        wide, strokes = _LETTERS[letter]
        for stroke in strokes:
            yield np.array(stroke) * _LETTER_MM + (x, y)
        x += wide * _LETTER_MM + _SPACE_MM


@lru_cache(maxsize=1)
def _shape() -> shapely.Polygon:
    wide, deep = (side / 2 - _CORNER_MM for side in SIZE_MM)
    plate = shapely.box(-wide, -deep, wide, deep).buffer(_CORNER_MM, quad_segs=12)
    holes = [
        shapely.Point(x, y).buffer(radius, quad_segs=round(radius * math.pi / 2 / _CHORD_MM))
        for x, y, radius in HOLES_MM
    ]
    return plate.difference(shapely.union_all(holes))


def _outlines() -> Iterator[Stroke]:
    for loop in (0.5, 1.5):
        shape = _shape().buffer(-loop * BEAD_MM)
        for ring in (shape.exterior, *shape.interiors):
            yield np.array(ring.coords)


def _fill(number: int) -> Iterator[Stroke]:
    """Yield infill lines at 45° within the outlines; the direction alternates from layer to layer."""
    room, reach = _shape().buffer(-2 * BEAD_MM), sum(SIZE_MM)
    turned = shapely.affinity.rotate(room, 45.0 if number % 2 else -45.0, origin=(0, 0))
    heights = np.arange(-reach / 2, reach / 2, BEAD_MM)
    back = math.radians(-45.0 if number % 2 else 45.0)
    turn = np.array([[math.cos(back), math.sin(back)], [-math.sin(back), math.cos(back)]])
    for count, y in enumerate(heights):
        line = turned.intersection(shapely.LineString([(-reach, y), (reach, y)]))
        pieces = [
            np.array(one.coords) for one in getattr(line, "geoms", [line]) if not one.is_empty and one.length > BEAD_MM
        ]
        pieces.sort(key=lambda one: one[0][0])
        for piece in pieces if count % 2 else [one[::-1] for one in pieces[::-1]]:
            yield piece @ turn


PRINTER = "ender3"
_ANGLES = 180  # points of a pulley's outline
_FIRST = threading.Lock()  # lets only one thread make cached values
_SCREW_PHASE_RAD = 0.6  # phase of the play screen's bent screw
_TOWER_MM, _TOWER_TURNS, _TOWER_LAYERS = 20.0, 2.2, 20  # the tower's side, turns of the screw, and layers
_HAND_MM = 0.03  # standard deviation of a hand measurement of a tower's corners


@dataclass(frozen=True)
class Side:
    """One motor's pulley and belt: the pulley's deformation and its angle, and the belt's play."""

    shape: Shape = "round"
    dent_mm: float = 0.0
    angle_deg: float = 0.0
    play_mm: float = 0.0

    def drive(self, radius_mm: float) -> Drive:
        """Return these faults on a healthy pulley with this radius."""
        return Drive(pulley=self._pulley(radius_mm), belt=Play(self.play_mm) if self.play_mm > 0 else None)

    def _pulley(self, radius_mm: float) -> Pulley | None:
        dent, phase = self.dent_mm, float(np.radians(self.angle_deg))
        if self.shape == "round" or dent <= 0:
            return None
        if self.shape == "eccentric":
            return EccentricBore(dent, phase)
        if self.shape == "oval":
            return Ellipse(radius_mm + dent, radius_mm - dent, phase)
        if self.shape == "flat":
            return FlatSpot(dent, phase)
        # place the corners so that a turn moves as much belt as with the round pulley
        count = 4
        corner = radius_mm * np.pi / (count * np.sin(np.pi / count))
        share = dent / MOST_DENT_MM
        radii = [corner * (1 + 0.12 * share * (-1) ** i) for i in range(count)]
        return Polygon(tuple(round(float(r), 4) for r in radii), phase)


@dataclass(frozen=True)
class Faults:
    """The faults of the play screen's printer."""

    x: Side = field(default_factory=Side)
    y: Side = field(default_factory=Side)
    skew_deg: float = 0.0
    screw_mm: float = 0.0
    causes: tuple[Cause, ...] = ()

    def corruption(self, printer: Printer) -> Corruption:
        """Return the faults as the program describes them."""
        frame = CrookedFrame(skew_deg=self.skew_deg) if self.skew_deg else None
        x, y = (side.drive(axis.radius_mm) for side, axis in zip((self.x, self.y), printer.axes, strict=False))
        screw = Screw(wobble_mm=self.screw_mm, wobble_phase_rad=_SCREW_PHASE_RAD) if self.screw_mm else None
        return Corruption((x, y), frame, screw, self.causes)


def faults_of(table: dict[str, Any]) -> Faults:
    """Return the faults of a plain table, as the page sends it."""
    causes = causes_of(table.get("effects", []))
    return Faults(Side(**table["x"]), Side(**table["y"]), table["skew_deg"], table["screw_mm"], causes)


@lru_cache(maxsize=1)
def play_printer() -> tuple[Printer, ProbePlan]:
    """Return the printer of the play screen and its test print."""
    printer = read_printer(PRINTER)
    return printer, design_probe(printer)


@lru_cache(maxsize=1)
def play_layer() -> tuple[np.ndarray, np.ndarray]:
    """Return what the screen draws of the part while sliders move: the plate's top layer and the next one.

    These are places [N, 2] mm along the path, infill included, and a mask [N] of those from which a drawn bead leads
    on.
    """
    strokes = [stroke for layer in layers()[PLATE_LAYERS - 1 : PLATE_LAYERS + 1] for stroke in layer]
    places = np.concatenate([places for places, _, _ in strokes]) + play_printer()[0].middle_mm
    joined = [np.append(np.full(len(places) - 1, not fills), False) for places, _, fills in strokes]
    return places, np.concatenate(joined)


def preview(faults: Faults) -> dict[str, Any]:
    """Return a drawing that follows a slider: the pulleys' shapes, and where the test print's marks land.

    ``outlines_mm`` are polygons about the shafts; ``errors_mm`` [M, 2] are the errors of the ``marks_mm`` [M, 2].
    ``part_mm`` and ``printed_mm`` [N, 2] are a layer of the part as wanted and as printed, aligned; its error is
    ``part_rms_mm``. ``wall_mm`` has the height of each layer, and how far the Z screw pushes it along x.
    """
    with _FIRST:
        printer, plan = play_printer()
        _, joined = play_layer()
    drawn = shown(faults)
    return {
        "outlines_mm": [outline.round(3).tolist() for outline in drawn["outlines_mm"]],
        "radii_mm": [axis.radius_mm for axis in printer.axes[:2]],
        "bed_mm": [printer.x.min_mm, printer.y.min_mm, printer.x.max_mm, printer.y.max_mm],
        "marks_mm": plan.marks_mm.round(2).tolist(), "errors_mm": drawn["errors_mm"].round(4).tolist(),
        "rms_mm": round(drawn["rms_mm"], 4),
        "big": plan.big.tolist(), "part_mm": drawn["part_mm"].round(3).tolist(),
        "printed_mm": drawn["printed_mm"].round(3).tolist(), "joined": joined.tolist(),
        "part_rms_mm": round(drawn["part_rms_mm"], 4),
        "wall_mm": drawn["wall_mm"].round(3).tolist(),
    }  # fmt: skip


def shown(faults: Faults) -> dict[str, Any]:
    """Return the numbers of `preview` before they are rounded."""
    printer, plan = play_printer()
    places, joined = play_layer()
    corruption = faults.corruption(printer)
    twin = Twin.of(replace(corruption, screw=None), printer)  # the screw shifts a single layer as a whole
    off = twin.seen(plan.waypoints_mm)[plan.rows] - plan.marks_mm
    printed = twin.follow(np.concatenate([[printer.home_mm], places]))[1:]
    printed -= (printed - places).mean(axis=0)
    shape = off - off.mean(axis=0)
    return {
        "outlines_mm": [outline_mm(drive.pulley, axis.radius_mm)
                        for drive, axis in zip(corruption.drives, printer.axes, strict=False)],
        "errors_mm": off, "rms_mm": float(np.sqrt(np.mean(np.sum(shape**2, axis=1)))),
        "part_mm": places, "printed_mm": printed, "part_rms_mm": _rms_mm(places, printed, joined),
        "wall_mm": _wall(corruption, printer),
    }  # fmt: skip


def _rms_mm(wanted_mm: np.ndarray, printed_mm: np.ndarray, joined: np.ndarray) -> float:
    """Return the RMS error of a layer [N, 2] over its length, as `mend` states it for a part."""
    error, length = np.empty(len(wanted_mm)), np.hypot(*np.diff(wanted_mm, axis=0).T) * joined[:-1]
    kernels.distances(wanted_mm, np.ascontiguousarray(printed_mm), joined, NEAR, error)
    return float(np.sqrt(np.average((error[:-1] ** 2 + error[1:] ** 2) / 2, weights=length)))


def _wall(corruption: Corruption, printer: Printer) -> np.ndarray:
    """Return how a bent screw shifts the layers of the part's wall: rows [L, 2] of height and push [mm]."""
    z = np.arange(1, len(layers()) + 1) * LAYER_MM
    push = np.zeros(len(z)) if corruption.screw is None else corruption.screw.lower(printer).wobble_at_mm(z)[:, 0]
    return np.column_stack([z, push - push.mean()])


def tower_trace(corruption: Corruption, printer: Printer, rng: np.random.Generator) -> Trace:
    """Return hand measurements of a small tower, two turns of the screw high: its corners' places and heights."""
    middle = np.array(printer.middle_mm)
    corners = middle + _TOWER_MM / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    heights = np.linspace(0.2, _TOWER_TURNS * printer.z.mm_per_turn, _TOWER_LAYERS)
    path = np.array([(*printer.home_mm, printer.z.home_mm), *((x, y, z) for z in heights for x, y in corners)])
    seen = Twin.of(corruption, printer).follow(path) + rng.normal(0, _HAND_MM, path.shape)
    return Trace(path[:, :2], seen[:, :2], z_mm=path[:, 2], z_measured_mm=seen[:, 2], homed=True)


def outline_mm(pulley: Pulley | None, radius_mm: float) -> np.ndarray:
    """Return the outline [_ANGLES, 2] of a pulley about its shaft, inside all its tangents (physics.md eq. 1)."""
    psi = np.arange(_ANGLES) * (TURN_RAD / _ANGLES)
    support = np.full(_ANGLES, radius_mm) if pulley is None else pulley.support_mm(psi, radius_mm)
    facing = np.cos(psi[:, None] - psi)
    reach = np.where(facing > 1e-3, support[:, None] / np.maximum(facing, 1e-3), np.inf).min(axis=0)
    return reach[:, None] * np.stack([np.cos(psi), np.sin(psi)], axis=1)
