"""Print a small tower that shows the Z screw, which no flat print does; write its G-code and the owner's table."""

import itertools
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from printmend.errors import ConfigError
from printmend.files import replacing
from printmend.measure import write_trace
from printmend.messages import say
from printmend.path import Trace
from printmend.printer import Printer
from printmend.probe.gcode import CLOSING, LIFT_MM_S, PLA_G_PER_MM3, PLAIN_START, TRAVEL_MM_S, filament_mm
from printmend.provenance import sealed_test_print

SIDE_MM, TURNS = 24.0, 2.2  # two turns of the screw show its wave, a little more shows its lead
BRIM_LOOPS, BEAD_MM, PRINT_MM_S = 4, 0.6, 20.0
_LAYER_MM, _HOP_MM = 0.2, 1.0  # layers are whole full steps near this height; a hop lets the nut come down from above
_HOPS = 4  # one hop in so many layers
_HEAD = """\
; printmend probe: a tower for the Z screw, {layers} layers, about {minutes:.0f} min and {grams:.1f} g
; Printed for: {printer}. Change the temperatures below for another material than PLA, and nothing after "tower".
"""
_BEGIN = "; tower\nG21\nG90\nM83\nG92 E0\n"


@dataclass(frozen=True, eq=False)
class Tower:
    """Way-points [N, 3] mm in the order of motion, the first at home; ``printed`` [N]: a bead leads there."""

    waypoints_mm: np.ndarray
    printed: np.ndarray
    layer_mm: float

    @property
    def length_mm(self) -> float:
        """The length of all beads."""
        steps = np.linalg.norm(np.diff(self.waypoints_mm, axis=0), axis=1)
        return float(steps[self.printed[1:]].sum())

    @property
    def minutes(self) -> float:
        """The printing time after heating, at constant speed."""
        return self.length_mm / PRINT_MM_S / 60

    @property
    def grams(self) -> float:
        """The mass of PLA [g]."""
        return self.length_mm * BEAD_MM * self.layer_mm * PLA_G_PER_MM3


def design_tower(printer: Printer) -> Tower:
    """Return a hollow square tower in the middle of the bed, two turns of the screw high, one bead thick.

    Each layer begins in the middle of a side, so that the corners are clean. Before every fourth layer the nozzle rises
    and comes down, so that heights show the backlash. Raises `ConfigError` if the bed or Z is too small.
    """
    room_mm = SIDE_MM + 2 * (BRIM_LOOPS + 1) * BEAD_MM
    step_mm = printer.z.mm_per_step
    layer_mm = max(1, round(_LAYER_MM / step_mm)) * step_mm
    count = math.ceil(TURNS * printer.z.mm_per_turn / layer_mm)
    if min(printer.x.length_mm, printer.y.length_mm) < room_mm or printer.z.max_mm < count * layer_mm + _HOP_MM:
        raise ConfigError(
            printer.name, wanted=say("room-tower-mm-mm-high", f"{room_mm:.0f}", f"{count * layer_mm + _HOP_MM:.0f}"),
            came=say("less"), todo=say("measure-z-screw-dial-gauge-dozen"),
        )  # fmt: skip
    middle = np.array(printer.middle_mm)
    points, printed = [np.array([*printer.home_mm, printer.z.home_mm])], [False]
    if printer.z.home_mm < layer_mm + _HOP_MM:  # lift off the bed before the head moves across it
        points.append(np.array([*printer.home_mm, layer_mm + _HOP_MM]))
        printed.append(False)

    def loop(half_mm: float, z_mm: float, *, hop: bool) -> None:
        round_ = [(0, -1), (1, -1), (1, 1), (-1, 1), (-1, -1), (0, -1)]
        places = [np.array([*(middle + half_mm * np.array(corner)), z_mm]) for corner in round_]
        if hop:
            points.append(places[0] + [0, 0, _HOP_MM])
            printed.append(False)
        points.extend(places)
        printed.extend([False] + [True] * 5)

    for number in range(BRIM_LOOPS, 0, -1):
        loop(SIDE_MM / 2 + number * BEAD_MM, layer_mm, hop=number == BRIM_LOOPS)
    for layer in range(1, count + 1):
        loop(SIDE_MM / 2, layer * layer_mm, hop=layer % _HOPS == 0)
    return Tower(np.array(points), np.array(printed), layer_mm)


def tower_gcode(tower: Tower, printer: Printer, *, start_gcode: str = "") -> str:
    """Return the file that prints a tower: after its start code, every way-point is the end of one G0 or G1, in order.

    ``start_gcode`` replaces plain heating and homing; it must end at the home position.
    """
    points = tower.waypoints_mm
    layers = len(np.unique(points[tower.printed, 2]))
    lines = [
        _HEAD.format(layers=layers, minutes=tower.minutes, grams=tower.grams, printer=printer.name),
        start_gcode or PLAIN_START, _BEGIN,
    ]  # fmt: skip
    for number, (before, place) in enumerate(itertools.pairwise(points), start=1):
        if tower.printed[number]:
            e_mm = filament_mm(math.dist(before, place) * BEAD_MM * tower.layer_mm)
            lines.append(f"G1 X{place[0]:.3f} Y{place[1]:.3f} E{e_mm:.5f} F{PRINT_MM_S * 60:g}\n")
        else:
            feed = (TRAVEL_MM_S if (before[:2] != place[:2]).any() else LIFT_MM_S) * 60
            lines.append(f"G0 X{place[0]:.3f} Y{place[1]:.3f} Z{place[2]:.4f} F{feed:g}\n")
    height = points[:, 2].max() + 10
    return "".join([*lines, f"G0 Z{min(height, printer.z.max_mm):g} F{LIFT_MM_S * 60:g}\n", CLOSING])


def write_tower(path: Path, tower: Tower, printer: Printer, *, start_gcode: str = "") -> Path:
    """Write the G-code to ``path`` and, beside it, the table for the owner to fill in; return the table's path.

    Each row of the table is a way-point; cells that were not measured stay empty.
    """
    points = tower.waypoints_mm
    nothing = np.full(points.shape, np.nan)
    table = path.with_suffix(".csv")
    write_trace(table, Trace(points[:, :2], nothing[:, :2], z_mm=points[:, 2], z_measured_mm=nothing[:, 2]))
    with replacing(path, "wb") as file:
        file.write(sealed_test_print(tower_gcode(tower, printer, start_gcode=start_gcode).encode("utf-8", "replace")))
    return table
