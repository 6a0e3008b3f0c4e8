"""A timing pulley that fits a motor, as G-code: a hub with a set screw, a flange, 20 teeth, a bore.

It is drawn layer by layer: a region of the plane becomes closed beads, the outermost first, until it is full.
"""

from itertools import pairwise

import numpy as np
import shapely

from printmend.printer import Printer
from printmend.probe.gcode import CLOSING, PLAIN_START, filament_mm
from printmend.units import TURN_RAD
from printmend_lab.body.pulley import PITCH_LINE_OFFSET_MM, PITCH_MM, toothed_outline_mm

TEETH = 20  # as printers' motors have
RADIUS_MM = TEETH * PITCH_MM / TURN_RAD  # where the belt's cords run
TIP_MM = RADIUS_MM - PITCH_LINE_OFFSET_MM  # radius of the teeth's tips
BORE_MM = 5.0  # of a NEMA 17 motor's shaft
HUB_DIAMETER_MM, HUB_MM = 18.0, 7.0  # of the hub: its diameter and height
FLANGE_MM, TOOTHED_MM = 1.0, 7.0  # for a belt of 6 mm
SET_SCREW_MM = 2.5  # to be tapped M3
BEAD_MM, LAYER_MM = 0.4, 0.2  # a bead's width and height
FEED_MM_S, FIRST_FEED_MM_S, TRAVEL_MM_S = 25.0, 15.0, 120.0
RETRACT_MM, RETRACT_MM_S = 2.5, 30.0
_SMOOTH_MM = 0.005  # what a bead may leave out of its line
_TOOTHED_FROM_MM = HUB_MM + FLANGE_MM  # height at which the teeth begin
TOOTHED_LAYER = round((_TOOTHED_FROM_MM + TOOTHED_MM / 2) / LAYER_MM)  # half-way up the teeth
HEAD = """\
; printmend selfrepair: a GT2 pulley of {teeth} teeth, bore {bore:g} mm, set screw M3 (drill {screw:g} mm, tap)
; for {printer}, nozzle 0.4 mm. Change the temperatures below for another material than PLA.
"""


def pulley_gcode(printer: Printer) -> str:
    """Return the file that prints the pulley in the middle of the bed. Relative E, one object, no support."""
    middle = np.array(printer.middle_mm)
    head = HEAD.format(teeth=TEETH, bore=BORE_MM, screw=SET_SCREW_MM, printer=printer.name)
    lines = [head, PLAIN_START, "G21\n", "G90\n", "M83\n", "G92 E0\n"]
    for number in range(round((_TOOTHED_FROM_MM + TOOTHED_MM) / LAYER_MM)):
        z_mm = (number + 1) * LAYER_MM
        feed_mm_s = FIRST_FEED_MM_S if number == 0 else FEED_MM_S
        lines.append(f";LAYER:{number}\nG1 Z{z_mm:g} F600\n")
        for bead in beads_mm(section(z_mm - LAYER_MM / 2)):
            lines += _bead(bead + middle, feed_mm_s)
    top_mm = _TOOTHED_FROM_MM + TOOTHED_MM + 10
    return "".join([*lines, f"G1 Z{top_mm:g} F600\n", CLOSING])


def section(z_mm: float) -> shapely.Polygon:
    """Return the pulley's cross-section at a height, about its axis."""
    if z_mm > _TOOTHED_FROM_MM:
        outline = shapely.Polygon(toothed_outline_mm(TEETH))
    else:
        outline = shapely.Point(0, 0).buffer(HUB_DIAMETER_MM / 2, quad_segs=32)
    solid = outline.difference(shapely.Point(0, 0).buffer(BORE_MM / 2, quad_segs=16))
    off_mm = abs(z_mm - HUB_MM / 2)
    if off_mm < SET_SCREW_MM / 2:  # a round hole from the bore outwards, cut at this height
        half_mm = np.sqrt((SET_SCREW_MM / 2) ** 2 - off_mm**2)
        solid = solid.difference(shapely.box(0, -half_mm, HUB_DIAMETER_MM, half_mm))
    return solid


def beads_mm(region: shapely.Polygon) -> list[np.ndarray]:
    """Return closed lines [N, 2] that fill a region with beads, from its edge inwards."""
    lines = []
    inner = region.buffer(-BEAD_MM / 2)
    while not inner.is_empty:
        for part in getattr(inner, "geoms", [inner]):
            rings = [part.exterior, *part.interiors]
            lines += [shapely.get_coordinates(ring.simplify(_SMOOTH_MM)) for ring in rings]
        inner = inner.buffer(-BEAD_MM)
    return [line for line in lines if len(line) > 2]


def _bead(line_mm: np.ndarray, feed_mm_s: float) -> list[str]:
    """Return the lines that travel to a bead's start and print it."""
    x, y = line_mm[0]
    back = f"F{RETRACT_MM_S * 60:g}"
    lines = [f"G1 E-{RETRACT_MM:g} {back}\n", f"G0 X{x:.3f} Y{y:.3f} F{TRAVEL_MM_S * 60:g}\n",
             f"G1 E{RETRACT_MM:g} {back}\n"]  # fmt: skip
    feed = f" F{feed_mm_s * 60:g}"
    for before, (x, y) in pairwise(line_mm):
        length = float(np.hypot(x - before[0], y - before[1]))
        lines.append(f"G1 X{x:.3f} Y{y:.3f} E{filament_mm(length * BEAD_MM * LAYER_MM):.5f}{feed}\n")
        feed = ""
    return lines
