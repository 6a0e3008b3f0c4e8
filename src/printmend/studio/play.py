"""A printer that exists only here: broken with sliders, its test print scanned, learned and mended."""

import threading
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

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
from printmend.corruption.pulley import Pulley
from printmend.measure.plan import ProbePlan
from printmend.path import Trace
from printmend.printer import Printer, read_printer
from printmend.probe import design_probe
from printmend.studio import kernels, plate
from printmend.studio.offered import MOST_DENT_MM, Shape, causes_of
from printmend.studio.scene import NEAR
from printmend.twin import Twin
from printmend.units import TURN_RAD

PRINTER = "ender3"
_ANGLES = 180  # of a pulley's outline
_FIRST = threading.Lock()  # what is made once is made by one
_SCREW_PHASE_RAD = 0.6  # of the bent screw that one can play with
_TOWER_MM, _TOWER_TURNS, _TOWER_LAYERS = 20.0, 2.2, 20  # of the tower: its side, turns of the screw, layers
_HAND_MM = 0.03  # how well one measures a tower's corners by hand


@dataclass(frozen=True)
class Side:
    """One motor's pulley and belt: how far the pulley is out of shape, at which angle, and the belt's play."""

    shape: Shape = "round"
    dent_mm: float = 0.0
    angle_deg: float = 0.0
    play_mm: float = 0.0

    def drive(self, radius_mm: float) -> Drive:
        """Return these faults on a healthy pulley of that radius."""
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
        # corners so far out that the pulley takes in as much belt a turn as the round one
        count = 4
        corner = radius_mm * np.pi / (count * np.sin(np.pi / count))
        share = dent / MOST_DENT_MM
        radii = [corner * (1 + 0.12 * share * (-1) ** i) for i in range(count)]
        return Polygon(tuple(round(float(r), 4) for r in radii), phase)


@dataclass(frozen=True)
class Faults:
    """What is broken on the printer of the play screen."""

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
    """Return what the screen draws of the part while sliders move: the plate's topmost layer and what stands on it.

    Places [N, 2] mm along the path, the lines that fill among them, and where a bead leads on that is drawn [N].
    """
    strokes = [stroke for layer in plate.layers()[plate.PLATE_LAYERS - 1 : plate.PLATE_LAYERS + 1] for stroke in layer]
    places = np.concatenate([places for places, _, _ in strokes]) + play_printer()[0].middle_mm
    joined = [np.append(np.full(len(places) - 1, not fills), False) for places, _, fills in strokes]
    return places, np.concatenate(joined)


def preview(faults: Faults) -> dict[str, Any]:
    """Return the shapes of the pulleys and where each mark of the test print lands: a drawing that follows a slider.

    ``outlines_mm`` are polygons about the shafts, ``errors_mm`` [M, 2] how far each of the ``marks_mm`` [M, 2] is off;
    ``part_mm`` and ``printed_mm`` [N, 2] a layer of a part as wanted and as it comes out, laid where it fits, and its
    error ``part_rms_mm``;
    ``wall_mm`` the height of each of its layers, and how far the Z screw pushes it along x.
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
    twin = Twin.of(replace(corruption, screw=None), printer)  # one layer: all of it is pushed alike
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
    z = np.arange(1, len(plate.layers()) + 1) * plate.LAYER_MM
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
    """Return the outline [_ANGLES, 2] of a pulley about its shaft: what no tangent cuts off (physics.md eq. 1)."""
    psi = np.arange(_ANGLES) * (TURN_RAD / _ANGLES)
    support = np.full(_ANGLES, radius_mm) if pulley is None else pulley.support_mm(psi, radius_mm)
    facing = np.cos(psi[:, None] - psi)
    reach = np.where(facing > 1e-3, support[:, None] / np.maximum(facing, 1e-3), np.inf).min(axis=0)
    return reach[:, None] * np.stack([np.cos(psi), np.sin(psi)], axis=1)
